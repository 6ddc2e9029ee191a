"""TOML documents of users: read, and refused in a sentence that names file and key."""

import io
import math
import tomllib
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from deqmcl_gym.files import UnreadableError, content_of
from deqmcl_gym.validation import InputError, one_of, shown

_LARGEST = 1e100  # magnitude of a number: charts take no larger ones


def read(path: Path, what: str) -> dict[str, Any]:
    """Return the document in the file of a ``what``: UTF-8, with or without a byte order mark."""
    named = f"the {what} file {path}"
    try:
        content = content_of(path)
        document = io.StringIO(content.decode("utf-8-sig"), newline=None).read()
        return tomllib.loads(document)
    except FileNotFoundError:
        raise InputError(f"{named} is not there: give an existing file.") from None
    except UnreadableError as error:
        raise InputError(f"{named} {error}: give another one.") from None
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        found = f"byte 0x{content[error.start]:02x} in line {line}"
        raise InputError(f"{named} is not UTF-8 ({found}): save it as UTF-8.") from None
    except RecursionError:
        raise InputError(f"{named} is not valid TOML: its values are nested too deeply.") from None
    except ValueError as error:  # an error of TOML, or a number of thousands of digits
        raise InputError(f"{named} is not valid TOML: {error}.") from None


@contextmanager
def errors_name(path: Path) -> Iterator[None]:
    """Let what is refused in here name the file."""
    try:
        yield
    except RecursionError:
        raise InputError(f"{path}: its values are nested too deeply.") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def check(given: Mapping[str, Any], keys: Sequence[str]) -> None:
    """Refuse an unknown key, and values that cannot name a result: NaN and dates."""
    for key in given:
        one_of("key", key, keys)
    _check_value(given, "")


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


def _check_value(value: Any, at: str) -> None:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            _check_value(inner, f"{at}.{key}" if at else key)
    elif isinstance(value, list):
        for inner in value:
            _check_value(inner, at)
    elif isinstance(value, str):
        if any(unicodedata.category(c) in ("Cc", "Cs") and c not in "\t\n\r" for c in value):
            raise InputError(f"{at} is {value!a}, but must be text without control characters.")
    elif not isinstance(value, bool | int | float):
        raise InputError(f"{at} is {value}, but must be text, a number, true or false.")
    elif math.isnan(value):
        raise InputError(f"{at} is nan, but must be a number.")
    elif _LARGEST < abs(value) < math.inf:
        raise InputError(f"{at} is {shown(value)}, but must be at most {_LARGEST:g}, or inf.")
