"""Reading of untrusted files: nothing blocks, sizes are limited, contents are checked."""

import errno
import io
import json
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import msgspec

MOST_BYTES = 2**26  # far above any file of ours

T = TypeVar("T")

_UNLIKE = re.compile(r"Expected `(?P<expected>.*)`, got `(?P<given>.*)`")
_LACKING = re.compile(r"Object missing required field `(.*)`")
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


class UnreadableError(ValueError):
    """Why a file cannot be used: the rest of a sentence that begins with its name."""


@contextmanager
def opened(path: Path) -> Iterator[io.BufferedReader]:
    """Open a regular file, without waiting for a pipe.

    Raises:
        FileNotFoundError: it does not exist.
        UnreadableError: it is not a regular file, or cannot be read.
    """
    try:
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except FileNotFoundError:
        raise
    except OSError as error:
        raise UnreadableError(f"cannot be read ({error.strerror})") from None
    except ValueError:  # a name with a null character
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path)) from None
    kind = stat.S_IFMT(os.fstat(handle).st_mode)
    if kind != stat.S_IFREG:
        os.close(handle)
        raise UnreadableError(f"is {_KINDS.get(kind, 'no file')}")
    with os.fdopen(handle, "rb") as file:
        yield file


def content_of(path: Path) -> bytes:
    """Return the bytes of a regular file of at most ``MOST_BYTES``.

    Raises:
        FileNotFoundError: it does not exist.
        UnreadableError: it is not a regular file, is too large, or cannot be read.
    """
    with opened(path) as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise UnreadableError(f"is larger than {MOST_BYTES:,} bytes, the most that is read")
    return content


def json_of(content: bytes) -> dict[str, Any]:
    """Return the JSON object in a file's content.

    Raises:
        UnreadableError: the content is anything else.
    """
    try:
        value = json.loads(content.decode(), parse_constant=_refuse_constant)
    except UnreadableError:
        raise
    except UnicodeDecodeError:
        raise UnreadableError("cannot be read (it is not UTF-8)") from None
    except ValueError:
        raise UnreadableError("is truncated, or not JSON") from None
    except RecursionError:
        raise UnreadableError("is nested too deeply") from None
    if not isinstance(value, dict):
        raise UnreadableError("is not a JSON object")
    return value


def typed(value: Any, kind: type[T]) -> T:
    """Return a JSON value as a type whose fields describe its shape; more fields may be there.

    Raises:
        UnreadableError: the value is unlike the type; the message names the field.
    """
    try:
        return msgspec.convert(value, kind, str_keys=True)
    except msgspec.ValidationError as error:
        what, _, place = str(error).partition(" - at ")
        at = place.replace("`", "").replace("$.", "").replace("[...]", "[]")
        if unlike := _UNLIKE.fullmatch(what):
            what = f"has {unlike['given']} instead of {unlike['expected']}"
        elif lacking := _LACKING.fullmatch(what):
            what = f"has no {lacking[1]}"
        else:
            at = "$"  # its parts do not belong together
        raise UnreadableError(what if at == "$" else f"{what} at {at}") from None


def _refuse_constant(name: str) -> NoReturn:
    raise UnreadableError(f"contains {name}, which is not a number")
