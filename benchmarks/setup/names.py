"""Scenarios and agents by name: built-in, ``room.toml``, ``file.py:NAME`` or ``module:NAME``.

docs/scenarios.md has the table of a scenario file's keys.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from benchmarks.agents import AGENTS
from benchmarks.scenarios import SCENARIOS
from benchmarks.setup import changes
from benchmarks.setup.assumed import is_code
from benchmarks.setup.changes import Changes, Named, file_digest, from_folder
from benchmarks.setup.interfaces import Agent
from benchmarks.setup.scenario import Scenario, Thresholds
from deqmcl_gym.validation import InputError, one_of, part
from localizers import RobotModel, absolute_name
from localizers.naming.digests import content_digest
from localizers.naming.plugins import (
    Placed,
    is_ctrl_c,
    is_file,
    is_reference,
    load,
    raised,
    reference_digest,
)
from localizers.naming.registry import complete, installed, parameters_of
from localizers.naming.scans import ScanPlugIn, complete_scan

_KEYS = ("words", "base", "env", "assumed", "prior", "agent", "buildings", "thresholds")
_OF_LOGS = ("log", "replay")  # loaded when asked for: a trial in a room needs no readers of logs
_DEEPEST = 8  # files, each the base of the next
_VERBS = ("plan_at_reset", "act")
_SCAN = "scan.kind"
_AGENTS = "deqmcl.agents"  # group of entry points


def scenario_names() -> tuple[str, ...]:
    """Names of the built-in scenarios."""
    return (*SCENARIOS, *_OF_LOGS)


def absolute_scenario(name: str, folder: Path = Path()) -> str:
    """Return a name, or a ``Placed``, by which any process finds the same scenario.

    Args:
        name: of it.
        folder: that a path in the name is relative to.

    Raises:
        InputError: it is neither built-in nor says where the scenario is.
    """
    if not (isinstance(name, str) and name.endswith(".toml")):
        _check("scenario", name, scenario_names(), "room.toml or file.py:NAME")
    return _absolute(name, folder)


def scenario(name: str) -> Scenario:
    """Return the scenario of a name; if that is a plug-in, its code is run.

    Raises:
        InputError: there is none, or its file cannot be read or is refused.
    """
    return _scenario(absolute_name(absolute_scenario(name)), ())


def absolute_agent(agent: Named, folder: Path = Path()) -> Named:
    """Return an agent with a name by which any process finds it; ``file.py`` is its only agent.

    Args:
        agent: by name, with its parameters.
        folder: that a path in the name is relative to.

    Raises:
        InputError: the file holds no agent or several, or cannot be read.
    """
    name = agent.name
    if is_file(name):
        name = complete(from_folder(folder, name), "agent", _VERBS)
    return replace(agent, name=_absolute(name, folder))


def absolute_assumed(assumed: Changes, folder: Path = Path()) -> Changes:
    """Return what is assumed with the path of a scan model absolute, from a folder.

    Raises:
        InputError: its file holds no scan model or several, or cannot be read.
    """
    kind = assumed.get(_SCAN)
    if isinstance(kind, tuple):  # of a [[vary]]
        return assumed | {_SCAN: tuple(_absolute_scan(one, folder) for one in kind)}
    return assumed | {_SCAN: _absolute_scan(kind, folder)} if kind is not None else assumed


def _absolute_scan(kind: Any, folder: Path) -> Any:
    if not is_code(kind):
        return kind  # a scenario refuses what is none
    return complete_scan(from_folder(folder, kind)) if is_file(kind) else _absolute(kind, folder)


def agent_names() -> tuple[str, ...]:
    """Names of the agents that are built in or installed; none is loaded."""
    return tuple(dict.fromkeys((*AGENTS, *installed(_AGENTS))))


def agent_digest(name: str) -> str:
    """Return a digest of the source of an agent from elsewhere; "" for our own."""
    if name in AGENTS:
        return ""
    return reference_digest(installed(_AGENTS).get(name, name)) or ""


def make_agent(agent: Named | str, robot: RobotModel) -> Agent:
    """Return the agent of a name and parameters, made for a robot.

    Raises:
        InputError: there is none, it refuses its parameters, it cannot be made, or it is no agent.
    """
    agent = Named(agent) if isinstance(agent, str) else agent
    name = agent.name
    _check("agent", name, agent_names(), "file.py:NAME")
    reference = name if is_reference(name) else installed(_AGENTS).get(name, "")
    place = absolute_name(reference)
    factory = AGENTS[name] if name in AGENTS else load(place, name, "agent")
    known = parameters_of(factory) if callable(factory) else ()
    for param in agent.params:
        if known is not None:
            one_of(f"parameter of agent {name!r}", param, known)
    try:
        made = factory(robot, **agent.params) if callable(factory) else factory
        lacking = [verb for verb in _VERBS if not callable(getattr(made, verb, None))]
    except InputError:
        raise
    except BaseException as error:  # whatever a plug-in raises
        if is_ctrl_c(error):
            raise
        file = place.rpartition(":")[0]
        raise InputError(
            f"the agent {name!r} cannot be made: its own code raised {raised(error, file)}."
        ) from error
    if lacking:
        raise InputError(
            f"the agent {name!r} is of type {type(made).__name__}, without "
            f"{' and '.join(lacking)}: an agent is made by NAME(robot, **params) and has "
            "plan_at_reset(info) and act(belief, info)."
        )
    return made


def plug_ins_of(name: str) -> tuple[str, ...]:
    """Return the plug-ins that a scenario leads to: itself, its bases, its agent.

    Nothing is run to find out: a file in Python stands for what it names, too.

    Raises:
        InputError: a file cannot be read.
    """
    found: dict[str, None] = {}
    seen: set[str] = set()
    waiting = [absolute_name(absolute_scenario(name))]
    while waiting:
        other = waiting.pop()
        if is_reference(other):
            found[other] = None
        elif other.endswith(".toml") and other not in seen:
            seen.add(other)
            given, folder = changes.read(Path(other), "scenario"), Path(other).parent
            agent = given.get("agent")
            agent = agent.get("name") if isinstance(agent, Mapping) else agent
            if isinstance(agent, str):
                found |= dict.fromkeys(plug_ins_of_agent(absolute_agent(Named(agent), folder)))
            assumed = Changes.told("assumed", given.get("assumed", {}))
            found |= dict.fromkeys(plug_ins_of_scan(absolute_assumed(assumed, folder)))
            if isinstance(given.get("base"), str):
                waiting.append(_absolute(given["base"], folder))
    return tuple(found)


def plug_ins_of_agent(agent: Named | None) -> tuple[str, ...]:
    """Return the name of an agent if its code is not ours."""
    return (agent.name,) if agent is not None and agent.name not in AGENTS else ()


def plug_ins_of_scan(assumed: Changes) -> tuple[str, ...]:
    """Return the name of the scan model that is assumed, if its code is not ours."""
    kind = assumed.get(_SCAN, "")
    return (kind,) if is_code(kind) else ()


def scenario_digest(name: str) -> str:
    """Return a digest of the files of a scenario, its agent and scan model; "" if built-in.

    Raises:
        InputError: as ``scenario``.
    """
    found = scenario(name)
    scan = reference_digest(found.scan.kind) if isinstance(found.scan, ScanPlugIn) else None
    return found.source + agent_digest(found.agent.name) + (scan or "")


def _check(kind: str, name: str, built_in: Iterable[str], own: str) -> None:
    """Refuse a name that is neither built-in nor says where else to look."""
    if isinstance(name, str) and is_reference(name):
        return
    try:
        one_of(kind, name, built_in)
    except InputError as error:
        raise InputError(f"{str(error).rstrip('.')}, or your own as {own}.") from None


def _scenario(name: str, within: tuple[str, ...]) -> Scenario:
    """Return the scenario of an absolute name that stands ``within`` files."""
    if name in within:
        raise InputError(f"the scenario {name} is its own base: name another base.")
    if len(within) > _DEEPEST:
        raise InputError(f"more than {_DEEPEST} scenario files build on each other: use fewer.")
    if name.endswith(".toml"):
        found, folder = _read(Path(name), (*within, name)), Path(name).parent
    elif is_reference(name):
        found, folder = load(name, name, "scenario"), Path(name.rpartition(":")[0]).parent
        if not isinstance(found, Scenario):
            kind = type(found).__name__
            raise InputError(f"the scenario {name!r} is of type {kind}, but must be a Scenario.")
        found = replace(found, source=reference_digest(name) or "")
    elif name in _OF_LOGS:
        from benchmarks.setup.logs import LOG, REPLAY

        return LOG if name == "log" else REPLAY
    else:
        return SCENARIOS[name]
    return replace(found, agent=absolute_agent(found.agent, folder))


def _read(path: Path, within: tuple[str, ...]) -> Scenario:
    """Read a scenario file; ``within`` are the files that it is a base of, and itself."""
    given = changes.read(path, "scenario")
    with changes.errors_name(path):
        changes.check(given, _KEYS)
        named = absolute_scenario(changes.text("base", given.get("base", "paper")), path.parent)
        base = _scenario(named, within)
        prior = Changes.told("prior", {"prior": given.get("prior", {})})
        assumed = Changes.told("assumed", given.get("assumed", {}))
        assumed = absolute_assumed(assumed, path.parent) | prior
        world = Changes.told("env", given.get("env", {})).beside(path.parent)
        changed = base.changed(world, assumed)
        own = [base.source, str(content_digest(path)), *map(file_digest, world.files)]
        return replace(
            changed,
            words=changes.text("words", given.get("words", path.stem)),
            agent=_agent(given.get("agent", {}), base.agent),
            buildings=given.get("buildings", base.buildings),
            thresholds=part("thresholds", Thresholds, given.get("thresholds"), changed.thresholds),
            source=sha256("".join(own).encode()).hexdigest(),
        )


def _agent(given: Any, base: Named) -> Named:
    """Return the agent that a scenario file says, as changes to that of its base."""
    if not isinstance(given, Mapping) or "name" in given:
        return Named.told("agent", given)
    own = Named.told("agent", {"name": base.name, **given})
    return Named(own.name, base.params | own.params)


def _absolute(name: str, folder: Path) -> str:
    """Make the path in a name absolute, from ``folder``; ~ is the home folder."""
    if isinstance(name, Placed):
        return name
    path, colon, attribute = (name, "", "") if name.endswith(".toml") else name.rpartition(":")
    if not path.endswith((".toml", ".py")):
        return name
    return from_folder(folder, path) + colon + attribute
