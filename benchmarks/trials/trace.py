"""What is kept of an episode: beliefs about each state by offset, and the whole run if asked."""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.clouds import (
    Cloud,
    Clouds,
    Surroundings,
    belief_moments,
    cloud_of,
    joined,
    measured,
)
from benchmarks.trials.episode import Step
from benchmarks.trials.scores import TRACK_GROUPS, Estimates, ScoreGroup, track_scores
from benchmarks.trials.tracks import (
    FOUND,
    NEAR,
    EstimatedTrack,
    Journey,
    columns_of,
    half_turned,
    mean,
    way_driven,
)
from deqmcl_gym.logs import Log
from deqmcl_gym.maps import Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Floats, Indices, Reals, arrays
from deqmcl_gym.validation import InputError
from localizers import Calibration, best_cluster, quality_of
from localizers.calibration import spread_about
from localizers.models.feasibility import PlanSensor
from localizers.models.motion import increments

_READ = ("feasible", "tempering", "log_evidence")  # of ``PlanReading``
PLAN_COLUMNS = ("conflict", *_READ, "trusted")
Measure = Callable[[Clouds], Floats]  # a row for each cloud, (k, c)
PROFILE_STRIDE = 5  # states between those at which the error is taken at every offset


def plan_row(belief: Any, truth: Reals, task: Surroundings) -> list[float]:
    """Return whether the plan collides from the true pose, then signals; NaN if none was read."""
    reading = getattr(belief, "plan_reading", None)
    if reading is None or np.isnan(reading.feasible):
        return [math.nan] * len(PLAN_COLUMNS)
    sensor = PlanSensor(floor_plan=task.floor_plan, radius=task.radius)
    pose = np.asarray(truth, np.float32)[:, None]
    known = np.isfinite(pose).all()
    conflict = float(sensor.collisions(pose, reading.seen)[0] > 0) if known else np.nan
    trusted = float(getattr(belief, "trusted", np.nan))
    return [conflict, *(float(getattr(reading, name)) for name in _READ), trusted]


def plan_columns(rows: Sequence[Sequence[float]]) -> dict[str, list[float | None]] | None:
    """Return the rows of steps as columns by name; None if no plan was read."""
    return None if np.isnan(rows).all() else columns_of(PLAN_COLUMNS, rows)


class JourneyLog:
    """Collects a run in a world, to be scored by ``groups``; a step's best cluster once."""

    def __init__(self, task: Surroundings, groups: Sequence[ScoreGroup]) -> None:
        self.groups, self._map, self._radius = groups, task.floor_plan, task.radius
        self._turned = any(group.name == "ambiguity" for group in groups)
        self._steps: list[tuple[bool, Any, Any]] = []  # contact, goal, route
        self._fixes: list[list[float]] = []  # x, y, θ, masses

    def see(self, step: Step) -> None:
        """Take in a step."""
        self._steps.append((step.collided, step.goal, step.route))
        points: Any = step.belief.points()
        poses, weights = np.asarray(points[0]), np.asarray(points[1], np.float64)
        row = [*best_cluster(poses, weights, unit=self._map.unit).mean]
        if self._turned:
            here = np.asarray(step.truth, np.float64)
            there = half_turned(self._map, here[None])[0]
            near = (NEAR[FOUND](poses, at, unit=self._map.unit) for at in (here, there))
            row += [float(weights[which].sum()) for which in near]
        self._fixes.append(row)

    def journey(self, trace: "Trace") -> Journey:
        """Return the run that has this trace."""
        length, table = metre(self._map.unit), np.array(self._fixes, np.float64)
        size = np.array([length, length, 1.0])
        off = trace.truth / size - table[:, :3] / size
        way = way_driven([action for action in trace.actions if action is not None]) / length
        (_, _, route), (_, goal, _) = self._steps[0], self._steps[-1]
        planned = math.nan if route is None else np.hypot(*np.diff(route, axis=0).T).sum()
        room = self._map.distance(trace.truth[:, :2]).min() - self._radius
        return Journey(
            steps=np.arange(len(table)),
            way=way,
            distance=np.hypot(off[:, 0], off[:, 1]),
            angle=np.abs(arrays.wrapped(off[:, 2])),
            quality=trace.quality,
            driven=way,
            truth=trace.truth / size,
            collided=np.array([collided for collided, _, _ in self._steps]),
            clearance=float(room) / length,
            goal=None if goal is None else np.asarray(goal, np.float64) / length,
            planned=float(planned) / length,
            masses=table[:, 3:] if self._turned else None,
        )


