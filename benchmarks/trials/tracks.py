"""What a localizer estimated at each record of a log, how far off it was, and how that is scored.

Errors are those of the best cluster, as evo computes them: absolute (APE) and relative (RPE). All
lengths of scores are in m.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.clouds import covariance_floor
from benchmarks.trials.fixes import Fixes, Journey
from benchmarks.trials.metrics import mean
from deqmcl_gym.logs import Log
from deqmcl_gym.logs.motion import relative
from deqmcl_gym.maps import Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.gaussian import fits
from deqmcl_gym.numerics.types import Floats, Indices
from deqmcl_gym.validation import InputError, array

AGREE = (0.1, 0.3)  # m that a beam may be off
AGREEMENTS = ("agreement_01", "agreement_03")
TOLERATED = 0.05  # share of records at which a localized robot may seem off: references err, too


@dataclass(frozen=True, kw_only=True)
class PoseErrors:
    """Errors of poses, in position and heading.

    Attributes:
        translation: lengths, (n,): evo's ``trans_part``.
        rotation: rad in [0, π], (n,): evo's ``angle_rad``.
    """

    translation: Floats
    rotation: Floats

    @property
    def rmse(self) -> float:
        """Root mean square of the translations, evo's first figure; NaN of nothing."""
        return float(np.sqrt(mean(np.square(self.translation))))


def absolute(estimate: Floats, reference: Floats) -> PoseErrors:
    """APE: how far each pose (n, 3) is from its reference (n, 3), without any alignment.

    A localizer estimates in the map's frame: an alignment would hide its error.
    """
    given, true = _pairs(estimate, reference)
    return _errors(relative(true, given))


def relative_errors(estimate: Floats, reference: Floats) -> PoseErrors:
    """RPE: how far the motion from pose to pose is from that of the reference."""
    given, true = _pairs(estimate, reference)
    driven, meant = (relative(poses[:-1], poses[1:]) for poses in (given, true))
    return _errors(relative(meant, driven))


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
    """The best clusters at the first n records of a log, and their errors.

    Attributes:
        log: with its reference, if it has one.
        best: means of the best clusters, (x, y, θ), (n, 3); NaN where there is no estimate.
    """

    log: Log
    best: Floats

    @cached_property
    def referenced(self) -> Indices:
        """The records with a reference, in order."""
        return self.log.referenced[self.log.referenced < len(self.best)]

    @cached_property
    def known(self) -> Indices:
        """The records with a reference and an estimate, in order."""
        known: Indices = self.referenced[np.isfinite(self.best[self.referenced, 0])]
        return known

    @cached_property
    def way(self) -> Floats:
        """Metres driven at each record, by odometry."""
        return self.log.driven[: len(self.best)] / metre(self.log.unit)

    @cached_property
    def errors(self) -> PoseErrors:
        """APE at the records with a reference, m."""
        return self._in_metres(absolute, 1)

    @cached_property
    def relative(self) -> PoseErrors:
        """RPE from record to record, m."""
        return self._in_metres(relative_errors, 2)

    @cached_property
    def at_stamps(self) -> Indices:
        """Which of the known records are at times of the reference's own poses."""
        between = self.log.interpolated
        own = np.ones(self.known.size, bool) if between is None else ~between[self.known]
        return np.flatnonzero(own)

    def fixes(self, quality: Floats | None = None) -> Fixes:
        """Where the best cluster is, at the records with a reference; ``quality`` of all, (n,)."""
        unrated = np.full(len(self.best), math.nan)
        off, at = np.full((len(self.best), 2), math.inf), self.referenced
        off[self.known] = np.column_stack([self.errors.translation, self.errors.rotation])
        return Fixes(
            steps=at,
            count=len(self.best),
            way=self.way[at],
            distance=off[at, 0],
            angle=off[at, 1],
            quality=(unrated if quality is None else quality)[at],
            tolerated=TOLERATED,
        )

    def journey(self, quality: Floats | None = None) -> Journey:
        """Return the whole run, which ``TRACK_GROUPS`` score; ``quality`` as of ``fixes``."""
        return Journey(fixes=self.fixes(quality), driven=self.way, truth=self.best)

    @property
    def lost(self) -> tuple[int, float] | None:
        """The record from which on it is never again within 1 m and 30°, and the way there, m."""
        fixes = self.fixes()
        first = fixes.lost_at
        return None if first is None else (int(fixes.steps[first]), float(fixes.way[first]))

    def _in_metres(self, of: Callable[[Floats, Floats], PoseErrors], least: int) -> PoseErrors:
        if self.log.reference is None or self.known.size < least:
            return PoseErrors(translation=np.empty(0), rotation=np.empty(0))
        found = of(self.best[self.known], self.log.reference[self.known])
        lengths = found.translation / metre(self.log.unit)
        return PoseErrors(translation=lengths, rotation=found.rotation)


