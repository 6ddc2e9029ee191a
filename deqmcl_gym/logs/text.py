"""Text of logs and trajectories, gzipped or not, in any common encoding."""

import gzip
import io
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from deqmcl_gym.reading import UnreadableError, opened
from deqmcl_gym.validation import InputError

_GZIP = b"\x1f\x8b"


def text_of(path: Path) -> str:
    """Return the text of a file, decompressed if it is gzip.

    Bytes that are not UTF-8 become U+FFFD, so that they damage their line only.

    Raises:
        InputError: the file is missing, cannot be read, is damaged gzip, or is binary.
    """
    with opened_log(path) as file:
        packed = file.read()
    if packed[:2] == _GZIP:
        try:
            packed = gzip.decompress(packed)
        except (EOFError, zlib.error, OSError) as error:
            raise InputError(
                f"{path} is a truncated or damaged gzip file ({error}): fetch it again."
            ) from None
    if packed[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return packed.decode("utf-16", errors="replace")
    if b"\0" in packed[:4096]:
        raise InputError(
            f"{path} is a binary file, but must be text: check the ending of its name."
        )
    return packed.decode("utf-8-sig", errors="replace")


@contextmanager
def opened_log(path: Path) -> Iterator[io.BufferedReader]:
    """Open a file.

    Raises:
        InputError: it is missing, not a regular file, or cannot be read.
    """
    try:
        with opened(path) as file:
            yield file
    except FileNotFoundError:
        raise InputError(f"{path} does not exist: give the path of a file.") from None
    except UnreadableError as error:
        raise InputError(f"{path} {error}: give another file.") from None


def numbers_of(words: list[str]) -> list[float]:
    """Return words as numbers, NaN and inf among them.

    Raises:
        ValueError: one is not a number. "1_000", which Python takes, is refused too.
    """
    if any("_" in word for word in words):
        raise ValueError("an underscore")
    return [float(word) for word in words]
