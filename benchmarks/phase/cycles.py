"""What a queue says in every theta cycle of a lap: one cycle per step, one phase per offset."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.phase.fields import PlaceFields
from deqmcl_gym.numerics.types import Bools, Floats, Indices, Reals
from localizers import Belief


@dataclass(frozen=True, kw_only=True)
class Cycles:
    """A lap of T steps, seen through the queue at every step t and offset k; NaN is not held.

    Arrays over k have 2R + 1 columns for k = -R … R, R = min(L, T): no queue reaches further.

    Attributes:
        lag: L.
        activity: P(x_{t+k} in the field | o_{1:t}) of each of K fields, (T + 1, 2R + 1, K).
        right: activity of the field that the robot is in at t + k, NaN for none, (T + 1, 2R + 1).
        passed: how far the robot at t is past each field's centre along the lap, px, counted from
            the visit that is nearest to x_{t+k}, of which offset k tells: a field is visited more
            than once, or may be gone around. Known on the lap, (T + 1, 2R + 1, K).
        error: distance of the mean of x_{t+k} from the true place, px, (T + 1, 2R + 1).
        spread: root of the variance of x plus that of y, px, (T + 1, 2R + 1).
    """

    lag: int
    activity: Floats
    right: Floats
    passed: Floats
    error: Floats
    spread: Floats

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
        """360° (k + L + ½) / (2L + 1): the cycle in equal parts, the oldest first, (2R + 1,)."""
        phases: Floats = 360 * (self.offsets + self.lag + 0.5) / (2 * self.lag + 1)
        return phases

    @property
    def held(self) -> Bools:
        """Whether the queue at t holds offset k, (T + 1, 2R + 1)."""
        return ~np.isnan(self.error)

    @property
    def distance(self) -> Floats:
        """Root mean square distance of the belief from the true place, px, (T + 1, 2R + 1)."""
        return np.hypot(self.error, self.spread)


@dataclass(frozen=True)
class _TrueQueue:
    truth: Floats
    step: int

    def points(self, offset: int = 0) -> tuple[Reals, Floats] | None:
        return self.truth[self.step + offset][None], np.ones(1)


def perfect_cycles(truth: Floats, fields: PlaceFields, lag: int) -> Cycles:
    """What a queue would say that knew the true poses (T + 1, 3): all of its mass is there."""
    return cycles_of(truth, [_TrueQueue(truth, t) for t in range(len(truth))], fields, lag)


def cycles_of(truth: Floats, beliefs: Sequence[Belief], fields: PlaceFields, lag: int) -> Cycles:
    """Look at the queue of every step 0 … T of a lap.

    Args:
        truth: true poses, (T + 1, 3).
        beliefs: after each step.
        fields: along the lap.
        lag: L.

    Raises:
        RuntimeError: a belief is not finite.
    """
    last = len(truth) - 1
    reach = min(lag, last)
    states = np.arange(last + 1)[:, None] + np.arange(-reach, reach + 1)
    activity = np.full((*states.shape, len(fields)), np.nan)
    error, spread = np.full(states.shape, np.nan), np.full(states.shape, np.nan)
    for t, column in np.argwhere((states >= 0) & (states <= last)).tolist():
        points, state = beliefs[t].points(column - reach), states[t, column]
        if points is None:
            continue
        poses, weights = points
        activity[t, column] = np.where(fields.inside(poses), weights, 0.0).sum(axis=1)
        error[t, column], spread[t, column] = _moments(poses, weights, truth[state])
        if not np.isfinite(error[t, column]):
            raise RuntimeError(f"the belief at t = {t} about x[{state}] is not finite.")
    states = states.clip(0, last)
    visited = fields.inside(truth).T[states]
    right = np.where(visited.any(axis=2), (activity * visited).sum(axis=2), np.nan)
    passed = _passed(truth, fields, states)
    return Cycles(
        lag=lag, activity=activity, right=right, passed=passed, error=error, spread=spread
    )


def _moments(poses: Reals, weights: Floats, truth: Floats) -> tuple[float, float]:
    """Distance of the mean place from the truth, and root of the total variance, px."""
    places = np.asarray(poses[:, :2], dtype=np.float64)
    shares = weights[:, None]
    mean = (shares * places).sum(axis=0)
    variance = (shares * np.square(places - mean)).sum(axis=0)
    return float(np.hypot(*(mean - truth[:2]))), float(np.sqrt(variance.sum()))


def _passed(truth: Floats, fields: PlaceFields, states: Indices) -> Floats:
    arcs, advance = fields.arcs(truth), fields.path.advance
    centres = fields.arcs(fields.centres)
    past = np.array([[advance(centre, arc) for centre in centres] for arc in arcs])
    progress = np.cumsum([0.0, *map(advance, arcs, arcs[1:])])
    still_to_go = progress[states] - progress[:, None]
    passed: Floats = past[states] - still_to_go[:, :, None]
    return passed
