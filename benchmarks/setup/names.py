"""Scenarios and agents by name: built-in, ``room.toml``, ``file.py:NAME`` or ``module:NAME``."""

import importlib
import os
import pkgutil
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmarks.setup import documents
from benchmarks.setup.agent import Agent
from benchmarks.setup.scenario import Scenario
from benchmarks.setup.scenario_file import read_scenario
from deqmcl_gym.validation import InputError, one_of
from localizers import RobotModel, absolute_name
from localizers.naming.isolation import is_ctrl_c
from localizers.naming.plugins import is_reference, load, raised, reference_digest


@dataclass(frozen=True)
class _Folder:
    """A package that holds one built-in thing per file, by the name of the file."""

    kind: str
    package: str
    attribute: str
    own: str  # how users name their own

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its files, with - for _."""
        folder = importlib.import_module(self.package).__path__
        return tuple(found.name.replace("_", "-") for found in pkgutil.iter_modules(folder))

    def check(self, name: str) -> None:
        """Refuse a name that is neither built-in nor says where else to look."""
        file = self.kind == "scenario" and str(name).endswith(".toml")
        if isinstance(name, str) and (file or is_reference(name)):
            return
        try:
            one_of(self.kind, name, self.names)
        except InputError as error:
            raise InputError(f"{str(error).rstrip('.')}, or your own as {self.own}.") from None

    def get(self, name: str) -> Any:
        """Return what has a name."""
        self.check(name)
        if is_reference(name):
            return load(absolute_name(name), name, self.kind)
        return getattr(self.module(name), self.attribute)

    def module(self, name: str) -> ModuleType:
        """Return the file of a built-in name."""
        return importlib.import_module(f"{self.package}.{name.replace('-', '_')}")


_SCENARIOS = _Folder("scenario", "benchmarks.scenarios", "SCENARIO", "room.toml or file.py:NAME")
_AGENTS = _Folder("agent", "benchmarks.agents", "AGENT", "file.py:NAME")
_VERBS = ("plan_at_reset", "act")


def scenario_names() -> tuple[str, ...]:
    """Names of the built-in scenarios."""
    return _SCENARIOS.names


def agent_names() -> tuple[str, ...]:
    """Names of the built-in agents."""
    return _AGENTS.names


def agent_words(name: str) -> str:
    """Return what a built-in agent does, in a line: the first of its file."""
    return str(_AGENTS.module(name).__doc__).partition("\n")[0]


def absolute_scenario(name: str, folder: Path = Path()) -> str:
    """Return a name by which a process in any other folder finds the same scenario.

    Args:
        name: of it.
        folder: that a path in the name is relative to.

    Raises:
        InputError: it is neither built-in nor says where the scenario is.
    """
    _SCENARIOS.check(name)
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
    factory = _AGENTS.get(name)
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
    return made  # type: ignore[no-any-return]


def plug_ins_of(name: str) -> tuple[str, ...]:
    """Return the plug-ins that a scenario leads to: itself, its bases, its agent.

    Nothing is run to find out: one in Python stands for what it names, too.

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
            given = documents.read(Path(other), "scenario")
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


def _scenario(name: str, within: tuple[str, ...]) -> Scenario:
    """Return the scenario of an absolute name that stands ``within`` files."""
    if name in within:
        raise InputError(f"the scenario {name} is its own base: name another base.")

    def named(other: str, path: Path) -> Scenario:
        return _scenario(_absolute(other, path.parent), (*within, name))

    if name.endswith(".toml"):
        found, folder = read_scenario(Path(name), named), Path(name).parent
    else:
        found = _SCENARIOS.get(name)
        if not isinstance(found, Scenario):
            kind = type(found).__name__
            raise InputError(f"the scenario {name!r} is of type {kind}, but must be a Scenario.")
        folder = Path(name.rpartition(":")[0]).parent
    if is_reference(name):
        found = replace(found, source=reference_digest(name) or "")
    return replace(found, agent=_absolute(found.agent, folder))


def _absolute(name: str, folder: Path) -> str:
    """Make the path in a name absolute, from ``folder``; ~ is the home folder."""
    path, colon, attribute = (name, "", "") if name.endswith(".toml") else name.rpartition(":")
    if not path.endswith((".toml", ".py")):
        return name
    return os.path.abspath(folder / Path(path).expanduser()) + colon + attribute
