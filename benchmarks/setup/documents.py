"""TOML documents: read, and taken apart; what is not as it should be is refused by name."""

import math
import tomllib
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.files import UnreadableError, content_of
from deqmcl_gym.validation import InputError, one_of


def read(path: Path, what: str) -> dict[str, Any]:
    """Return the document in the file of a ``what``.

    Raises:
        InputError: it cannot be read, or is no TOML.
    """
    try:
        return tomllib.loads(content_of(path).decode())
    except FileNotFoundError:
        raise InputError(f"the {what} file {path} is not there: give one that is.") from None
    except UnreadableError as error:
        raise InputError(f"the {what} file {path} {error}: give another one.") from None
    except RecursionError:
        raise InputError(f"the {what} file {path} is nested too deeply.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"the {what} file {path} is no TOML: {error}.") from None


@contextmanager
def errors_name(path: Path) -> Iterator[None]:
    """Let what is refused in here name the file."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def check(given: Mapping[str, Any], keys: Sequence[str]) -> None:
    """Refuse an unknown key, and what no result can be named by: NaN, and dates."""
    for key in given:
        one_of("key", key, keys)
    _refuse_nan(given, "")


def dotted(what: str, given: Any, prefix: str = "") -> dict[str, Any]:
    """Return nested tables as one, with dotted names."""
    flat: dict[str, Any] = {}
    for key, value in table(what, given, "a table").items():
        nested = dotted(what, value, f"{key}.") if isinstance(value, Mapping) else {key: value}
        for name, leaf in nested.items():
            if prefix + name in flat:
                raise InputError(f"{what} names {prefix}{name} twice.")
            flat[prefix + name] = leaf
    return flat


def table(what: str, value: Any, wanted: str) -> Mapping[str, Any]:
    """Return a table; ``wanted`` says what it is if it is none."""
    if not isinstance(value, Mapping):
        raise InputError(f"{what} is {value!r}, but must be {wanted}.")
    return value


def text(what: str, value: Any) -> str:
    """Return a text that is not empty."""
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{what} is {value!r}, but must be text.")
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
