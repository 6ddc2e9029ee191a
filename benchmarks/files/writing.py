"""A folder that can be written to; a file written whole or not at all."""

import re
import shlex
import tempfile
from collections.abc import Sequence
from pathlib import Path

from deqmcl_gym.files import PREFIX, SUFFIX, write_bytes
from deqmcl_gym.validation import InputError

_TEMPORARY = re.compile(f"{re.escape(PREFIX)}[a-z0-9_]{{8}}{re.escape(SUFFIX)}")


def writable_folder(path: Path) -> Path:
    """Make a folder if it is missing.

    Raises:
        InputError: it is a file, or cannot be written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except (FileExistsError, NotADirectoryError):
        raise InputError(
            f"the output folder {path} is a file, or is inside one: give a folder."
        ) from None
    except OSError as error:
        raise InputError(
            f"the output folder {path} cannot be written to ({error.strerror}): give another one."
        ) from None
    return path


def is_temporary(path: Path) -> bool:
    """Whether a file is what an interrupted write of ours has left."""
    return _TEMPORARY.fullmatch(path.name) is not None and path.is_file() and not path.is_symlink()


def utf8(text: str) -> bytes:
    r"""Encode a text; a byte of a file name that is no UTF-8 as ``\udc…``."""
    return text.encode(errors="backslashreplace")


def command_line(words: Sequence[str]) -> str:
    r"""Quote words for a shell, on one line of text; bytes that are no UTF-8 as ``$'\xe9'``."""
    return " ".join(
        shlex.quote(word) if word.isprintable() else f"$'{_escaped(word)}'" for word in words
    )


def _escaped(word: str) -> str:
    quoted = word.replace("\\", "\\\\").replace("'", "\\'")
    return "".join(c if c.isprintable() else _bytes_of(c) for c in quoted)


def _bytes_of(character: str) -> str:
    of_file_name = "\udc80" <= character <= "\udcff"
    content = character.encode(errors="surrogateescape" if of_file_name else "replace")
    return "".join(f"\\x{byte:02x}" for byte in content)


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    write_bytes(path, text.encode())
