"""Scenarios and agents by name: built in, ``room.toml``, or as localizers are named.

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
from benchmarks.setup.overrides import Named, Overrides, wrappers
from benchmarks.setup.scenario import RoomScenario, Scenario, Thresholds
from deqmcl_gym.validation import InputError, part
from deqmcl_gym.world.presets import WORLDS
from localizers import RobotModel, absolute_name
from localizers.digests import content_digest
from localizers.kinds import Kind, Placed, split_path
from localizers.registry import LOCALIZER, SCAN_MODEL, ScanPlugIn, is_code

# loaded when asked for: a trial in a room needs no readers of logs
_OF_LOGS = ("log", "log-short", "replay")
_TABLES = documents.read_toml(Path(__file__).with_name("scenarios.toml"), "scenario")
AGENT = Kind(
    word="agent",
    builtin=AGENTS,
    group="deqmcl.agents",
    call="NAME(robot, **params)",
    verbs=("plan_at_reset(info)", "act(belief, info)"),
)
SCENARIO = Kind(
    word="scenario",
    builtin=dict.fromkeys((*_TABLES, *_OF_LOGS)),
    group="deqmcl.scenarios",
    holds=Scenario,
    own="room.toml or file.py:NAME",
)
_KEYS = (
    *("words", "base", "env", "assumed", "prior"),
    *("agent", "disturbance", "buildings", "thresholds"),
)
_DEEPEST = 8  # files, each the base of the next
_SCAN = "scan.kind"


def scenario_names() -> tuple[str, ...]:
    """Names of the built-in scenarios."""
    return tuple(SCENARIO.builtin)


def absolute_reference(kind: Kind, name: str, folder: Path = Path()) -> str:
    """Return a name, its path from a folder, by which any process finds the same thing."""
    place, rest = split_path(name)
    if place and not isinstance(name, Placed):
        name = from_folder(folder, place) + rest
    return kind.complete(name)


def absolute_scenario(name: str, folder: Path = Path()) -> str:
    """Return the ``absolute_reference`` name of a scenario."""
    is_file = isinstance(name, str) and name.endswith(".toml")
    if not is_file and name not in SCENARIO.builtin:
        SCENARIO.reference(name)
    return absolute_reference(SCENARIO, name, folder)


def scenario(name: str) -> Scenario:
    """Return the scenario of a name; if that is a plug-in, its code is run."""
    return _scenario(absolute_name(absolute_scenario(name)), ())


def absolute_agent(agent: Named, folder: Path = Path()) -> Named:
    """Return an agent with an ``absolute_reference`` name."""
    return replace(agent, name=absolute_reference(AGENT, agent.name, folder))


def absolute_assumed(assumed: Overrides, folder: Path = Path()) -> Overrides:
    """Return what is assumed with the absolute names of a scan model, or of those varied."""

    def placed(kind: Any) -> Any:  # a scenario refuses what is none
        return absolute_reference(SCAN_MODEL, kind, folder) if is_code(kind) else kind

    if _SCAN not in assumed:
        return assumed
    kind = assumed[_SCAN]
    return assumed | {_SCAN: tuple(map(placed, kind)) if isinstance(kind, tuple) else placed(kind)}


def make_agent(agent: Named | str, robot: RobotModel) -> Agent:
    """Return the agent of a name and parameters, made for a robot."""
    named = Named(agent) if isinstance(agent, str) else agent
    made: Agent = AGENT.make(named.name, named.params, robot)
    return made


def plug_ins_of(found: Scenario) -> tuple[str, ...]:
    """Return the plug-ins that a scenario is made of: itself, its bases, its agent, its scans."""
    scan = (found.scan.kind,) if isinstance(found.scan, ScanPlugIn) else ()
    return (*found.code, *plug_ins_of_agent(found.agent), *scan)


def plug_ins_of_agent(agent: Named | None) -> tuple[str, ...]:
    """Return the name of an agent if its code is not ours."""
    return (agent.name,) if agent is not None and AGENT.is_plug_in(agent.name) else ()


def is_plug_in(localizer: str, agent: Named | None) -> bool:
    """Whether the code of a localizer, or of who drives, is not ours."""
    return LOCALIZER.is_plug_in(localizer) or bool(plug_ins_of_agent(agent))


def plug_ins_of_scan(assumed: Overrides) -> tuple[str, ...]:
    """Return the name of the scan model that is assumed, if its code is not ours."""
    kind = assumed.get(_SCAN, "")
    return (kind,) if is_code(kind) else ()


def scenario_digest(name: str) -> str:
    """Return a digest of the files of a scenario, its agent and scan model; "" if built-in."""
    found = scenario(name)
    scan = SCAN_MODEL.digest(found.scan.kind) if isinstance(found.scan, ScanPlugIn) else ""
    return found.source + AGENT.digest(found.agent.name) + scan


def _scenario(name: str, within: tuple[str, ...]) -> Scenario:
    """Return the scenario of an absolute name that stands ``within`` files."""
    if name in within:
        raise InputError(f"the scenario {name} is its own base: name another base.")
    if len(within) > _DEEPEST:
        raise InputError(f"more than {_DEEPEST} scenario files build on each other: use fewer.")
    if name in _TABLES:
        return _built_in(name)
    if name in _OF_LOGS:
        from benchmarks.setup.logs import LOGS

        return LOGS[name]
    path = Path(name)
    if name.endswith(".toml"):
        given = documents.read_toml(path, "scenario")
        with documents.errors_name(path):
            documents.check_values(given, _KEYS)
            base = documents.as_text("base", given.get("base", "paper"))
            below = _scenario(absolute_scenario(base, path.parent), (*within, name))
            return _changed(below, given, path, str(content_digest(path)))
    own: Scenario = SCENARIO.resolve(name)
    agent = absolute_agent(own.agent, Path(split_path(name)[0]).parent)
    return replace(own, agent=agent, source=SCENARIO.digest(name), code=(name,))


@cache
def _built_in(name: str) -> Scenario:
    """Return a scenario of scenarios.toml; without a base it is in the preset of its name."""
    table = _TABLES[name]
    if "base" in table:
        base = _built_in(table["base"])
    else:
        base = RoomScenario(words=name, world=WORLDS[name])
    return _changed(base, table, Path(name), "")


def _changed(base: Scenario, given: Mapping[str, Any], path: Path, digest: str) -> Scenario:
    """Return a scenario as a file, of this digest, changes it."""
    prior = Overrides.told("prior", {"prior": given.get("prior", {})})
    told = Overrides.told("assumed", given.get("assumed", {}))
    world = Overrides.told("env", given.get("env", {})).beside(path.parent)
    changed = base.changed(world, absolute_assumed(told, path.parent) | prior)
    digests = "".join([base.source, digest, *map(digest_of_file, world.files)])
    named = _agent(given.get("agent", {}), base.agent)
    return replace(
        changed,
        words=documents.as_text("words", given.get("words", path.stem)),
        agent=absolute_agent(named, path.parent),
        disturbance=wrappers("disturbance", given.get("disturbance", base.disturbance)),
        buildings=given.get("buildings", base.buildings),
        thresholds=part("thresholds", Thresholds, given.get("thresholds"), changed.thresholds),
        source=sha256(digests.encode()).hexdigest() if digests else "",
    )


def _agent(given: Any, base: Named) -> Named:
    """Return the agent that a scenario file says, as changes to that of its base."""
    if not isinstance(given, Mapping) or "name" in given:
        return Named.told("agent", given)
    own = Named.told("agent", {"name": base.name, **given})
    return Named(own.name, base.params | own.params)
