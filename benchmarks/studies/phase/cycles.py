"""What a queue says in every theta cycle of a lap: one cycle per step, one phase per offset."""

from collections.abc import Iterable
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
        truth: true poses, (T + 1, 3).
        activity: P(x_{t+k} in the field | o_{1:t}) of each of K fields, (T + 1, 2R + 1, K).
        right: activity of the field that the robot is in at t + k, NaN for none, (T + 1, 2R + 1).
        passed: how far the robot at t is past each field's centre along the lap, counted from
            the visit that is nearest to x_{t+k}, of which offset k tells: a field is visited more
            than once, or may be gone around. Known on the lap, (T + 1, 2R + 1, K).
        error: distance of the mean of x_{t+k} from the true place, (T + 1, 2R + 1).
        spread: root of the variance of x plus that of y, (T + 1, 2R + 1).
    """

    lag: int
    truth: Floats
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
        """Root mean square distance of the belief from the true place, (T + 1, 2R + 1)."""
        return np.hypot(self.error, self.spread)


@dataclass(frozen=True)
class _TrueQueue:
    truth: Floats
    step: int

    def points(self, offset: int = 0) -> tuple[Reals, Floats] | None:
        state = self.step + offset
        return (self.truth[state][None], np.ones(1)) if state < len(self.truth) else None


def perfect_cycles(truth: Floats, fields: PlaceFields, lag: int) -> Cycles:
    """What a queue would say that knew the true poses (T + 1, 3): all of its mass is there."""
    lap = ((pose, _TrueQueue(truth, t)) for t, pose in enumerate(truth))
    return cycles_of(lap, fields, lag, most=len(truth) - 1)


def cycles_of(
    lap: Iterable[tuple[Reals, Belief]], fields: PlaceFields, lag: int, *, most: int
) -> Cycles:
    """Look at the queue of every step 0 … T of a lap, before the next one is made.

    Args:
        lap: the true pose (3,) and the belief after each step.
        fields: along the lap.
        lag: L.
        most: steps; no lap has more.

    Raises:
        RuntimeError: a belief is not finite.
    """
    poses, seen = [], []
    for t, (pose, belief) in enumerate(lap):
        poses.append(pose)
        held = ((k, belief.points(k)) for k in range(-min(lag, t), min(lag, most) + 1))
        seen += [(t, k, *_told(*points, fields)) for k, points in held if points is not None]
    truth = np.array(poses, np.float64)
    last = len(truth) - 1
    reach = min(lag, last)
    states = np.arange(last + 1)[:, None] + np.arange(-reach, reach + 1)
    activity = np.full((*states.shape, len(fields)), np.nan)
    error, spread = np.full(states.shape, np.nan), np.full(states.shape, np.nan)
    for t, k, active, mean, width in seen:
        if t + k > last:
            continue
        activity[t, k + reach], spread[t, k + reach] = active, width
        error[t, k + reach] = distance = np.hypot(*(mean - truth[t + k, :2]))
        if not np.isfinite(distance):
            raise RuntimeError(f"the belief at t = {t} about x[{t + k}] is not finite.")
    states = states.clip(0, last)
    visited = fields.inside(truth).T[states]
    right = np.where(visited.any(axis=2), (activity * visited).sum(axis=2), np.nan)
    passed = _passed(truth, fields, states)
    return Cycles(
        lag=lag,
        truth=truth,
        activity=activity,
        right=right,
        passed=passed,
        error=error,
        spread=spread,
    )


def _told(poses: Reals, weights: Floats, fields: PlaceFields) -> tuple[Floats, Floats, float]:
    """Weight in each field (K,), mean place (2,), and root of the total variance."""
    active = np.where(fields.inside(poses), weights, 0.0).sum(axis=1)
    places = np.asarray(poses[:, :2], dtype=np.float64)
    shares = weights[:, None]
    mean = (shares * places).sum(axis=0)
    variance = (shares * np.square(places - mean)).sum(axis=0)
    return active, mean, float(np.sqrt(variance.sum()))


def _passed(truth: Floats, fields: PlaceFields, states: Indices) -> Floats:
    arcs, advance = fields.arcs(truth), fields.path.advance
    centres = fields.arcs(fields.centres)
    past = np.array([[advance(centre, arc) for centre in centres] for arc in arcs])
    progress = np.cumsum([0.0, *map(advance, arcs, arcs[1:])])
    still_to_go = progress[states] - progress[:, None]
    passed: Floats = past[states] - still_to_go[:, :, None]
    return passed
