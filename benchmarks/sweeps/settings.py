"""Settings as text: ``name=value`` words of a command, and the lines of a sweep file."""

import json
import math
import re
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from benchmarks.setup import documents
from deqmcl_gym.validation import InputError

_NEXT = re.compile(r",(?![^{]*\})(?=[^,=\[\]]*=|\s*$)")  # between two settings, not in a value


def value_of(what: str, text: str) -> Any:
    """Return a value as TOML has it; quotes around text and brackets around a list may be left out.

    Args:
        what: it is of, for refusals.
        text: of the value.
    """
    value: Any = text.strip()
    for toml in (value, f"[{value}]") if "," in value else (value,):
        try:
            value = tomllib.loads(f"value = {toml}")["value"]
            break
        except ValueError:
            continue
    documents.check_values({what: value}, [what])
    return value


def settings(
    option: str, words: Iterable[str], form: str, often: Collection[str] = ()
) -> dict[str, Any]:
    """Return the values by name of "name=value" words, several in one with commas between.

    Args:
        option: that has the words.
        words: in their order.
        form: of one of them, for readers.
        often: names that may be given more than once: their values make a list.
    """
    found: dict[str, Any] = {}
    for word in (one.strip() for whole in words for one in _NEXT.split(whole)):
        name, equals, text = map(str.strip, word.partition("="))
        if not word:
            continue
        if not (name and equals and text):
            raise InputError(f"{option} has {word!r}, but must be {form}.")
        value = value_of(f"{option} {name}", text)
        if name not in found:
            found[name] = value
        elif name in often:
            before = found[name] if isinstance(found[name], list) else [found[name]]
            found[name] = [*before, value]
        else:
            raise InputError(f"{option} gives {name} twice: give it once.")
    return found


def sweep_text(
    notes: Iterable[str], top: Mapping[str, Any], tables: Mapping[str, Mapping[str, Any]]
) -> str:
    """Return a sweep file: comments, values before all tables, and tables by name.

    A table whose name has brackets, as "[localizers]", is one of a list; a line of a table that is
    None is its name as a comment.
    """
    lines = [f"# {_printable(note)}" for note in notes]
    lines += _lines(top)
    for name, own in tables.items():
        lines += ["", f"[{name}]", *_lines(own)]
    return "\n".join(lines) + "\n"


def _lines(table: Mapping[str, Any]) -> Iterator[str]:
    for name, value in table.items():
        yield f"# {name}" if value is None else f"{name} = {_toml(value)}"


def _toml(value: Any) -> str:
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value, ensure_ascii=False)


def _printable(words: str) -> str:
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in words)
