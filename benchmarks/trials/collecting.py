"""What is kept of a whole run, its journey in a world or track on a log, and how it is recorded."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.clouds import Surroundings
from benchmarks.trials.episode import Step
from benchmarks.trials.scores import (
    JOURNEY_SCORES,
    TRACK_GROUPS,
    ScoreGroup,
    journey_scores,
    track_scores,
)
from benchmarks.trials.tracks import (
    EstimatedTrack,
    Journey,
    ScoredTrack,
    half_turned,
    way_driven,
    weight_near,
)
from deqmcl_gym.logs import Log
from deqmcl_gym.maps import Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Floats, Reals, arrays
from deqmcl_gym.validation import InputError
from localizers import Calibration, best_cluster, quality_of
from localizers.calibration import spread_about

Number = Annotated[float, Meta(ge=-1e100, le=1e100)]  # of a record: squares are finite


_ENTRIES = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # of a symmetric matrix, in its upper half
_UPPER = np.triu_indices(3)


class WholeRun(Struct, frozen=True, kw_only=True):
    """What a trial's record has of its whole run; a score that is None is censored or unknown.

    All curves are at the same steps; "way" is what was driven until then, m.
    """

    scores: dict[str, Number | None]
    curves: dict[str, list[Number]]

    def __post_init__(self) -> None:
        if other := self.scores.keys() - JOURNEY_SCORES.keys():
            raise ValueError(f"has a score of the whole run named {min(other)[:20]!r}")


class RecordedTrack(Struct, frozen=True, kw_only=True):
    """What the record of a trial on a whole log has of it: best clusters, x, y, θ; scores."""

    best: tuple[list[Number], list[Number], list[Number]]
    scores: dict[str, Number | None]
    # second moments of the belief about them: xx, xy, xθ, yy, yθ, θθ; None unknown
    spread: list[list[Number | None]] | None = None

    def on(self, log: Log) -> EstimatedTrack:
        """Return the track on the log that it is of."""
        best = np.array(self.best).T
        if self.spread is None:
            return EstimatedTrack(log, best)
        rows = np.array(self.spread, np.float64).T[:, _ENTRIES]
        return EstimatedTrack(log, best, rows)


def calibration_of(track: EstimatedTrack, judged: int) -> Calibration | None:
    """Return the calibration that fits the records before one; None if there are none."""
    if not judged or track.spread is None:
        return None
    off, spread = track.deviations(0, judged)
    return Calibration.fitted(off, spread) if len(off) else None


def if_finite(scores: Mapping[str, float]) -> dict[str, float | None]:
    """Return scores as a record has them: an infinite one and an unknown one are None."""
    return {name: value if math.isfinite(value) else None for name, value in scores.items()}


def unless_nan(values: Iterable[float]) -> list[float | None]:
    """Return values with None for NaN, which JSON does not have."""
    return [None if math.isnan(value) else value for value in values]


def whole_run(run: Journey, groups: Sequence[ScoreGroup]) -> WholeRun:
    """Return what a record has of a run; curves have four digits, as a long run is many numbers."""
    curves = {"way": run.way, "distance": run.distance, "angle": run.angle}
    if run.masses is not None:
        curves |= dict(zip(("mass_truth", "mass_twin"), run.masses.T, strict=True))
    rounded = {name: [float(f"{v:.4g}") for v in values] for name, values in curves.items()}
    return WholeRun(scores=if_finite(journey_scores(run, groups)), curves=rounded)


class JourneyLog:
    """Collects a run from its moments; the best cluster is sought once a step."""

    def __init__(self, task: Surroundings, groups: Sequence[ScoreGroup]) -> None:
        self._task, self._groups = task, groups
        self._metre = metre(task.floor_plan.unit)
        self._turned = any(group.name == "ambiguity" for group in groups)
        self._truth: list[Reals] = []
        self._commanded: list[Reals] = []
        self._collided: list[bool] = []
        self._fixes: list[list[float]] = []  # x, y, θ, quality, masses
        self._goal: Reals | None = None
        self._planned = math.nan

    def see(self, moment: Step) -> None:
        """Take in a step."""
        self._truth.append(moment.truth)
        self._collided.append(moment.collided)
        self._goal = moment.goal
        if moment.t == 0 and moment.route is not None:
            self._planned = float(np.hypot(*np.diff(moment.route, axis=0).T).sum())
        if moment.action is not None:
            self._commanded.append(moment.action)
        points: Any = moment.belief.points()
        unit, quality = self._task.floor_plan.unit, quality_of(moment.belief)
        poses, weights = np.asarray(points[0]), np.asarray(points[1], np.float64)
        row = [*best_cluster(poses, weights, unit=unit).mean]
        row.append(math.nan if quality is None else quality)
        if self._turned:
            here = np.asarray(moment.truth, np.float64)
            there = half_turned(self._task.floor_plan, here[None])[0]
            row += [weight_near(poses, weights, at, unit) for at in (here, there)]
        self._fixes.append(row)

    def kept(self) -> tuple[WholeRun, None]:
        """Return the part of a record about this run."""
        return whole_run(self.journey(), self._groups), None

    def journey(self) -> Journey:
        """Return the run so far."""
        size = np.array([self._metre, self._metre, 1.0])
        truth = np.array(self._truth, np.float64) / size
        table = np.array(self._fixes, np.float64)
        off = truth - table[:, :3] / size
        way = way_driven(self._commanded) / self._metre
        goal = None if self._goal is None else np.asarray(self._goal, np.float64) / self._metre
        room = self._task.floor_plan.distance(np.array(self._truth, np.float64)[:, :2])
        distance, angle = np.hypot(off[:, 0], off[:, 1]), np.abs(arrays.wrapped(off[:, 2]))
        return Journey(
            steps=np.arange(len(truth)),
            way=way,
            distance=distance,
            angle=angle,
            quality=table[:, 3],
            driven=way,
            truth=truth,
            collided=np.array(self._collided),
            clearance=float(room.min() - self._task.radius) / self._metre,
            goal=goal,
            planned=self._planned / self._metre,
            masses=table[:, 4:] if self._turned else None,
        )


class TrackLog:
    """Collects the track of a run on a log, and scores it by its records."""

    def __init__(self, log: Log, floor_plan: Map, thresholds: Thresholds, judged: int) -> None:
        self._log, self._map, self._thresholds, self._judged = log, floor_plan, thresholds, judged
        self._best: list[tuple[float, float, float]] = []
        self._spread: list[Floats] = []
        self._quality: list[float] = []

    def see(self, moment: Step) -> None:
        """Take in a record."""
        points = moment.belief.points()
        if points is None:
            raise InputError(f"its belief of state {moment.t} holds no points of the present.")
        best = best_cluster(*points, unit=self._log.unit).mean
        quality = quality_of(moment.belief)
        self._best.append(best)
        self._spread.append(spread_about(best, *points))
        self._quality.append(math.nan if quality is None else quality)

    @property
    def track(self) -> EstimatedTrack:
        """The track so far."""
        return EstimatedTrack(self._log, np.array(self._best, np.float64), np.array(self._spread))

    def scores(self) -> dict[str, float]:
        """Return the scores by records that no journey has; NaN is not available."""
        track, judged = self.track, self._judged
        calibration = calibration_of(track, judged)
        return track_scores(ScoredTrack(track, judged, calibration, self._thresholds, self._map))

    def kept(self) -> tuple[WholeRun | None, RecordedTrack]:
        """Return the parts of a record about this run: a journey, with a reference, and a track."""
        track = self.track
        x, y, heading = track.best.T.tolist()
        entries = np.array(self._spread)[:, *_UPPER].T
        spread = [unless_nan(float(f"{v:.8g}") for v in row) for row in entries]
        scores = if_finite(self.scores())
        recorded = RecordedTrack(best=(x, y, heading), scores=scores, spread=spread)
        if not track.known.size:
            return None, recorded
        run = track.journey(np.array(self._quality))
        return whole_run(run, TRACK_GROUPS), recorded
