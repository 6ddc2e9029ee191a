"""Where the best cluster of a localizer is, against the robot: of a run in a world or on a log.

Errors of tracks are as evo has them, absolute (APE) and relative (RPE). Lengths of scores are in m.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from benchmarks.trials.clouds import covariance_floor
from deqmcl_gym.logs import Log
from deqmcl_gym.logs.motion import lengths_of, relative
from deqmcl_gym.maps import Map
from deqmcl_gym.maps.clusters import Near
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Bools, Floats, Indices, Reals, arrays
from deqmcl_gym.numerics.arrays import fits

NEAR = {"05m": Near(0.5, math.radians(10)), "1m": Near(1.0, math.radians(30))}
FOUND = "1m"  # of NEAR: the one for metres to localize
RECOVERED, RECOVERED_STEPS = 0.45, 20  # m; 10 s, of two scans each (Fox, Burgard & Thrun 1999)


@dataclass(frozen=True, kw_only=True)
class Journey:
    """A run, n = T + 1 states; how far off the best cluster is at the k whose pose is known."""

    steps: Indices  # the k
    way: Floats  # driven until each by the commands, m
    distance: Floats  # of the best cluster's mean to the truth, m
    angle: Floats  # likewise, rad
    quality: Floats  # confidence that it is not lost; NaN where the belief gives none
    tolerated: float = 0.0  # share of steps at which a localized robot may seem off; 0: truth exact
    driven: Floats  # by the commands until each state, (n,)
    truth: Floats  # true poses, (n, 3), or best clusters of a log
    # whether a wall stopped the step to each state, (n,)
    collided: Bools = field(default_factory=lambda: np.zeros(0, np.bool_))
    clearance: float = math.nan  # least distance of the robot's rim to a wall
    goal: Floats | None = None  # where it was to arrive, (2,)
    planned: float = math.nan  # length of the route from the start to the goal
    # weight within 1 m and 30° of the truth and of its twin under a half turn of the map, (k, 2);
    # None if that was not asked for
    masses: Floats | None = None

    def localized(self, near: str) -> Bools:
        """Whether the best cluster is as near to the truth as ``NEAR`` says, (k,)."""
        return NEAR[near].holds(self.distance, self.angle)

    @property
    def last(self) -> Bools:
        """Whether a step is one of the last 25 %, (k,)."""
        return self.steps >= math.floor(0.75 * len(self.truth))

    def success(self, near: str) -> float:
        """1 if localized in the last quarter but those ``tolerated``, else 0; NaN: unknown."""
        if not self.last.any():
            return math.nan
        return float((~self.localized(near)[self.last]).mean() <= self.tolerated)

    @property
    def lost_at(self) -> int | None:
        """Index of the first step from which on it is never again localized; None: it is."""
        near = np.flatnonzero(self.localized(FOUND))
        first = int(near[-1]) + 1 if near.size else 0
        ended_well = first == self.steps.size or (near.size and self.success(FOUND) == 1.0)
        return None if ended_well else first

    @property
    def metres_to_localize(self) -> float:
        """Metres until it is localized at all later steps but those ``tolerated``; inf: never."""
        if not self.steps.size:
            return math.nan
        first = settled(self.localized(FOUND), self.tolerated)
        return math.inf if first is None else float(self.way[first])

    @property
    def rated(self) -> Bools:
        """Whether a step t ≥ 1 has a quality, (k,)."""
        return np.isfinite(self.quality) & (self.steps >= 1)

    @property
    def false(self) -> Bools:
        """Whether the belief commits itself, quality > 0.5, while more than 2 m off, (k,)."""
        return (self.quality > 0.5) & (self.distance > 2.0)

    def metres_to_recover(self, carried: int) -> float:
        """Metres from the first step after a kidnap to 20 within 0.45 m on end; inf: never."""
        after = np.flatnonzero(self.steps >= carried)
        near = self.distance[after] <= RECOVERED
        runs = np.convolve(near, np.ones(RECOVERED_STEPS), "valid") if near.size else near
        whole = np.flatnonzero(runs > RECOVERED_STEPS - 0.5)
        if near.size < RECOVERED_STEPS or not whole.size:
            return math.inf
        return float(self.way[after[whole[0]]] - self.way[after[0]])

    @property
    def carried(self) -> int:
        """The first state after the robot was carried off: where it moved farthest uncommanded."""
        moved = np.hypot(*np.diff(self.truth[:, :2], axis=0).T)
        return 1 + int(np.argmax(moved - np.diff(self.driven)))

    @property
    def arrived(self) -> bool:
        """Whether it ends within 0.5 m of the goal, without having touched a wall."""
        assert self.goal is not None
        off = math.hypot(*(self.truth[-1, :2] - self.goal))
        return off <= 0.5 and not self.collided.any()

    @property
    def spl(self) -> float:
        """Success weighted by path length: S · planned / max(driven, planned).

        Anderson et al. 2018, "On evaluation of embodied navigation agents".
        """
        path = float(np.hypot(*np.diff(self.truth[:, :2], axis=0).T).sum())
        longer = max(path, self.planned)
        return float(self.arrived) * (self.planned / longer if longer > 0 else 1.0)


def settled(near: Bools, tolerated: float = 0.0) -> int | None:
    """Return the first step from which on all are near, but for a share; None: there is none."""
    off = np.cumsum(~near[::-1])[::-1] / np.arange(near.size, 0, -1)
    good = np.flatnonzero(near & (off <= tolerated))
    return int(good[0]) if good.size else None


def way_driven(commands: Sequence[Reals]) -> Floats:
    """Return the way until each step, from the commands of the steps t ≥ 1, (2,) or (3,) each."""
    if not commands:
        return np.zeros(1)
    return np.concatenate([[0.0], np.cumsum(lengths_of(np.array(commands, np.float64)))])


def half_turned(floor_plan: Map, poses: Floats) -> Floats:
    """Return poses (n, 3) turned by 180° about the middle of a map."""
    x0, y0, x1, y1 = floor_plan.bounds
    return np.array([x0 + x1, y0 + y1, math.pi]) + np.array([-1.0, -1.0, 1.0]) * poses


def is_symmetric(floor_plan: Map) -> bool:
    """Whether a half turn about its middle gives the same map; asked at 4,096 points."""
    x0, y0, x1, y1 = floor_plan.bounds
    points = np.random.default_rng(0).uniform((x0, y0), (x1, y1), (4096, 2))
    turned = np.array([x0 + x1, y0 + y1]) - points
    same = floor_plan.free(points) == floor_plan.free(turned)
    return float(same.mean()) >= 0.998  # one on a line between cells may fall to either side


AGREE = (0.1, 0.3)  # m that a beam may be off
TOLERATED = 0.05  # share of records at which a localized robot may seem off: references err, too


class PoseErrors(NamedTuple):
    """Errors of n poses: lengths, evo's ``trans_part``; rad in [0, π], its ``angle_rad``."""

    translation: Floats
    rotation: Floats

    @property
    def rmse(self) -> float:
        """Root mean square of the translations, evo's first figure; NaN of nothing."""
        return rms(self.translation)


