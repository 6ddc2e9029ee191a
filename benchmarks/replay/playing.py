"""One localizer on one log, as fast as it goes."""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.trials.clouds import calibration, cloud_of, joined
from benchmarks.trials.clouds import moments as spread
from benchmarks.trials.episode import Moment
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.logs import Trajectory
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError
from localizers import Localizer, Prior, best_cluster, mean_pose

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
        ranks: P(nearer to the belief's mean than the truth), (n,); see ``clouds.calibration``. NaN
            where there is no truth, or the belief has no spread.
        nees: normalized estimation error squared, (n,); NaN as for the ranks.
        seconds: the localizer's time for each record, (n,).
        unit: of lengths.
    """

    times: Floats
    way: Floats
    means: Floats
    best: Floats
    truth: Floats
    ranks: Floats
    nees: Floats
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
    means, best, truth, fits, seconds = [], [], [], [], []
    for moment in played(env, localizer, prior, rng):
        points = moment.belief.points()
        if points is None:
            raise InputError(f"its belief of state {moment.step} holds no points of the present.")
        fits.append(_fit(moment, points, unit))
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
        ranks=np.array(fits)[:, 0],
        nees=np.array(fits)[:, 1],
        seconds=np.array(seconds),
        unit=unit,
    )


def _fit(moment: Moment, points: Any, unit: str) -> tuple[float, float]:
    """Return rank and NEES of the truth in a belief; NaN where there is no truth.

    Raises:
        InputError: the points are no belief.
    """
    clouds = joined([cloud_of(moment.step, 0, points)], [moment.truth])
    means = spread(clouds)[:, :4]
    if not np.isfinite(moment.truth).all():
        return math.nan, math.nan
    _, rank, nees = calibration(clouds, means, unit)[0].tolist()
    return rank, nees


def _shown(info: dict[str, Floats]) -> Floats:
    planned: Floats = info["planned_actions"][: info["planned_count"]]
    return planned
