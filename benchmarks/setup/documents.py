"""TOML of users: documents, values, text; what is refused is named with file and key."""

import io
import json
import math
import os
import tomllib
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from hashlib import sha256
from pathlib import Path
from typing import Any

from deqmcl_gym.files import UnreadableError, content_of, refusing, yaml_of
from deqmcl_gym.validation import InputError, one_of, shown
from localizers.digests import content_digest
from localizers.kinds import Placed

_ROOT: ContextVar[Path | None] = ContextVar("folder of the sweep file that is read", default=None)
_LARGEST = 1e100  # magnitude of a number: charts take no larger ones


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """Return the document in the file of a ``what``: UTF-8, with or without a byte order mark."""
    named = f"the {what} file {path}"
    with refusing(named):
        content = content_of(path)
    try:
        return tomllib.loads(io.StringIO(content.decode("utf-8-sig"), newline=None).read())
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        where = f"byte 0x{content[error.start]:02x} in line {line}"
        raise InputError(f"{named} is not UTF-8 ({where}): save it as UTF-8.") from None
    except (RecursionError, ValueError) as error:  # or a number of thousands of digits
        why = "its values are nested too deeply" if isinstance(error, RecursionError) else error
        raise InputError(f"{named} is not valid TOML: {why}.") from None


@contextmanager
def errors_name(path: Path | None) -> Iterator[None]:
    """Let what is refused in here name the file, if there is one."""
    try:
        yield
    except RecursionError:
        raise InputError(f"{path}: its values are nested too deeply.") from None
    except InputError as error:
        raise InputError(f"{path}: {error}" if path else str(error)) from None


def check_values(given: Mapping[str, Any], keys: Sequence[str]) -> None:
    """Refuse an unknown key, and values that cannot name a result: NaN and dates."""
    for key in given:
        one_of("key", key, keys)
    _check_value(given, "")


def as_table(what: str, value: Any, wanted: str) -> Mapping[str, Any]:
    """Return a table; else say that it must be what is ``wanted``."""
    if not isinstance(value, Mapping):
        raise InputError(f"{what} is {value!r}, but must be {wanted}.")
    return value


def as_text(what: str, value: Any) -> str:
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


@contextmanager
def said_from(root: Path) -> Iterator[None]:
    """Let paths that are relative to some folder be ``Placed``, named from this one."""
    token = _ROOT.set(Path(os.path.abspath(root)))
    try:
        yield
    finally:
        _ROOT.reset(token)


def from_folder(folder: Path, path: str) -> str:
    """Return a path from a folder as an absolute one; ~ is the home folder."""
    if isinstance(path, Placed):
        return path
    whole, root = os.path.abspath(folder / os.path.expanduser(path)), _ROOT.get()
    if root is None or os.path.isabs(os.path.expanduser(path)):
        return whole
    return Placed(Path(os.path.relpath(whole, root)).as_posix(), whole)


def digest_of_file(path: str) -> str:
    """Digest of a file of a world; that of a map covers its image, that of a folder all its files.

    A missing file has one, too: what reads the file reports it.
    """
    digest = sha256()
    for part in _parts(Path(path.place if isinstance(path, Placed) else path)):
        digest.update(f"{part.name}\0{content_digest(part)}\0".encode(errors="surrogateescape"))
    return digest.hexdigest()


def _parts(path: Path) -> list[Path]:
    if os.path.isdir(path):  # a bag of ROS 2, whose files stand side by side
        files = path.glob("*") if (path / "metadata.yaml").is_file() else ()
        return sorted(part for part in files if part.is_file())
    if path.suffix.lower() not in (".yaml", ".yml"):
        return [path]
    try:
        document = yaml_of(content_of(path))
        image = document.get("image") if isinstance(document, dict) else None
    except (FileNotFoundError, UnreadableError):  # whoever loads the map says so
        image = None
    return [path, path.parent / image] if isinstance(image, str) else [path]


def settings(words: Iterable[str]) -> dict[str, Any]:
    """Return the values by dotted name of ``NAME=VALUE`` words, as ``--set`` has them."""
    values: dict[str, Any] = {}
    for word in words:
        name, _, text = map(str.strip, word.partition("="))
        if not (name and text):
            usual = "NAME=VALUE, as params.mcl.particles=500"
            raise InputError(f"--set has {word!r}, but must be {usual}.")
        if name in values:
            raise InputError(f"--set gives {name} twice: give it once.")
        values[name] = parsed(f"--set {name}", text)
    return values


def parsed(what: str, text: str) -> Any:
    """Return a value as TOML has it; quotes around text and brackets around a list may be left out.

    Refusals say ``what`` it is of.
    """
    value: Any = text.strip()
    for toml in (value, f"[{value}]") if "," in value else (value,):
        try:
            value = tomllib.loads(f"value = {toml}")["value"]
            break
        except ValueError:
            continue
    if isinstance(value, str) and value.startswith("[") and value.endswith("]"):  # [a, b]: words
        value = [parsed(what, item) for item in value[1:-1].split(",")]
    check_values({what: value}, [what])
    return value


def sweep_text(
    notes: Iterable[str], top: Mapping[str, Any], tables: Mapping[str, Mapping[str, Any]]
) -> str:
    """Return a sweep file: comments, values before all tables, and tables by name."""
    unknown = "\N{REPLACEMENT CHARACTER}"
    lines = ["# " + "".join(c if c.isprintable() else unknown for c in note) for note in notes]
    for name, table in {"": top, **tables}.items():
        lines += ["", f"[{name}]"] if name else []
        lines += [f"{key} = {_toml(value)}" for key, value in table.items()]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{name} = {_toml(inner)}' for name, inner in value.items())}}}"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value, ensure_ascii=False)
