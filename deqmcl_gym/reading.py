"""Files that somebody else may have made: read without waiting, without end, without trust."""

import errno
import io
import json
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

MOST_BYTES = 2**26  # far above any file of ours

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


class UnreadableError(ValueError):
    """Why a file cannot be taken for what it should be: words that follow its name."""


@contextmanager
def opened(path: Path) -> Iterator[io.BufferedReader]:
    """Open a regular file; a pipe is not waited for.

    Raises:
        FileNotFoundError: there is none.
        UnreadableError: it is no file, or may not be read.
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
        FileNotFoundError: there is none.
        UnreadableError: it is no file, is too large, or may not be read.
    """
    with opened(path) as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise UnreadableError(f"is larger than {MOST_BYTES:,} bytes, the most that is read")
    return content


def json_of(content: bytes) -> dict[str, Any]:
    """Return the JSON object that a file holds.

    Raises:
        UnreadableError: it holds something else.
    """
    try:
        value = json.loads(content.decode(), parse_constant=_refuse_constant)
    except UnreadableError:
        raise
    except UnicodeDecodeError:
        raise UnreadableError("cannot be read (it is no UTF-8)") from None
    except ValueError:
        raise UnreadableError("is torn, or no JSON") from None
    except RecursionError:
        raise UnreadableError("is nested too deeply") from None
    if not isinstance(value, dict):
        raise UnreadableError("is no JSON object")
    return value


def misfit(value: Any, shape: Any, at: str = "") -> str | None:
    """Say where a JSON value differs from a shape; None if it fits.

    Args:
        value: read from JSON.
        shape: a type; a tuple of shapes, one of which must fit; [shape] of each item; {str: shape}
            of a table with any keys; {"key": shape, …} of one that has these, and maybe others.
        at: where the value stands, for the answer.
    """
    if isinstance(shape, tuple):
        return None if any(misfit(value, one) is None for one in shape) else _unlike(value, at)
    if isinstance(shape, type):
        right = isinstance(value, int | float if shape is float else shape)
        return None if right and isinstance(value, bool) == (shape is bool) else _unlike(value, at)
    inner: list[tuple[Any, Any]]
    if isinstance(shape, list) and isinstance(value, list):
        inner = [(index, shape[0]) for index in range(len(value))]
    elif isinstance(shape, dict) and isinstance(value, dict):
        keys = dict.fromkeys(value, shape[str]) if str in shape else shape
        if lacking := [key for key in keys if key not in value]:
            return f"has no {at}{'.' * bool(at)}{lacking[0]}"
        inner = list(keys.items())
    else:
        return _unlike(value, at)
    found = (misfit(value[key], one, f"{at}{'.' * bool(at)}{key}") for key, one in inner)
    return next(filter(None, found), None)


def _unlike(value: Any, at: str) -> str:
    words = repr(value)
    shown = words if len(words) <= 60 else f"{words[:57]}…"
    return f"has {shown} at {at}" if at else f"is {shown}"


def _refuse_constant(name: str) -> NoReturn:
    raise UnreadableError(f"holds {name}, which is no number")
