"""Recorded logs as worlds: segments of one, or the whole of it; the noise of their odometry."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from inspect import signature
from typing import Any, Self

import numpy as np

from benchmarks.setup import TrialEnv
from benchmarks.setup.documents import digest_of_file
from benchmarks.setup.overrides import NOTHING, Overrides
from benchmarks.setup.priors import Gaussian
from benchmarks.setup.scenario import Scenario, Thresholds
from deqmcl_gym.envs.log import LogEnv, log_of
from deqmcl_gym.logs import Log
from deqmcl_gym.logs.motion import increments_of, lengths_of
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics import Floats, Indices, arrays
from deqmcl_gym.validation import InputError, integer
from localizers import GaussianUniform, RobotModel
from localizers.models.motion import LEAST_STEPS
from localizers.models.nav2_motion import MotionModel, kind_of, unknown_motion
from localizers.models.scan import METRE_SIGMA

# arguments of the env that are not a scenario's to give
_OURS = ("on_mismatch", "render_mode", "others")
_ARGUMENTS = tuple(name for name in signature(LogEnv).parameters if name not in _OURS)
_EPISODES = ("segment", "plan", "horizon", "radius")  # of them: may differ between envs of one log
_READ = ("log", "reference", "reading")  # of them: what the records are read from


@dataclass(frozen=True, kw_only=True)
class LogScenario(Scenario):
    """Segments of a recorded log, each trial's seed draws where its own begins; or the whole of it.

    The worlds of a whole log are runs of the localizers on it, with a reference or without: then
    scans are compared with the map. Records before its ``judged`` were fitted on: beliefs are not
    judged by them.
    """

    env: Mapping[str, Any]  # arguments of ``LogEnv``; "none" is None, where the env takes it
    # whether the noise is of the log's odometry against its reference, instead of ``motion``
    estimated: bool = True
    segments: bool = True

    @property
    def unit(self) -> str:
        return self.recording()[0].unit if {"log", "map"} <= self.env.keys() else "m"

    def room(self) -> LogEnv:
        log, floor_plan = self.recording()
        if self.segments and not log.referenced.size:
            raise InputError(f"{log.source} has no reference to score by: name one as reference.")
        check_inside(log, floor_plan)
        arguments = _arguments(self.env, _EPISODES)
        plan = arguments.get("plan", "odometry")
        if plan != "odometry" and self.agent.name != "open-loop":
            raise InputError(
                f"the agent is {self.agent.name!r} and plan is {plan!r}, but an agent other than "
                'open-loop needs the recorded actions: leave it out, or write plan = "odometry".'
            )
        mismatch = "error" if plan == "odometry" else "ignore"
        return LogEnv(log=log, map=floor_plan, on_mismatch=mismatch, **arguments)

    def robot_model(self, room: TrialEnv) -> RobotModel:
        robot = super().robot_model(room)
        return replace(robot, motion=self.motion_of(self.recording()[0]), beta=self.beta)

    @property
    def beta(self) -> float:
        """β of methods that are given none: log g is tempered as the likelihood of a scan is."""
        return RobotModel.beta * self.scan.power

    def motion_of(self, log: Log) -> MotionModel:
        """Return the motion that filters assume; with too little of a reference, the default."""
        fitted = self.estimated and shows_noise(log)
        return motion_noise(log, kind_of(self.motion)) if fitted else self.motion

    def changed(
        self, world: Mapping[str, Any] = NOTHING, assumed: Mapping[str, Any] = NOTHING
    ) -> Self:
        """Return this scenario with some values changed; noise that is given is not estimated."""
        scenario = super().changed(world, assumed)
        noise_given = any(name.startswith("motion.") and name != "motion.kind" for name in assumed)
        return replace(scenario, estimated=scenario.estimated and not noise_given)

    def recording(self) -> tuple[Log, Map]:
        """Return the records that are played and their map."""
        others = (*_EPISODES, "judged")
        played = {name: value for name, value in self._named.items() if name not in others}
        return _played(Overrides(played), self._digests)

    @property
    def whole(self) -> Log:
        """The log as it was read, with all records and beams."""
        return _whole(Overrides(_arguments(self._named, _READ)), self._digests)

    @property
    def known(self) -> Mapping[str, Any]:
        """The noise that the log shows."""
        shown = self.motion_of(self.recording()[0])
        return {f"motion.{name}": value for name, value in vars(shown).items()}

    def in_world(self, values: Overrides) -> Self:
        names = _ARGUMENTS if self.segments else (*_ARGUMENTS, "judged")
        return replace(self, env={**self.env, **values.by_part(names, "part of a log's world")})

    @property
    def judged(self) -> int | None:
        return None if self.segments else integer("judged", self.env.get("judged", 0))

    @property
    def _named(self) -> Mapping[str, Any]:
        """The arguments of the env, the log and the map among them."""
        for name in ("log", "map"):
            if name not in self.env:
                raise InputError(
                    f"the scenario names no {name}: give --set world.{name}=…, or write {name} = … "
                    'in [world] of a sweep file or in [env] of a scenario file with base = "log".'
                )
        return self.env

    @property
    def _digests(self) -> str:
        return "".join(map(digest_of_file, Overrides(self.env).files))


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


def _arguments(env: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    """Return arguments as the env takes them: TOML has no None, and "none" is a plan's name."""
    values = {name: env[name] for name in names if name in env}
    return {n: None if v == "none" and n != "plan" else v for n, v in values.items()}


