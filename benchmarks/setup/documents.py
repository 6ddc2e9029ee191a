"""TOML documents: read, and taken apart; bad values are refused by name."""

import codecs
import io
import math
import tomllib
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from deqmcl_gym.files import UnreadableError, content_of
from deqmcl_gym.validation import InputError, one_of

# byte order marks, the longer ones first
_MARKS = {
    codecs.BOM_UTF32_LE: "UTF-32",
    codecs.BOM_UTF32_BE: "UTF-32",
    codecs.BOM_UTF16_LE: "UTF-16",
    codecs.BOM_UTF16_BE: "UTF-16",
}


def read(path: Path, what: str) -> dict[str, Any]:
    """Return the document in the file of a ``what``.

    Raises:
        InputError: it cannot be read, or is no TOML.
    """
    named = f"the {what} file {path}"
    try:
        content = content_of(path)
    except FileNotFoundError:
        raise InputError(f"{named} is not there: give an existing file.") from None
    except UnreadableError as error:
        raise InputError(f"{named} {error}: give another one.") from None
    try:
        return tomllib.loads(_decoded(content, named))
    except RecursionError:
        raise InputError(f"{named} is not valid TOML: its values are nested too deeply.") from None
    except InputError:
        raise
    except ValueError as error:  # an error of TOML, or a number of thousands of digits
        raise InputError(f"{named} is not valid TOML: {error}.") from None


def _decoded(content: bytes, named: str) -> str:
    """Return UTF-8 text, with or without a byte order mark, whatever ends its lines.

    Raises:
        InputError: it is in another encoding.
    """
    encoding = next((name for mark, name in _MARKS.items() if content.startswith(mark)), None)
    if encoding is not None:
        raise InputError(f"{named} is {encoding}, but must be UTF-8: save it as UTF-8.")
    try:
        content.decode()
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        found = f"byte 0x{content[error.start]:02x} in line {line}"
        raise InputError(f"{named} is not UTF-8 ({found}): save it as UTF-8.") from None
    if 0 in content:
        raise InputError(f"{named} holds zero bytes, as UTF-16 does: save it as UTF-8.")
    return io.TextIOWrapper(io.BytesIO(content), "utf-8-sig").read()


@contextmanager
def errors_name(path: Path) -> Iterator[None]:
    """Let what is refused in here name the file."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def check(given: Mapping[str, Any], keys: Sequence[str]) -> None:
    """Refuse an unknown key, and values that cannot name a result: NaN and dates."""
    for key in given:
        one_of("key", key, keys)
    _refuse_nan(given, "")


def table(what: str, value: Any, wanted: str) -> Mapping[str, Any]:
    """Return a table; else say that it must be what is ``wanted``."""
    if not isinstance(value, Mapping):
        raise InputError(f"{what} is {value!r}, but must be {wanted}.")
    return value


def text(what: str, value: Any) -> str:
    """Return a text that is not empty."""
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{what} is {value!r}, but must be text that is not empty.")
    return value


def _refuse_nan(value: Any, at: str) -> None:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            _refuse_nan(inner, f"{at}.{key}" if at else key)
    elif isinstance(value, list):
        for inner in value:
            _refuse_nan(inner, at)
    elif not isinstance(value, str | bool | int | float):
        raise InputError(f"{at} is {value}, but must be text, a number, true or false.")
    elif isinstance(value, str) and not _is_text(value):
        raise InputError(f"{at} is {value!a}, but must be text without control characters.")
    elif isinstance(value, float) and math.isnan(value):
        raise InputError(f"{at} is nan, but must be a number.")


def _is_text(text: str) -> bool:
    return not any(unicodedata.category(c) in ("Cc", "Cs") and c not in "\t\n\r" for c in text)