class TrackLog:
    """Collects the track of a run on a log, and scores it by its records."""

    groups = TRACK_GROUPS

    def __init__(self, log: Log, floor_plan: Map, thresholds: Thresholds, judged: int) -> None:
        self._log, self._map, self._thresholds, self._judged = log, floor_plan, thresholds, judged
        self._best: list[tuple[float, float, float]] = []
        self._spread: list[Floats] = []

    def see(self, step: Step) -> None:
        """Take in a record."""
        points: Any = step.belief.points()
        best = best_cluster(*points, unit=self._log.unit).mean
        self._best.append(best)
        self._spread.append(spread_about(best, *points))

    @property
    def track(self) -> EstimatedTrack:
        """The track so far."""
        return EstimatedTrack(self._log, np.array(self._best, np.float64), np.array(self._spread))

    def scores(self) -> dict[str, float]:
        """Return the scores by records that no journey has; NaN is not available."""
        track, judged = self.track, self._judged
        calibration = calibration_of(track, judged)
        return track_scores(track, judged, calibration, self._thresholds, self._map)

    def journey(self, trace: "Trace") -> Journey | None:
        """Return the run that has this trace; None without a reference."""
        track = self.track
        return track.journey(trace.quality) if track.known.size else None


def calibration_of(track: EstimatedTrack, judged: int) -> Calibration | None:
    """Return the calibration that fits the records before one; None if there are none."""
    if not judged or track.spread is None:
        return None
    off, spread = track.deviations(0, judged)
    return Calibration.fitted(off, spread) if len(off) else None


