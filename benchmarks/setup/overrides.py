"""Overrides: values by dotted name, as a trial changes its scenario or sets up its localizer."""

import json
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from benchmarks.setup.documents import as_table, as_text, from_folder
from deqmcl_gym.validation import InputError, integer, one_of, shown
from localizers.kinds import Placed

FILES = ("floor_plan", "floor_plan.file", "log", "map", "reference")  # names of a world's files
_WORDS = {"inf": math.inf, "-inf": -math.inf}  # JSON has no infinity; the text is "'inf"


class Overrides(dict[str, Any]):
    """A mapping by dotted name, such as ``{"lidar.beams": 9}``, in the order of names; not changed.

    Made of a mapping or pairs, of TOML by ``told``, by ``of_json`` of what ``json`` gave. Lists
    become tuples, tables ``Overrides``. Equal are those with the same JSON: 1, 1.0, True differ.
    """

    def __init__(self, values: Mapping[str, Any] | Iterable[tuple[str, Any]] = ()) -> None:
        items = dict(values)
        super().__init__({name: _frozen(items[name]) for name in sorted(items)})

    @classmethod
    def told(cls, what: str, given: Any) -> Self:
        """Return the nested tables of a TOML document as one."""
        flat: dict[str, Any] = {}
        for key, value in as_table(what, given, "a table").items():
            nested = isinstance(value, Mapping) and bool(value)  # {} is a value
            for name, leaf in cls.told(what, value).items() if nested else (("", value),):
                whole = f"{key}.{name}" if nested else key
                if whole in flat:
                    raise InputError(f"{what} names {whole} twice.")
                flat[whole] = leaf
        return cls(flat)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mapping):
            return NotImplemented
        return self.text == Overrides(other).text

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(self.text)

    @cached_property
    def text(self) -> str:
        """Names and values as JSON."""
        return spelt(self)

    def __or__(self, others: Mapping[str, Any]) -> Self:  # type: ignore[override]
        return type(self)({**self, **others})

    __ior__ = __or__  # type: ignore[assignment]  # not in place

    def json(self) -> dict[str, Any]:
        """Return JSON-able values, from which the same changes are made again."""
        return {name: jsonable(value) for name, value in self.items()}

    def by_part(self, parts: Collection[str], what: str) -> dict[str, Any]:
        """Return the value of each part (of a ``what``): nested dicts, or what is given whole."""
        tree: dict[str, Any] = {}
        by_key: dict[str, dict[str, Any]] = {}
        for name, value in self.items():
            part, _, key = name.partition(".")
            one_of(what, part, parts)
            (by_key.setdefault(part, {}) if key else tree)[key or part] = value
        for part, values in by_key.items():
            if part in tree:
                raise InputError(f"{part} is given whole and by key: give only one of them.")
            keys = {key.partition(".")[0] for key in values}
            tree[part] = type(self)(values).by_part(keys, f"key in {part}")
        return tree

    @property
    def files(self) -> list[str]:
        """Paths of the files of a world."""
        plan = self.get("floor_plan")
        named = [self[name] for name in FILES if name in self]
        named += [plan.get("file")] if isinstance(plan, Mapping) else []
        parts = [path for each in named for path in (each if isinstance(each, tuple) else [each])]
        return [str(p) if isinstance(p, Path) else p for p in parts if isinstance(p, str | Path)]

    def beside(self, folder: Path) -> Self:
        """Return a world's changes with the paths of files absolute, from a folder; ~ is home."""
        return self | {name: _absolute(folder, self[name]) for name in FILES if name in self}


def file_names(given: Any) -> str:
    """Return the name of a file without its folder, or those of the parts of a log."""
    return ", ".join(Path(part).name for part in (given if isinstance(given, tuple) else (given,)))


NOTHING = Overrides()


