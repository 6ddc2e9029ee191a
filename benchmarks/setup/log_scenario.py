"""LogScenario: segments of a recorded log as worlds."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from inspect import signature
from typing import Any, Self

from benchmarks.setup.changes import NOTHING, Changes, file_digest
from benchmarks.setup.motion_noise import motion_noise
from benchmarks.setup.scenario import Gaussian, Scenario, TrialEnv
from benchmarks.setup.thresholds import Thresholds
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.logs import Log
from deqmcl_gym.maps import Map
from deqmcl_gym.validation import InputError
from localizers import GaussianUniform, RobotModel
from localizers.models.nav2_motion import MotionModel, kind_of, unknown_motion

# arguments of the env that are not a scenario's to give
_OURS = ("on_mismatch", "render_mode", "others")
_ARGUMENTS = tuple(name for name in signature(LogEnv).parameters if name not in _OURS)
_EPISODES = ("segment", "plan", "horizon")  # of them, what may differ between envs of one log


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
        return self._recording()[0].unit if {"log", "map"} <= self.env.keys() else "m"

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
        log, floor_plan = self._recording()
        if not log.referenced.size:
            raise InputError(f"{log.source} has no reference to score by: name one as reference.")
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
        return replace(robot, motion=self.motion_of(self._recording()[0]))

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

    @property
    def known(self) -> Mapping[str, Any]:
        """The noise that the log shows."""
        shown = _noise(self._recording()[0], kind_of(self.motion))
        return {f"motion.{name}": value for name, value in vars(shown).items()}

    def _env_with(self, values: Changes) -> Mapping[str, Any]:
        return {**self.env, **values.by_part(_ARGUMENTS, "part of a log's world")}

    def _recording(self) -> tuple[Log, Map]:
        for name in ("log", "map"):
            if name not in self.env:
                raise InputError(
                    f"the scenario names no {name}: write {name} = … in [env] of a scenario file "
                    'with base = "log", or in [world] of a sweep file.'
                )
        digests = "".join(map(file_digest, Changes(self.env).files))
        played = {name: value for name, value in self.env.items() if name not in _EPISODES}
        return _read(Changes(played), digests)


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


@lru_cache(maxsize=4)
def _read(arguments: Changes, digests: str) -> tuple[Log, Map]:
    """Return the records that are played and their map, read once for all trials of a process."""
    del digests  # a file that was changed is read again
    env = LogEnv(**_arguments(arguments))
    return env.log, env.floor_plan


@lru_cache(maxsize=4)
def _noise(log: Log, kind: str) -> MotionModel:
    return motion_noise(log, kind)


LOG = LogScenario(
    words="segments of a recorded log, named by log, map and reference in a file of your own",
    env={"segment": 50.0, "every": "0.2m,5deg", "max_beams": 60},
    motion=unknown_motion("differential", "m"),  # what is not given if some of it is
    scan=GaussianUniform(sigma=0.2),  # Nav2's sigma_hit
    prior=Gaussian(sd_position=0.2, sd_heading=0.1),
    thresholds=Thresholds(far=1.0, lost=1.0),
)
