"""Recorded logs as worlds: segments of one, or the whole of it, run after run."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from inspect import signature
from typing import Any, Self

import numpy as np

from benchmarks.setup.motion_noise import motion_noise
from benchmarks.setup.scenario import NOTHING, Scenario, grouped
from benchmarks.setup.trial_env import TrialEnv
from benchmarks.setup.world_files import file_digest, files_of
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.envs.recorded import log_of
from deqmcl_gym.logs import Log
from deqmcl_gym.maps import Map
from deqmcl_gym.validation import InputError, integer
from localizers import RobotModel
from localizers.models.nav2_motion import MotionModel, kind_of

# arguments of the env that are not a scenario's to give
_OURS = ("on_mismatch", "render_mode", "others")
_ARGUMENTS = tuple(name for name in signature(LogEnv).parameters if name not in _OURS)
_EPISODES = ("segment", "plan", "horizon", "radius")  # of them: may differ between envs of one log
_READ = ("log", "reference", "reading")  # of them: what the records are read from


@dataclass(frozen=True, kw_only=True)
class LogScenario(Scenario):
    """Segments of a recorded log: each trial's seed draws where its own begins.

    Attributes:
        env: arguments of ``LogEnv``; "none" is None, where the env takes it.
        estimated: whether the motion's noise is that of the log's odometry against its reference,
            instead of ``motion``.
    """

    estimated: bool = True

    @property
    def unit(self) -> str:
        """Of all lengths."""
        return self.recording()[0].unit if {"log", "map"} <= self.env.keys() else "m"

    @property
    def has_goal(self) -> bool:
        """False: a log goes where it went."""
        return False

    def room(self) -> LogEnv:
        """Return the log as an env.

        Raises:
            InputError: no log or map is named, it cannot be read, has no reference or leaves the
                map, or an agent is to drive it.
        """
        log, floor_plan = self.recording()
        self._check(log)
        check_inside(log, floor_plan)
        given = {name: value for name, value in _arguments(self.env).items() if name in _EPISODES}
        shown = given.get("plan", "odometry")
        if shown != "odometry" and self.agent != "open-loop":
            raise InputError(
                f"the agent is {self.agent!r} and plan is {shown!r}, but an agent other than "
                'open-loop needs the recorded actions: leave it out, or write plan = "odometry".'
            )
        mismatch = "error" if shown == "odometry" else "ignore"
        return LogEnv(log=log, map=floor_plan, on_mismatch=mismatch, **given)

    def robot_model(self, room: TrialEnv) -> RobotModel:
        """Return what localizers and agents are made for."""
        robot = super().robot_model(room)
        return replace(robot, motion=self.motion_of(self.recording()[0]))

    def motion_of(self, log: Log) -> MotionModel:
        """Return the motion that the filters assume."""
        return _noise(log, kind_of(self.motion)) if self.estimated else self.motion

    def changed(
        self, world: Mapping[str, Any] = NOTHING, assumed: Mapping[str, Any] = NOTHING
    ) -> Self:
        """Return this scenario with some values changed; noise that is given is not estimated."""
        found = super().changed(world, assumed)
        given = any(name.startswith("motion.") and name != "motion.kind" for name in assumed)
        return replace(found, estimated=found.estimated and not given)

    def recording(self) -> tuple[Log, Map]:
        """Return the records that are played and their map.

        Raises:
            InputError: no log or map is named, or one of them cannot be read.
        """
        played = {name: value for name, value in self._named().items() if name not in _EPISODES}
        return _played(_key(played), self._digests)

    @property
    def whole(self) -> Log:
        """The log as it was read, with all records and beams."""
        named = self._named()
        return _whole(_key({name: named[name] for name in _READ if name in named}), self._digests)

    def _check(self, log: Log) -> None:
        if not log.referenced.size:
            raise InputError(f"{log.source} has no reference to score by: name one as reference.")

    def _env_with(self, values: Mapping[str, Any]) -> Mapping[str, Any]:
        return {**self.env, **grouped(values, _ARGUMENTS, "part of a log's world")}

    def _named(self) -> Mapping[str, Any]:
        """Return the arguments of the env, the log and the map among them."""
        for name in ("log", "map"):
            if name not in self.env:
                raise InputError(
                    f"the scenario names no {name}: write {name} = … in [env] of a scenario file "
                    'with base = "log", or in [world] of a sweep file.'
                )
        return self.env

    @property
    def _digests(self) -> str:
        return "".join(map(file_digest, files_of(self.env)))


@dataclass(frozen=True, kw_only=True)
class ReplayScenario(LogScenario):
    """A whole log, with a reference or without: its worlds are runs of the localizers on it.

    Attributes:
        judged: first record by which beliefs are judged; what is before it was fitted on.
    """

    judged: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        integer("judged", self.judged)

    def filter_rng(self, trial: Any) -> np.random.Generator:
        """Return the stream of a run: the same for every localizer."""
        key = (trial.trial, trial.filter_seed) if trial.filter_seed else (trial.trial,)
        return np.random.default_rng(np.random.SeedSequence(trial.seed, spawn_key=key))

    def changed(
        self, world: Mapping[str, Any] = NOTHING, assumed: Mapping[str, Any] = NOTHING
    ) -> Self:
        """Return this scenario with some values changed; ``judged`` is one of the world."""
        others = {name: value for name, value in world.items() if name != "judged"}
        return replace(super().changed(others, assumed), judged=world.get("judged", self.judged))

    def _check(self, log: Log) -> None:
        """Take any log: without a reference, scans are compared with the map."""


def check_inside(log: Log, floor_plan: Map) -> None:
    """Refuse a map that the log leaves, as far as that is known."""
    if log.reference is None:
        return
    x0, y0, x1, y1 = floor_plan.bounds
    x, y = log.reference[log.referenced, :2].T
    outside = (x < x0) | (x > x1) | (y < y0) | (y > y1)
    if outside.any():
        first = log.referenced[outside.argmax()]
        raise InputError(
            f"the reference leaves the map at {log.times[first]:.2f} s, at ({x[outside][0]:.2f}, "
            f"{y[outside][0]:.2f}), and is outside at {int(outside.sum()):,} of {outside.size:,} "
            f"records, but the map reaches from ({x0:.2f}, {y0:.2f}) to ({x1:.2f}, {y1:.2f}): give "
            "the map of this log, and the reference in its frame."
        )


def _arguments(env: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments as the env takes them: TOML has no None, and "none" is a plan's name."""
    return {
        name: None if value == "none" and name != "plan" else value for name, value in env.items()
    }


def _key(arguments: Mapping[str, Any]) -> str:
    return json.dumps(arguments, sort_keys=True, default=list)


@lru_cache(maxsize=4)
def _whole(arguments: str, digests: str) -> Log:
    """Return all records of a log, read once for all trials of a process."""
    del digests  # a file that was changed is read again
    given = _arguments(json.loads(arguments))
    return log_of(given["log"], given.get("reference"), given.get("reading"))


@lru_cache(maxsize=4)
def _played(arguments: str, digests: str) -> tuple[Log, Map]:
    """Return the records that are played and their map."""
    given = json.loads(arguments)
    whole = _whole(_key({name: given[name] for name in _READ if name in given}), digests)
    others = {name: value for name, value in given.items() if name not in _READ}
    env = LogEnv(log=whole, **_arguments(others))
    return env.log, env.floor_plan


@lru_cache(maxsize=4)
def _noise(log: Log, kind: str) -> MotionModel:
    return motion_noise(log, kind)
