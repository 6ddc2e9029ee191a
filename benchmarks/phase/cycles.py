"""What a queue says in every theta cycle of a lap: one cycle per step, one phase per offset."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.phase.fields import PlaceFields
from benchmarks.trials.episode import Moment
from deqmcl_gym.numerics.types import Bools, Floats, Indices, Reals
from localizers import Belief


@dataclass(frozen=True, kw_only=True)
class Cycles:
    """A lap of T steps, seen through the queue at every step t and offset k; NaN is not held.

    Arrays over k have 2R + 1 columns for k = -R … R, R = min(L, T): no queue reaches further.

    Attributes:
        lag: L.
        activity: P(x_{t+k} in the field | o_{1:t}) of each field, (T + 1, 2R + 1, fields).
        error: distance of the mean of x_{t+k} from the true place, px, (T + 1, 2R + 1).
        spread: root of the variance of x plus that of y, px, (T + 1, 2R + 1).
        past_centres: how far the robot is past each field's centre, the shorter way round the
            lap, px, (T + 1, fields).
        progress: how far along the lap it is past its start, px, (T + 1,).
        home: field that the robot is in, -1 for none, (T + 1,).
    """

    lag: int
    activity: Floats
    error: Floats
    spread: Floats
    past_centres: Floats
    progress: Floats
    home: Indices

    @property
    def steps(self) -> int:
        """T."""
        return len(self.error) - 1

    @property
    def reach(self) -> int:
        """R."""
        return int(self.error.shape[1] // 2)

    @property
    def offsets(self) -> Indices:
        """k, (2R + 1,)."""
        return np.arange(-self.reach, self.reach + 1)

    @property
    def phases(self) -> Floats:
        """Middle of the phase of each offset, degrees, (2R + 1,)."""
        return phase(self.offsets, self.lag)

    @property
    def held(self) -> Bools:
        """Whether the queue at t holds offset k, (T + 1, 2R + 1)."""
        return ~np.isnan(self.error)

    @property
    def distance(self) -> Floats:
        """Root mean square distance of the belief from the true place, px, (T + 1, 2R + 1)."""
        return np.hypot(self.error, self.spread)

    def passed(self) -> Floats:
        """How far the robot at t is past each field, px, (T + 1, 2R + 1, fields).

        As the field is visited more than once, or may be gone around: counted from the visit that
        is nearest to x_{t+k}, of which offset k tells. NaN where t + k is not on the lap.
        """
        passed = np.full(self.activity.shape, np.nan)
        for column, k in enumerate(self.offsets.tolist()):
            t = np.arange(max(0, -k), self.steps + 1 - max(0, k))
            still_to_go = self.progress[t + k] - self.progress[t]
            passed[t, column] = self.past_centres[t + k] - still_to_go[:, None]
        return passed


def phase(offsets: Indices, lag: int) -> Floats:
    """360° (k + L + ½) / (2L + 1): the cycle in 2L + 1 equal parts, the oldest state first."""
    return 360 * (offsets + lag + 0.5) / (2 * lag + 1)


def cycles_of(episode: Sequence[Moment], fields: PlaceFields, lag: int) -> Cycles:
    """Look at every queue of a whole episode, moments 0 … T.

    Raises:
        RuntimeError: a belief is not finite.
    """
    truth = np.array([moment.truth for moment in episode])
    return _cycles(truth, [moment.belief for moment in episode], fields, lag)


def perfect_cycles(truth: Floats, fields: PlaceFields, lag: int) -> Cycles:
    """What a queue would say that knew the true poses (T + 1, 3): all of its mass is there."""
    return _cycles(truth, [_TrueQueue(truth, t) for t in range(len(truth))], fields, lag)


@dataclass(frozen=True)
class _TrueQueue:
    truth: Floats
    step: int

    def points(self, offset: int = 0) -> tuple[Reals, Floats] | None:
        return self.truth[self.step + offset][None], np.ones(1)


def _cycles(truth: Floats, beliefs: Sequence[Belief], fields: PlaceFields, lag: int) -> Cycles:
    steps = len(truth) - 1
    reach = min(lag, steps)
    shape = (steps + 1, 2 * reach + 1)
    activity = np.full((*shape, len(fields)), np.nan)
    error, spread = np.full(shape, np.nan), np.full(shape, np.nan)
    for t, belief in enumerate(beliefs):
        for k in range(-min(t, reach), min(steps - t, reach) + 1):
            points = belief.points(k)
            if points is None:
                continue
            cell = t, k + reach
            activity[cell] = fields.mass(*points)
            error[cell], spread[cell] = _moments(*points, truth[t + k])
            if not np.isfinite(error[cell]):
                raise RuntimeError(f"the belief at t = {t} about x[{t + k}] is not finite.")
    homes = np.array([fields.mass(pose[None], np.ones(1)) for pose in truth])
    home = np.where(homes.any(axis=1), homes.argmax(axis=1), -1)
    return Cycles(
        lag=lag,
        activity=activity,
        error=error,
        spread=spread,
        past_centres=fields.past_centres(truth),
        progress=fields.progress(truth),
        home=home,
    )


def _moments(poses: Reals, weights: Floats, truth: Floats) -> tuple[float, float]:
    """Distance of the mean place from the truth, and root of the total variance, px."""
    places = np.asarray(poses[:, :2], dtype=np.float64)
    shares = weights[:, None]
    mean = (shares * places).sum(axis=0)
    variance = (shares * np.square(places - mean)).sum(axis=0)
    return float(np.hypot(*(mean - truth[:2]))), float(np.sqrt(variance.sum()))