@lru_cache(maxsize=4)
def _whole(env: Overrides, digests: str) -> Log:
    """Return all records of a log, read once for all trials, and again if a file has changed."""
    return log_of(*(env.get(name) for name in _READ))


@lru_cache(maxsize=4)
def _played(env: Overrides, digests: str) -> tuple[Log, Map]:
    whole = _whole(Overrides(_arguments(env, _READ)), digests)
    made = LogEnv(log=whole, **_arguments(env, env.keys() - {*_READ}))
    return made.log, made.floor_plan


@lru_cache(maxsize=4)
def shows_noise(log: Log) -> bool:
    """Whether a log has enough of a reference to estimate the noise of its odometry."""
    return log.reference is not None and len(typical_steps(log)[0]) >= LEAST_STEPS


def typical_steps(log: Log) -> tuple[Floats, Floats]:
    """Return increments of the odometry, and what the reference says was done, (k, 3) each.

    One for each stretch between consecutive poses of the reference, none interpolated. A stretch of
    n > 1 records is given as one of its steps, of root mean square length and turn, with ``left``
    NaN. Its error is 1/n of what the length and the turn of all stretches explain, as errors of
    wheels add up by steps, and 1/√n of the rest, as noise adds up by variances.
    """
    if log.reference is None:
        raise InputError(f"{log.source} has no reference: give the noise of the motion instead.")
    ends = log.posed
    if ends.size < 2:
        return np.empty((0, 3)), np.empty((0, 3))
    odometry, reference = increments_of(log.odometry[ends]), increments_of(log.reference[ends])
    counts, off = np.diff(ends), reference - odometry
    off[:, 2] = arrays.wrapped(off[:, 2])
    length, turn = lengths_of(log.increments), log.increments[:, 2]
    way, net = _over(length, ends), lengths_of(odometry)
    ahead = (off * odometry)[:, :2].sum(axis=1) / np.where(net > 0, net, 1.0)
    turned = _explained(off[:, 2], np.column_stack([way, odometry[:, 2]]))
    explained = np.column_stack([_explained(ahead, way[:, None]), turned])
    rest = np.column_stack([ahead, off[:, 2]]) - explained
    n = counts[:, None]
    error = explained / n + rest / np.sqrt(n)
    typical = np.sqrt(np.column_stack([_over(length**2, ends), _over(turn**2, ends)]) / n)
    single, unknown = counts == 1, np.full(len(counts), np.nan)
    step = np.column_stack([typical[:, 0], np.zeros(len(counts)), typical[:, 1]])
    step[single] = odometry[single]
    true = np.column_stack([step[:, 0] + error[:, 0], unknown, step[:, 2] + error[:, 1]])
    true[single] = reference[single]
    moving = np.abs(step).max(axis=1, initial=0.0) > 0
    return step[moving], true[moving]


def _over(values: Floats, ends: Indices) -> Floats:
    """Return the sums of the values of steps, (n - 1,), between records, (k,), (k - 1,)."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray(np.diff(sums[ends]))


def _explained(errors: Floats, by: Floats) -> Floats:
    """Return the least-squares fit of errors (k,) by columns (k, j) without a constant, (k,)."""
    fit, basis = np.zeros(len(errors)), list[Floats]()
    for column in by.T:  # no LAPACK, whose last bits depend on the processor
        rest = column - sum((column * direction).sum() * direction for direction in basis)
        size = np.sqrt(np.square(rest).sum())
        if size > 1e-12 * np.sqrt(np.square(column).sum()):
            basis.append(rest / size)
            fit += (errors * basis[-1]).sum() * basis[-1]
    return fit


@lru_cache(maxsize=4)
def motion_noise(log: Log, kind: str = "differential") -> MotionModel:
    """Return the motion model of a kind with the noise of steps of a log, thinned as it is played.

    Each number is that of the fit, but at least half of ``unknown_motion``'s, as a reference that
    was made with the help of the odometry denies its noise.
    """
    least, steps = unknown_motion(kind, log.unit), typical_steps(log)
    if len(steps[0]) < LEAST_STEPS:
        raise InputError(
            f"{log.source} has {len(steps[0])} stretches with movement between poses of its "
            "reference, too few to estimate the noise of the motion, which needs "
            f"{LEAST_STEPS}: give assumed.motion."
        )
    fitted = type(least).fitted(*steps)
    noise = [name for name in vars(least) if name != "still"]
    larger = {name: max(getattr(least, name) / 2, getattr(fitted, name)) for name in noise}
    return replace(least, **larger)


LOG = LogScenario(
    words="segments of a recorded log, named by log, map and reference in a file of your own",
    env={"segment": 50.0, "every": "0.2m,5deg", "max_beams": 60},
    motion=unknown_motion("differential", "m"),  # what is not given if some of it is
    scan=GaussianUniform(sigma=METRE_SIGMA),
    prior=Gaussian(sd_position=0.2, sd_heading=0.1),
    thresholds=Thresholds(far=1.0, lost=1.0),
)
SHORT = replace(
    LOG,
    words="as log, but segments of 20 m, and a record each 0.0625 m or 3°, as Nav2's AMCL needs",
    env={"segment": 20.0, "every": "0.0625m,3deg", "max_beams": 60},
)
REPLAY = replace(
    LOG,
    words="the whole of a recorded log, as deqmcl replay runs it: each world is another run",
    env={"every": "0.2m,5deg", "max_beams": 60},
    segments=False,
)
LOGS = {"log": LOG, "log-short": SHORT, "replay": REPLAY}