def absolute(estimate: Floats, reference: Floats) -> PoseErrors:
    """APE: how far each pose (n, 3) is from its reference (n, 3), without any alignment.

    A localizer estimates in the map's frame: an alignment would hide its error.
    """
    known = np.isfinite(reference).all(axis=1)
    x, y, turn = relative(reference[known], estimate[known]).T
    return PoseErrors(np.hypot(x, y), np.abs(arrays.wrapped(turn)))


def relative_errors(estimate: Floats, reference: Floats) -> PoseErrors:
    """RPE: how far the motion from pose to pose is from that of the reference."""
    known = np.isfinite(reference).all(axis=1)
    driven, meant = (relative(path[:-1], path[1:]) for path in (estimate[known], reference[known]))
    return absolute(driven, meant)


def agreement(log: Log, floor_plan: Map, poses: Floats) -> tuple[float, float]:
    """Share of the beams with a return that are within 0.1 m and 0.3 m of what the map says."""
    expected = log.scanner.ranges(floor_plan, poses.T)
    seen = np.isfinite(log.ranges)
    with np.errstate(invalid="ignore"):
        off = np.abs(expected - log.ranges)[seen] / metre(log.unit)
    within, well = ((off <= most).mean() if off.size else math.nan for most in AGREE)
    return float(within), float(well)


