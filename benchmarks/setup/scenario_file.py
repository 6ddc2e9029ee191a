"""From a TOML file to a ``Scenario``; docs/scenarios.md has the table of its keys."""

from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

from benchmarks.setup import documents
from benchmarks.setup.scenario import Scenario
from benchmarks.setup.thresholds import Thresholds
from benchmarks.setup.world_files import beside, file_digest, files_of
from deqmcl_gym.validation import part
from localizers.naming.digests import content_digest

_KEYS = ("words", "base", "env", "assumed", "prior", "agent", "buildings", "thresholds")


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
        world = beside(path.parent, documents.dotted("env", given.get("env", {})))
        changed = base.changed(
            world=world,
            assumed=assumed | {f"prior.{key}": value for key, value in prior.items()},
        )
        files = "".join(map(file_digest, files_of(world)))
        return replace(
            changed,
            words=documents.text("words", given.get("words", path.stem)),
            agent=documents.text("agent", given.get("agent", base.agent)),
            buildings=given.get("buildings", base.buildings),
            thresholds=part("thresholds", Thresholds, given.get("thresholds"), changed.thresholds),
            source=sha256(f"{base.source}{content_digest(path)}{files}".encode()).hexdigest(),
        )