@dataclass(frozen=True)
class ScoredTrack:
    """What the scores of a track by records are of.

    Attributes:
        calibrated: rank of the reference, NEES and log score at each record, (n, 3); NaN is
            unknown. Those at the reference's own times count, or all if none of them is known.
        floor_plan: the map; None: agreement is not available.
        judged: first record by which beliefs are judged.
    """

    track: EstimatedTrack
    calibrated: Floats
    thresholds: Thresholds
    floor_plan: Map | None
    judged: int

    def known(self, column: int) -> Floats:
        """Return what is known of a column of ``calibrated``, at the records that count."""
        at = self.track.known[self.track.at_stamps]
        stamped = self.calibrated[at[at >= self.judged]]
        beliefs = stamped if np.isfinite(stamped).any() else self.calibrated[self.judged :]
        values = beliefs[:, column]
        return values[np.isfinite(values)]

    @property
    def lost(self) -> float:
        """1 if it is lost in the last steps, else 0; NaN of none."""
        last = self.track.errors.translation[-self.thresholds.lost_steps :]
        limit = self.thresholds.lost / metre(self.track.log.unit)
        return float(last.mean() > limit) if last.size else math.nan

    @property
    def log_score(self) -> float:
        """Mean log score, of a density per m² rad."""
        return mean(self.known(2)) - 2 * math.log(metre(self.track.log.unit))

    @cached_property
    def agreement(self) -> tuple[float, ...]:
        """Shares of the beams that agree with the map at the best clusters."""
        if self.floor_plan is None:
            return (math.nan,) * len(AGREE)
        seen = np.flatnonzero(np.isfinite(self.track.best[:, 0]))
        return agreement(self.track.log.of_records(seen), self.floor_plan, self.track.best[seen])


def calibration_of_gaussians(
    poses: Floats, covariances: Floats, truth: Floats, unit: str
) -> Floats:
    """Rank of the truth, NEES and log score of N(pose, P), as ``clouds.calibration``, (n, 3).

    The rank is P(D(X) < D(z)) in (x, y), 1 - exp(-D²/2); NEES is dᵀ P⁻¹ d in (x, y, θ), the log
    score ½ (NEES + log det 2πP). NaN where pose, covariance or truth is.
    """
    off = truth - poses
    known = np.isfinite(off).all(axis=1) & np.isfinite(covariances).all(axis=(1, 2))
    off[:, 2] = arrays.wrapped(off[:, 2])
    found = np.full((len(poses), 3), math.nan)
    fitted = np.empty((int(known.sum()), 3))
    floor = covariance_floor(unit)
    fits(off[known], covariances[known] + np.diag(floor), fitted)
    found[known] = np.column_stack([1 - arrays.exp(-fitted[:, 0] / 2), fitted[:, 1:]])
    return found


def _errors(off: Floats) -> PoseErrors:
    return PoseErrors(
        translation=np.hypot(off[:, 0], off[:, 1]), rotation=np.abs(arrays.wrapped(off[:, 2]))
    )


def _pairs(estimate: Floats, reference: Floats) -> tuple[Floats, Floats]:
    """Return the poses that have a reference."""
    given = array("the estimate", estimate, (None, 3))
    true = np.asarray(reference, dtype=np.float64)
    if true.shape != given.shape:
        raise InputError(
            f"the reference has shape {true.shape}, but must have that of the estimate, "
            f"{given.shape}."
        )
    known = np.isfinite(true).all(axis=1)
    if not known.any():
        raise InputError("no pose has a reference, so there is no error.")
    return given[known], true[known]