@dataclass(frozen=True)
class EstimatedTrack:
    """Best clusters at the first n records of a log, (n, 3), NaN for no estimate; their errors."""

    log: Log
    best: Floats
    spread: Floats | None = None  # covariances as believed, (n, 3, 3), NaN unknown; None: of all

    @cached_property
    def referenced(self) -> Indices:
        """The records with a reference, in order."""
        return self.log.referenced[self.log.referenced < len(self.best)]

    @cached_property
    def known(self) -> Indices:
        """The records with a reference and an estimate, in order."""
        return np.asarray(self.referenced[np.isfinite(self.best[self.referenced, 0])])

    @cached_property
    def way(self) -> Floats:
        """Metres driven at each record, by odometry."""
        return self.log.driven[: len(self.best)] / metre(self.log.unit)

    @cached_property
    def errors(self) -> PoseErrors:
        """APE at the records with a reference, m."""
        return self._in_metres(absolute)

    @cached_property
    def relative(self) -> PoseErrors:
        """RPE from record to record, m."""
        return self._in_metres(relative_errors)

    @cached_property
    def at_stamps(self) -> Indices:
        """Which of the known records are at times of the reference's own poses."""
        between = self.log.interpolated
        original = np.ones(self.known.size, bool) if between is None else ~between[self.known]
        return np.flatnonzero(original)

    def deviations(self, first: int = 0, last: int | None = None) -> tuple[Floats, Floats]:
        """Offsets of the reference (k, 3), and covariances, NaN unknown, from record to record.

        At records with an estimate: those at the reference's own times, if there are any.
        """
        at = self.known[(self.known >= first) & (self.known < (last or len(self.best)))]
        stamped = np.intersect1d(at, self.known[self.at_stamps])
        at = stamped if stamped.size else at
        truth = np.empty((0, 3)) if self.log.reference is None else self.log.reference[at]
        off = truth - self.best[at]
        off[:, 2] = arrays.wrapped(off[:, 2])
        return off, np.full((at.size, 3, 3), np.nan) if self.spread is None else self.spread[at]

    def journey(self, quality: Floats | None = None) -> Journey:
        """Return the run, which ``TRACK_GROUPS`` score; ``quality`` of all records, (n,)."""
        off, at = np.full((len(self.best), 2), math.inf), self.referenced
        off[self.known] = np.column_stack([self.errors.translation, self.errors.rotation])
        return Journey(
            steps=at,
            way=self.way[at],
            distance=off[at, 0],
            angle=off[at, 1],
            quality=np.full(at.size, math.nan) if quality is None else quality[at],
            tolerated=TOLERATED,
            driven=self.way,
            truth=self.best,
        )

    @property
    def lost(self) -> tuple[int, float] | None:
        """The record from which on it is never again within 1 m and 30°, and the way there, m."""
        run = self.journey()
        first = run.lost_at
        return None if first is None else (int(run.steps[first]), float(run.way[first]))

    @property
    def astray(self) -> Floats:
        """The way, m, at the first and last record of stretches beyond 1 m or 30°, (k, 2)."""
        run = self.journey()
        edges = np.flatnonzero(np.diff(np.pad(~run.localized(FOUND), 1).astype(np.int8)))
        return np.asarray(run.way[edges.reshape(-1, 2) - [0, 1]])

    def _in_metres(self, of: Callable[[Floats, Floats], PoseErrors]) -> PoseErrors:
        truth = self.best[:0] if self.log.reference is None else self.log.reference[self.known]
        off = of(self.best[self.known], truth)
        return PoseErrors(off.translation / metre(self.log.unit), off.rotation)


def calibration_of_gaussians(off: Floats, covariances: Floats, unit: str) -> Floats:
    """Rank of the truth, NEES and log score of N(pose, P), d = truth - pose, (n, 3) each.

    The rank is P(D(X) < D(z)) in (x, y), 1 - exp(-D²/2); NEES is dᵀ P⁻¹ d in (x, y, θ), the log
    score ½ (NEES + log det 2πP). NaN where d or P is.
    """
    known = np.isfinite(off).all(axis=1) & np.isfinite(covariances).all(axis=(1, 2))
    scores = np.full((len(off), 3), math.nan)
    fitted = np.empty((int(known.sum()), 3))
    floor = covariance_floor(unit)
    fits(off[known], covariances[known] + np.diag(floor), fitted)
    scores[known] = np.column_stack([1 - arrays.exp(-fitted[:, 0] / 2), fitted[:, 1:]])
    return scores


def mean(values: Floats | Bools) -> float:
    """Arithmetic mean; NaN of nothing."""
    return float(values.mean()) if values.size else math.nan


def rms(values: Floats) -> float:
    """Root of the mean square; NaN of nothing."""
    return math.sqrt(mean(np.square(values)))


def middle(values: Floats) -> float:
    """Median; NaN of nothing."""
    return float(np.median(values)) if values.size else math.nan


def deviation(values: Floats) -> float:
    """Standard deviation; NaN of nothing."""
    return float(values.std()) if values.size else math.nan


def unless_nan(values: Iterable[float]) -> list[float | None]:
    """Return values with None for NaN, which JSON does not have."""
    return [None if math.isnan(value) else value for value in values]


def columns_of(
    names: Sequence[str], rows: Sequence[Sequence[float | None]]
) -> dict[str, list[float | None]]:
    """Return rows as columns by name, with None for NaN."""
    table = np.array(rows, np.float64).reshape(-1, len(names)).T
    return dict(zip(names, map(unless_nan, table.tolist()), strict=True))
