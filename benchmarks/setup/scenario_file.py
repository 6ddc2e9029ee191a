"""From a TOML file to a ``Scenario``; docs/scenarios.md has the table of its keys."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from benchmarks.setup import documents
from benchmarks.setup.scenario import Scenario
from benchmarks.setup.thresholds import Thresholds
from deqmcl_gym.validation import part
from localizers.naming.digests import digest_of

_KEYS = ("words", "base", "env", "assumed", "prior", "agent", "buildings", "thresholds")
_MAP_FILES = ("floor_plan", "floor_plan.file")


def read_scenario(path: Path, named: Callable[[str, Path], Scenario]) -> Scenario:
    """Read a scenario file.

    Args:
        path: of the file.
        named: the scenario of a name that stands in a file.

    Raises:
        InputError: it cannot be read, is no TOML, or has an unknown key or a bad value.
    """
    given = documents.read(path, "scenario")
    with documents.errors_name(path):
        documents.check(given, _KEYS)
        base = named(documents.text("base", given.get("base", "paper")), path)
        prior = documents.dotted("prior", given.get("prior", {}))
        assumed = documents.dotted("assumed", given.get("assumed", {}))
        changed = base.changed(
            world=_beside(path, documents.dotted("env", given.get("env", {}))),
            assumed=assumed | {f"prior.{key}": value for key, value in prior.items()},
        )
        return replace(
            changed,
            words=documents.text("words", given.get("words", path.stem)),
            agent=documents.text("agent", given.get("agent", base.agent)),
            buildings=given.get("buildings", base.buildings),
            thresholds=part("thresholds", Thresholds, given.get("thresholds"), changed.thresholds),
            source=sha256(f"{base.source}{digest_of(path, _texts(given))}".encode()).hexdigest(),
        )


def _beside(path: Path, world: dict[str, Any]) -> dict[str, Any]:
    """Make the path of a map absolute, from the file's folder; ~ is the home folder."""
    names = {name for name in _MAP_FILES if isinstance(world.get(name), str)}
    files = {name: str(path.parent.absolute() / Path(world[name]).expanduser()) for name in names}
    return world | files


def _texts(value: Any) -> list[str]:
    """Return the texts in a document, which may name files, such as a map."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list):
        return [text for inner in value for text in _texts(inner)]
    return [value] if isinstance(value, str) else []