class Trace:
    """An episode that is run to its end: what was believed at these offsets, and what is counted.

    ``whole`` collects the run: it trusts the form of a belief.
    """

    def __init__(
        self,
        episode: Iterable[Step],
        offsets: Iterable[int],
        task: Surroundings,
        whole: JourneyLog | TrackLog | None = None,
    ) -> None:
        self.task, self.whole, asked = task, whole, tuple(offsets)
        self.lag = max(map(abs, asked), default=0)  #: L
        self._seconds: list[float] = []  # of the localizer's updates
        self.plans: list[list[float]] = []  #: ``plan_row`` after step t = 0 … T
        self.poses: list[Reals] = []  #: the true ones so far
        self.actions: list[Reals | None] = []  #: that led there
        self._ranges: list[Reals] = []
        self._rated: list[float | None] = []
        self._belief: Any = None
        apart = max(1, self.lag // 4)  # four on either side of the present
        farthest = self.lag // apart * apart
        between = [k for k in range(-farthest, farthest + 1, apart) if k not in asked]
        self._scored = _Beliefs(self, asked, partial(measured, task=task))
        self._sampled = _Beliefs(self, between, belief_moments, PROFILE_STRIDE)
        for step in episode:
            self._see(step)

    def _see(self, step: Step) -> None:
        self._belief = step.belief
        self.poses.append(step.truth)
        self.actions.append(step.action)
        self._rated.append(quality_of(step.belief))
        self.plans.append(plan_row(step.belief, step.truth, self.task))
        if step.t > 0:
            self._seconds.append(step.seconds)
            self._ranges.append(step.ranges)
        for collector in (self._scored, self._sampled, self.whole):
            if collector is not None:
                collector.see(step)

    @cached_property
    def truth(self) -> Floats:
        """The true poses x_0 … x_T, (T + 1, 3); NaN where a log has no reference."""
        return np.array(self.poses, np.float64)

    @property
    def steps(self) -> int:
        """Steps carried out, T."""
        return len(self.poses) - 1

    @cached_property
    def offsets(self) -> dict[int, Estimates]:
        """What was believed at the offsets that the localizer holds."""
        return {
            offset: Estimates(
                states=states,
                truth=self.truth[states],
                table=table,
                common=(states >= self.lag) & (states <= self.steps - self.lag),
                thresholds=self.task.thresholds,
                unit=self.task.floor_plan.unit,
            )
            for offset, (states, table) in self._scored.tables().items()
        }

    @cached_property
    def profile(self) -> dict[int, tuple[Indices, Floats]]:
        """States (k,), each ``PROFILE_STRIDE``-th, and moments (k, 8), by offsets between those."""
        return self._sampled.tables()

    @property
    def seconds(self) -> float:
        """The localizer's time, reset left out.

        The first update may compile: the mean of the others stands for it.
        """
        return self.steps * mean(np.array(self._seconds[1:] or self._seconds))

    @property
    def quality(self) -> Floats:
        """Confidence that it is not lost after step t = 0 … T, (T + 1,); NaN for none."""
        return np.array(self._rated, np.float64)

    @property
    def scans_used(self) -> int:
        """Scans with at least one beam that is a number in [0, max_range]."""
        ranges = np.array(self._ranges, np.float64)
        usable = (ranges >= 0.0) & (ranges <= self.task.max_range)  # false for NaN
        return int(usable.any(axis=-1).sum())

    @property
    def events(self) -> dict[str, int]:
        """The localizer's counts of trouble."""
        events = getattr(self._belief, "events", None)
        return {} if events is None else {name: int(n) for name, n in vars(events).items()}


class _Beliefs:
    """Collects what is believed at some offsets about every n-th state, measured in passes."""

    def __init__(
        self, trace: Trace, offsets: Sequence[int], measure: Measure, stride: int = 1
    ) -> None:
        self._trace, self._offsets, self._measure, self._stride = trace, offsets, measure, stride
        self._ahead: dict[int, list[Cloud]] = {}
        self._due: list[Cloud] = []
        self._points = 0  # of those due
        self._rows: dict[int, dict[int, Floats]] = {k: {} for k in self._offsets}

    def see(self, step: Step) -> None:
        for offset in self._offsets:
            state = step.t + offset
            if state < 0 or state % self._stride:
                continue
            if (points := step.belief.points(offset)) is not None:
                cloud = cloud_of(state, offset, points)
                self._ahead.setdefault(max(state, step.t), []).append(cloud)
            elif offset == 0:
                raise InputError(f"its belief of state {state} holds no points of the present.")
        for cloud in self._ahead.pop(step.t, ()):
            self._due.append(cloud)
            self._points += cloud.weights.size
        if self._points >= 16384:  # they fit a core's second cache
            self._measure_due()

    def tables(self) -> dict[int, tuple[Indices, Floats]]:
        """By offset: the states and a row of each, (k, c); what is held of no state is out."""
        self._measure_due()
        held = {k: rows for k, rows in self._rows.items() if rows}
        return {k: (np.array([*rows]), np.array([*rows.values()])) for k, rows in held.items()}

    def _measure_due(self) -> None:
        if self._due:
            states = [cloud.state for cloud in self._due]
            moves = np.zeros((len(states), 3))
            actions = self._trace.actions
            commands = {k: actions[s] for k, s in enumerate(states) if actions[s] is not None}
            if commands:
                moves[[*commands]] = increments(np.array([*commands.values()]))
            clouds = joined(self._due, [self._trace.poses[s] for s in states], moves)
            for cloud, row in zip(self._due, self._measure(clouds), strict=True):
                self._rows[cloud.offset][cloud.state] = row
            self._due, self._points = [], 0
