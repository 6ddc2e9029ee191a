"""One localizer on one log, as fast as it goes."""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.trials.clouds import cloud_of, joined
from benchmarks.trials.clouds import moments as spread
from benchmarks.trials.episode import Moment
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.logs import Trajectory
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError
from localizers import Localizer, Prior, best_cluster
from localizers.api import mean_pose

_NOWHERE = np.full(3, np.nan)


@dataclass(frozen=True, kw_only=True)
class Track:
    """What a localizer believed at each record, and the truth where it is known.

    Attributes:
        times: of the records, s, (n,).
        way: how far the robot had driven by odometry, (n,).
        means: of the belief, (x, y, θ), (n, 3).
        best: its best cluster's mean, (n, 3): see ``best_cluster``.
        truth: reference poses, (n, 3); NaN where there is none.
        seconds: the localizer's time for each record, (n,).
        unit: of lengths.
    """

    times: Floats
    way: Floats
    means: Floats
    best: Floats
    truth: Floats
    seconds: Floats
    unit: str

    @property
    def tum(self) -> bytes:
        """The best clusters as a TUM file, for evo."""
        return Trajectory(self.times, self.best).tum


def played(
    env: LogEnv, localizer: Localizer, prior: Prior, rng: np.random.Generator
) -> Iterator[Moment]:
    """Play a log to a localizer; yield each step. The reference goes past it, to the scores.

    Args:
        env: the log.
        localizer: fed with its scans, odometry and plan.
        prior: p(x_0), for the localizer.
        rng: the localizer's only randomness.
    """
    ranges, info = env.reset()
    started, ended, step = time.perf_counter(), False, 0
    belief = localizer.reset(prior, _shown(info), rng)
    yield Moment(0, info.pop("truth", _NOWHERE), ranges, belief, time.perf_counter() - started)
    while not ended:
        ranges, _, ended, _, info = env.step(env.next_action)
        truth, step = info.pop("truth", _NOWHERE), step + 1
        started = time.perf_counter()
        belief = localizer.update(ranges, info["action"], _shown(info))
        yield Moment(step, truth, ranges, belief, time.perf_counter() - started, info["action"])


def replay(env: LogEnv, localizer: Localizer, prior: Prior, rng: np.random.Generator) -> Track:
    """Play a log to a localizer and return its track; see ``played``."""
    unit = env.log.unit
    means, best, truth, seconds = [], [], [], []
    for moment in played(env, localizer, prior, rng):
        points = moment.belief.points()
        if points is None:
            raise InputError(f"its belief of state {moment.step} holds no points of the present.")
        spread(joined([cloud_of(moment.step, 0, points)], [moment.truth]))  # refuses what is none
        means.append(mean_pose(*points))
        best.append(best_cluster(*points, unit=unit).mean)
        truth.append(moment.truth)
        seconds.append(moment.seconds)
    return Track(
        times=env.log.times,
        way=env.log.driven,
        means=np.array(means),
        best=np.array(best),
        truth=np.array(truth),
        seconds=np.array(seconds),
        unit=unit,
    )


def _shown(info: dict[str, Floats]) -> Floats:
    planned: Floats = info["planned_actions"][: info["planned_count"]]
    return planned
