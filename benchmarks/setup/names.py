"""Scenarios and agents by name: built-in, ``room.toml``, ``file.py:NAME`` or ``module:NAME``.

docs/scenarios.md has the table of a scenario file's keys.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path

from benchmarks.agents import AGENTS
from benchmarks.scenarios import SCENARIOS
from benchmarks.setup import changes
from benchmarks.setup.changes import Changes, file_digest, from_folder
from benchmarks.setup.scenario import Agent, Scenario, Thresholds
from deqmcl_gym.validation import InputError, one_of, part
from localizers import RobotModel, absolute_name
from localizers.naming.digests import content_digest
from localizers.naming.plugins import is_ctrl_c, is_reference, load, raised, reference_digest

_KEYS = ("words", "base", "env", "assumed", "prior", "agent", "buildings", "thresholds")
_OF_LOGS = ("log", "replay")  # loaded when asked for: a trial in a room needs no readers of logs
_DEEPEST = 8  # files, each the base of the next
_VERBS = ("plan_at_reset", "act")


def scenario_names() -> tuple[str, ...]:
    """Names of the built-in scenarios."""
    return (*SCENARIOS, *_OF_LOGS)


def absolute_scenario(name: str, folder: Path = Path()) -> str:
    """Return a name by which a process in any other folder finds the same scenario.

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
    return _scenario(absolute_scenario(name), ())


def make_agent(name: str, robot: RobotModel) -> Agent:
    """Return the agent of a name, made for a robot.

    Raises:
        InputError: there is none, it cannot be made, or it is no agent.
    """
    _check("agent", name, AGENTS, "file.py:NAME")
    factory = load(absolute_name(name), name, "agent") if is_reference(name) else AGENTS[name]
    try:
        made = factory(robot) if callable(factory) else factory
        lacking = [verb for verb in _VERBS if not callable(getattr(made, verb, None))]
    except BaseException as error:  # whatever a plug-in raises
        if is_ctrl_c(error):
            raise
        file = absolute_name(name).rpartition(":")[0]
        raise InputError(
            f"the agent {name!r} cannot be made: its own code raised {raised(error, file)}."
        ) from error
    if lacking:
        raise InputError(
            f"the agent {name!r} is of type {type(made).__name__}, without "
            f"{' and '.join(lacking)}: an agent is made by NAME(robot) and has "
            "plan_at_reset(info) and act(belief, info)."
        )
    return made


@cache
def plug_ins_of(name: str) -> tuple[str, ...]:
    """Return the plug-ins that a scenario leads to: itself, its bases, its agent.

    Nothing is run to find out, a file is read once: one in Python stands for what it names, too.

    Raises:
        InputError: a file cannot be read.
    """
    found: dict[str, None] = {}
    seen: set[str] = set()
    waiting = [absolute_scenario(name)]
    while waiting:
        other = waiting.pop()
        if is_reference(other):
            found[other] = None
        elif other.endswith(".toml") and other not in seen:
            seen.add(other)
            given = changes.read(Path(other), "scenario")
            named = [given[key] for key in ("base", "agent") if isinstance(given.get(key), str)]
            waiting += [_absolute(each, Path(other).parent) for each in named]
    return tuple(found)


def scenario_digest(name: str) -> str:
    """Return a digest of the files that a scenario is read from, its agent's too; "" if built-in.

    Raises:
        InputError: as ``scenario``.
    """
    found = scenario(name)
    agent = reference_digest(found.agent) if is_reference(found.agent) else None
    return found.source + (agent or "")


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
    return replace(found, agent=_absolute(found.agent, folder))


def _read(path: Path, within: tuple[str, ...]) -> Scenario:
    """Read a scenario file; ``within`` are the files that it is a base of, and itself."""
    given = changes.read(path, "scenario")
    with changes.errors_name(path):
        changes.check(given, _KEYS)
        named = absolute_scenario(changes.text("base", given.get("base", "paper")), path.parent)
        base = _scenario(named, within)
        prior = Changes.told("prior", {"prior": given.get("prior", {})})
        assumed = Changes.told("assumed", given.get("assumed", {})) | prior
        world = Changes.told("env", given.get("env", {})).beside(path.parent)
        changed = base.changed(world, assumed)
        own = [base.source, str(content_digest(path)), *map(file_digest, world.files)]
        return replace(
            changed,
            words=changes.text("words", given.get("words", path.stem)),
            agent=changes.text("agent", given.get("agent", base.agent)),
            buildings=given.get("buildings", base.buildings),
            thresholds=part("thresholds", Thresholds, given.get("thresholds"), changed.thresholds),
            source=sha256("".join(own).encode()).hexdigest(),
        )


def _absolute(name: str, folder: Path) -> str:
    """Make the path in a name absolute, from ``folder``; ~ is the home folder."""
    path, colon, attribute = (name, "", "") if name.endswith(".toml") else name.rpartition(":")
    if not path.endswith((".toml", ".py")):
        return name
    return from_folder(folder, path) + colon + attribute
