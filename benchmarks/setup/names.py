"""Scenarios by name, built in or ``room.toml``, and agents, which are named as localizers are.

docs/sweeps.md has the table of a scenario file's keys; scenarios.toml has the built-in ones.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from benchmarks.agents import AGENTS
from benchmarks.setup import Agent, documents
from benchmarks.setup.documents import digest_of_file, from_folder
from benchmarks.setup.overrides import Named, Overrides, mapped, wrappers
from benchmarks.setup.scenario import RoomScenario, Scenario, Thresholds
from deqmcl_gym.validation import InputError, one_of, part
from deqmcl_gym.world import WORLDS
from localizers import RobotModel, absolute_name
from localizers.digests import content_digest
from localizers.kinds import Kind, Placed, is_path, split
from localizers.registry import LOCALIZER, SCAN_MODEL, ScanPlugIn

# loaded when asked for: a trial in a room needs no readers of logs
_OF_LOGS = ("log", "log-short", "replay")
_TABLES = documents.read_toml(Path(__file__).with_name("scenarios.toml"), "scenario")
AGENT = Kind(
    word="agent",
    builtin=AGENTS,
    group="deqmcl.agents",
    call="NAME(robot, **params)",
    verbs={"plan_at_reset": "info", "act": "belief, info"},
)
SCENARIOS = (*_TABLES, *_OF_LOGS)  # that are built in
_KEYS = (
    *("words", "base", "env", "assumed", "prior"),
    *("agent", "disturbance", "buildings", "thresholds"),
)


def absolute_reference(kind: Kind, name: str, folder: Path = Path()) -> str:
    """Return a name, its path from a folder, by which any process finds the same thing."""
    place, rest = split(name)
    if is_path(place) and not isinstance(name, Placed):
        name = from_folder(folder, place) + rest
    return kind.complete(name)


def absolute_scenario(name: str, folder: Path = Path()) -> str:
    """Return the name of a scenario, a file's with its path from a folder."""
    if isinstance(name, str) and name.endswith(".toml"):
        return from_folder(folder, name)
    return one_of("scenario", name, SCENARIOS, ", or your own as room.toml")


def scenario(name: str) -> Scenario:
    """Return the scenario of a name."""
    return _scenario(absolute_name(absolute_scenario(name)), ())


def absolute_agent(agent: Named, folder: Path = Path()) -> Named:
    """Return an agent with an ``absolute_reference`` name."""
    return replace(agent, name=absolute_reference(AGENT, agent.name, folder))


def absolute_assumed(assumed: Overrides, folder: Path = Path()) -> Overrides:
    """Return what is assumed with the absolute names of a scan model, or of those varied."""
    if "scan.kind" not in assumed:
        return assumed

    def placed(name: Any) -> Any:  # a scenario refuses what is none
        return absolute_reference(SCAN_MODEL, name, folder) if isinstance(name, str) else name

    return assumed | {"scan.kind": mapped(assumed["scan.kind"], placed)}


def make_agent(agent: Named | str, robot: RobotModel) -> Agent:
    """Return the agent of a name and parameters, made for a robot."""
    named = Named(agent) if isinstance(agent, str) else agent
    made: Agent = AGENT.make(named.name, named.params, robot)
    return made


def plug_ins_of(agent: Named | None, scan: object) -> tuple[str, ...]:
    """Return the names of an agent and of a kind of scan model whose code is not ours."""
    driver = (agent.name,) if agent is not None and AGENT.is_plug_in(agent.name) else ()
    return (*driver, scan) if isinstance(scan, str) and SCAN_MODEL.reference(scan) else driver


def is_plug_in(localizer: str, agent: Named | None) -> bool:
    """Whether the code of a localizer, or of who drives, is not ours."""
    return LOCALIZER.is_plug_in(localizer) or bool(plug_ins_of(agent, None))


def scenario_digest(name: str) -> str:
    """Return a digest of the files of a scenario, its agent and scan model; "" if built-in."""
    setup = scenario(name)
    scan = SCAN_MODEL.digest(setup.scan.kind) if isinstance(setup.scan, ScanPlugIn) else ""
    return setup.source + AGENT.digest(setup.agent.name) + scan


def _scenario(name: str, within: tuple[str, ...]) -> Scenario:
    """Return the scenario of an absolute name that stands ``within`` files."""
    if name in within:
        raise InputError(f"the scenario {name} is its own base: name another base.")
    if name in _TABLES:
        return _built_in(name)
    if name in _OF_LOGS:
        from benchmarks.setup.logs import LOGS

        return LOGS[name]
    path = Path(name)
    table = documents.read_toml(path, "scenario")
    with documents.errors_name(path):
        documents.check_values(table, _KEYS)
        base = documents.as_text("base", table.get("base", "paper"))
        below = _scenario(absolute_scenario(base, path.parent), (*within, name))
        return _changed(below, table, path, str(content_digest(path)))


@cache
def _built_in(name: str) -> Scenario:
    """Return a scenario of scenarios.toml; without a base it is in the preset of its name."""
    table = _TABLES[name]
    plain = "base" not in table
    base = RoomScenario(words=name, world=WORLDS[name]) if plain else _built_in(table["base"])
    return _changed(base, table, Path(name), "")


def _changed(base: Scenario, table: Mapping[str, Any], path: Path, digest: str) -> Scenario:
    """Return a scenario as a file, of this digest, changes it."""
    prior = Overrides.told("prior", {"prior": table.get("prior", {})})
    assumed = Overrides.told("assumed", table.get("assumed", {}))
    world = Overrides.told("env", table.get("env", {})).beside(path.parent)
    changed = base.changed(world, absolute_assumed(assumed, path.parent) | prior)
    digests = "".join([base.source, digest, *map(digest_of_file, world.files)])
    named = _agent(table.get("agent", {}), base.agent)
    return replace(
        changed,
        words=documents.as_text("words", table.get("words", path.stem)),
        agent=absolute_agent(named, path.parent),
        disturbance=wrappers("disturbance", table.get("disturbance", base.disturbance)),
        buildings=table.get("buildings", base.buildings),
        thresholds=part("thresholds", Thresholds, table.get("thresholds"), changed.thresholds),
        source=sha256(digests.encode()).hexdigest() if digests else "",
    )


def _agent(entry: Any, base: Named) -> Named:
    """Return the agent that a scenario file says, as changes to that of its base."""
    if not isinstance(entry, Mapping) or "name" in entry:
        return Named.told("agent", entry)
    changes = Named.told("agent", {"name": base.name, **entry})
    return Named(base.name, base.params | changes.params)
