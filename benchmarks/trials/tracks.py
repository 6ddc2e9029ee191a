"""What a localizer estimated at each record of a log, how far off it was, and how that is scored.

Errors are those of the best cluster, as evo computes them: absolute (APE) and relative (RPE). All
lengths of scores are in m.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.clouds import (
    LOG_TURN,
    belief_moments,
    calibration,
    cloud_of,
    covariance_floor,
    joined,
)
from benchmarks.trials.episode import Moment
from benchmarks.trials.fixes import NEAR, Fixes, metre
from benchmarks.trials.journeys import (
    Journey,
    RecordedTrack,
    WholeRun,
    finite,
    groups_named,
    whole_run,
)
from benchmarks.trials.metrics import LEVELS, mean
from deqmcl_gym.logs import Log
from deqmcl_gym.logs.motion import relative
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Indices
from deqmcl_gym.validation import InputError, array
from localizers import best_cluster, quality_of

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
    """Share of the beams with a return that are within 0.1 m and 0.3 m of what the map says.

    Args:
        log: n records.
        floor_plan: the map.
        poses: assumed for each scan, (n, 3).
    """
    expected = log.scanner.ranges(floor_plan, poses.T)
    seen = np.isfinite(log.ranges)
    with np.errstate(invalid="ignore"):
        off = np.abs(expected - log.ranges)[seen] / metre(log.unit)
    within, well = ((off <= most).mean() if off.size else math.nan for most in AGREE)
    return float(within), float(well)


@dataclass(frozen=True)
class Track:
    """The best clusters at the first n records of a log, and their errors.

    Attributes:
        log: with its reference, if it has one.
        best: means of the best clusters, (x, y, θ), (n, 3); NaN where there is no estimate.
    """

    log: Log
    best: Floats
    GROUPS: ClassVar = groups_named(["lost", "log"])

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
        """Where the best cluster is, at the records with a reference; nowhere without an estimate.

        Args:
            quality: confidence that it is not lost at each record, (n,).
        """
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
        """Return the whole run, which ``GROUPS`` score; ``quality`` as of ``fixes``."""
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


class TrackLog:
    """Collects the track of a run on a log, and scores it by its records.

    Beside the metrics of a trial, which are of the belief's mean at the steps t ≥ 1.
    """

    def __init__(self, log: Log, floor_plan: Map, thresholds: Thresholds, judged: int) -> None:
        self._log, self._map, self._thresholds, self._judged = log, floor_plan, thresholds, judged
        self._best: list[tuple[float, float, float]] = []
        self._rows: list[tuple[float, ...]] = []  # rank, NEES, log score, quality

    def see(self, moment: Moment) -> None:
        """Take in a record."""
        points = moment.belief.points()
        if points is None:
            raise InputError(f"its belief of state {moment.step} holds no points of the present.")
        clouds = joined([cloud_of(moment.step, 0, points)], [moment.truth])
        means = belief_moments(clouds)[:, :4]
        calibrated = [math.nan] * 3
        if np.isfinite(moment.truth).all():
            _, *calibrated = calibration(clouds, means, self._log.unit)[0].tolist()
        quality = quality_of(moment.belief)
        self._rows.append((*calibrated, math.nan if quality is None else quality))
        self._best.append(best_cluster(*points, unit=self._log.unit).mean)

    @property
    def track(self) -> Track:
        """The track so far."""
        return Track(self._log, np.array(self._best, np.float64))

    def scores(self) -> dict[str, float]:
        """Return the scores by records that no journey has; NaN is not available."""
        calibrated = np.array(self._rows)[:, :3]
        return track_scores(
            self.track, calibrated, self._thresholds, self._map, judged=self._judged
        )

    def kept(self) -> tuple[WholeRun | None, RecordedTrack]:
        """Return the parts of a record about this run: a journey, with a reference, and a track."""
        track = self.track
        x, y, heading = track.best.T.tolist()
        recorded = RecordedTrack(best=(x, y, heading), scores=finite(self.scores()))
        if not track.known.size:
            return None, recorded
        run = track.journey(np.array(self._rows)[:, 3])
        return whole_run(run, Track.GROUPS), recorded


def track_scores(
    track: Track,
    calibrated: Floats,
    thresholds: Thresholds,
    floor_plan: Map | None,
    *,
    judged: int = 0,
) -> dict[str, float]:
    """Return the scores of a track by records; NaN is not available.

    Args:
        track: of n records.
        calibrated: rank of the reference, NEES and log score at each record, (n, 3); NaN is
            unknown. Those at the reference's own times count, or all if none of them is known.
        thresholds: what counts as lost.
        floor_plan: the map; None: agreement is not available.
        judged: first record by which beliefs are judged.
    """
    errors, own = track.errors, track.at_stamps
    at = track.known[own]
    stamped = calibrated[at[at >= judged]]
    beliefs = stamped if np.isfinite(stamped).any() else calibrated[judged:]
    ranks, nees, logs = (known[np.isfinite(known)] for known in beliefs.T)
    last = errors.translation[-thresholds.lost_steps :]
    limit = thresholds.lost / metre(track.log.unit)
    fixes, agreed = track.fixes(), (math.nan,) * len(AGREE)
    if floor_plan is not None:
        seen = np.flatnonzero(np.isfinite(track.best[:, 0]))
        agreed = agreement(track.log.of_records(seen), floor_plan, track.best[seen])
    return {
        **{f"within_{near}": mean(fixes.localized(near).astype(np.float64)) for near in NEAR},
        "position_median": middle(errors.translation),
        "position_p95": float(np.quantile(errors.translation, 0.95))
        if track.known.size
        else math.nan,
        "heading_median": middle(errors.rotation),
        "position_median_stamps": middle(errors.translation[own]),
        "heading_median_stamps": middle(errors.rotation[own]),
        "lost": float(last.mean() > limit) if last.size else math.nan,
        **{f"coverage_{p}": mean((ranks <= p / 100).astype(np.float64)) for p in LEVELS},
        "nees": mean(nees),
        "log_score": mean(logs) - 2 * math.log(metre(track.log.unit)),  # of a density per m² rad
        "ape_rmse": errors.rmse,
        "rpe_rmse": track.relative.rmse,
        **dict(zip(AGREEMENTS, agreed, strict=True)),
    }


def calibration_of_gaussians(
    poses: Floats, covariances: Floats, truth: Floats, unit: str
) -> Floats:
    """Rank of the truth, NEES and log score of N(pose, P), as ``clouds.calibration``, (n, 3).

    The rank is P(D(X) < D(z)) in (x, y), 1 - exp(-D²/2); NEES is dᵀ P⁻¹ d in (x, y, θ), the log
    score ½ (NEES + log det 2πP). NaN where pose, covariance or truth is.

    Args:
        poses: means, (n, 3).
        covariances: P, (n, 3, 3).
        truth: z, (n, 3).
        unit: of lengths.
    """
    off = truth - poses
    known = np.isfinite(off).all(axis=1) & np.isfinite(covariances).all(axis=(1, 2))
    found = np.full((len(poses), 3), math.nan)
    p = covariances[known] + np.diag(covariance_floor(unit))
    dx, dy, turned = off[known].T
    g00 = np.sqrt(p[:, 0, 0])  # Cholesky, P = G Gᵀ, G u = d
    g10, g20 = p[:, 1, 0] / g00, p[:, 2, 0] / g00
    g11 = np.sqrt(p[:, 1, 1] - g10 * g10)
    g21 = (p[:, 2, 1] - g20 * g10) / g11
    g22 = np.sqrt(p[:, 2, 2] - g20 * g20 - g21 * g21)
    u0 = dx / g00
    u1 = (dy - g10 * u0) / g11
    u2 = (arrays.wrapped(turned) - g20 * u0 - g21 * u1) / g22
    distance = u0 * u0 + u1 * u1
    nees = distance + u2 * u2
    logs = 0.5 * (nees + 3 * LOG_TURN) + arrays.log(g00 * g11 * g22)
    found[known] = np.column_stack([1 - arrays.exp(-distance / 2), nees, logs])
    return found


def middle(values: Floats) -> float:
    """Median; NaN of nothing."""
    return float(np.median(values)) if values.size else math.nan


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