@dataclass(frozen=True)
class Named:
    """What is made by a name and parameters: a localizer, or an agent."""

    name: str
    params: Overrides = NOTHING

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise InputError(
                f"the name of a localizer or agent is {shown(self.name)}, but must be text: give "
                "file.py:NAME, or make a class a name by localizers.registered(name, factory)."
            )
        object.__setattr__(self, "params", Overrides(self.params))

    @classmethod
    def told(cls, what: str, given: Any) -> Self:
        """Return what a TOML document names: "name", or {name = …, params = {…}}."""
        if isinstance(given, str):
            return cls(as_text(what, given))
        table = as_table(what, given, "a name, or {name = …, params = {…}}")
        for key in table:
            one_of(f"key of {what}", key, ("name", "params"))
        if "name" not in table:
            raise InputError(f"{what} has no name: write {{name = …, params = {{…}}}}.")
        params = as_table(f"params of {what}", table.get("params", {}), "a table")
        return cls(as_text(f"name of {what}", table["name"]), Overrides(params))

    def __str__(self) -> str:
        return " ".join([self.name, *(f"{name}={value}" for name, value in self.params.items())])

    def json(self) -> dict[str, Any]:
        """Return it as JSON-able values."""
        return {"name": jsonable(self.name), "params": self.params.json()}


def _frozen(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return tuple(map(_frozen, value))
    if isinstance(value, Mapping):
        return value if isinstance(value, Overrides) else Overrides(value)
    return value


def jsonable(value: Any) -> Any:
    """Return a value of a trial as JSON has it: no tuples, and infinity as a word."""
    if isinstance(value, tuple):
        return list(map(jsonable, value))
    if isinstance(value, Overrides | Named):
        return value.json()
    if isinstance(value, str) and value.lstrip("'") in _WORDS:
        return f"'{value}"
    return str(value) if isinstance(value, float) and math.isinf(value) else value


def mapped(value: Any, change: Callable[[Any], Any]) -> Any:
    """Return a value with all in it changed that is neither a list nor a table."""
    if isinstance(value, list | tuple):
        return type(value)(mapped(inner, change) for inner in value)
    if isinstance(value, dict):
        return type(value)({name: mapped(inner, change) for name, inner in value.items()})
    return change(value)


def of_json(value: Any) -> Any:
    """Return the value of which ``jsonable`` has made this one, but for lists and dicts."""

    def read(leaf: Any) -> Any:
        is_word = isinstance(leaf, str) and leaf.lstrip("'") in _WORDS
        return _WORDS.get(leaf, leaf[1:]) if is_word else leaf

    return mapped(value, read)


def spelt(value: Any) -> str:
    """Return a value as JSON: what tells it apart, as 1, 1.0 and True are equal to Python."""
    return json.dumps(jsonable(value), sort_keys=True, default=repr)


def _absolute(folder: Path, value: Any) -> Any:
    if isinstance(value, tuple):  # of a [[vary]]
        return tuple(_absolute(folder, path) for path in value)
    if isinstance(value, Overrides):
        return value | {"file": _absolute(folder, value["file"])} if "file" in value else value
    return from_folder(folder, value) if isinstance(value, str) else value


def located(value: Any) -> Any:
    """Return a value of a trial with absolute paths in place of those that are said."""
    return mapped(value, lambda leaf: leaf.place if isinstance(leaf, Placed) else leaf)


def renamed(value: Any, names: Mapping[str, str]) -> Any:
    """Return JSON with other texts in place of those that are ``names``."""
    return mapped(value, lambda leaf: names.get(leaf, leaf) if isinstance(leaf, str) else leaf)


def wrappers(what: str, value: Any) -> tuple[Overrides, ...]:
    """Return disturbances, tables of a list, with repeated actions written out."""
    tables = []
    for entry in listed(what, value):
        wanted = "a table like {kind = 'kidnap', step = 100}"
        tables.append(dict(as_table(f"an entry of {what}", entry, wanted)))
        if isinstance(actions := tables[-1].get("actions"), list | tuple):
            tables[-1]["actions"] = [each for action in actions for each in _repeated(action)]
    return tuple(map(Overrides, tables))


def _repeated(action: Any) -> list[Any]:
    """Return [drive, turn, steps] as so many [drive, turn]."""
    if not isinstance(action, list | tuple) or len(action) != 3:
        return [action]
    return [action[:2]] * integer("steps of an action", action[2], low=1, high=100_000)


def listed(what: str, value: Any) -> Sequence[Any]:
    """Return a list."""
    if value is None:
        raise InputError(f"{what} is missing: write {what} = [ … ].")
    if not isinstance(value, list | tuple):
        hint = ": write [[vary]]" if what == "vary" else ""
        raise InputError(f"{what} is {value!r}, but must be a list{hint}.")
    return value
