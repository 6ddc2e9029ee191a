"""Scenarios and agents by name: built-in, ``room.toml``, ``file.py:NAME`` or ``module:NAME``."""

import importlib
import os
import pkgutil
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmarks.setup.agent import Agent
from benchmarks.setup.scenario import Scenario
from benchmarks.setup.scenario_file import read_scenario
from deqmcl_gym.validation import InputError, one_of
from localizers import RobotModel, absolute_name
from localizers.naming.plugins import is_reference, load, reference_digest


@dataclass(frozen=True)
class _Folder:
    """A package that holds one built-in thing per file, by the name of the file."""

    kind: str
    package: str
    attribute: str
    own: str  # how one's own is named

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


def scenario_names() -> tuple[str, ...]:
    """Names of the built-in scenarios."""
    return _SCENARIOS.names


def agent_names() -> tuple[str, ...]:
    """Names of the built-in agents."""
    return _AGENTS.names


def agent_words(name: str) -> str:
    """Return what a built-in agent does, in a line: the first of its file."""
    return str(_AGENTS.module(name).__doc__).partition("\n")[0]


def absolute_scenario(name: str) -> str:
    """Return a name by which a process in any other folder finds the same scenario.

    Raises:
        InputError: it is neither built-in nor says where the scenario is.
    """
    _SCENARIOS.check(name)
    return _absolute(name, Path())


def scenario(name: str) -> Scenario:
    """Return the scenario of a name.

    Raises:
        InputError: there is none, or its file cannot be read or is refused.
    """
    return _scenario(absolute_scenario(name), ())


def make_agent(name: str, robot: RobotModel) -> Agent:
    """Return the agent of a name, made for a robot.

    Raises:
        InputError: there is none, or it cannot act.
    """
    factory = _AGENTS.get(name)
    made = factory(robot) if callable(factory) else factory
    if not callable(getattr(made, "act", None)):
        raise InputError(
            f"the agent {name!r} must be called as NAME(robot) and have act(belief, info), but "
            f"{made!r} has none."
        )
    return made  # type: ignore[no-any-return]


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
            raise InputError(f"the scenario {name!r} is {found!r}, but must be a Scenario.")
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
