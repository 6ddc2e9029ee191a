"""Settings as text: ``name=value`` words of a command, and the lines of a sweep file."""

import json
import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from benchmarks.setup import documents
from deqmcl_gym.validation import InputError


def settings(words: Iterable[str]) -> dict[str, Any]:
    """Return the values by dotted name of ``NAME=VALUE`` words, as ``--set`` has them."""
    values: dict[str, Any] = {}
    for word in words:
        name, equals, text = map(str.strip, word.partition("="))
        if not (name and equals and text):
            raise InputError(
                f"--set has {word!r}, but must be NAME=VALUE, as params.mcl.particles=500."
            )
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
    documents.check_values({what: value}, [what])
    return value


def sweep_text(
    notes: Iterable[str], top: Mapping[str, Any], tables: Mapping[str, Mapping[str, Any]]
) -> str:
    """Return a sweep file: comments, values before all tables, and tables by name.

    A table whose name has brackets, as "[localizers]", is one of a list.
    """
    lines = [f"# {_printable(note)}" for note in notes]
    lines += _lines(top)
    for name, own in tables.items():
        lines += ["", f"[{name}]", *_lines(own)]
    return "\n".join(lines) + "\n"


def _lines(table: Mapping[str, Any]) -> Iterator[str]:
    for name, value in table.items():
        yield f"{name} = {_toml(value)}"


def _toml(value: Any) -> str:
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{name} = {_toml(inner)}' for name, inner in value.items())}}}"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value, ensure_ascii=False)


def _printable(words: str) -> str:
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in words)
