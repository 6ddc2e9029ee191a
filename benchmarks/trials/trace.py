"""What is kept of an episode: beliefs about each state by offset, and how each plan was read."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.clouds import (
    Cloud,
    Clouds,
    Surroundings,
    belief_moments,
    belief_scores,
    cloud_of,
    joined,
)
from benchmarks.trials.collecting import JourneyLog, RecordedTrack, TrackLog, WholeRun, unless_nan
from benchmarks.trials.episode import Step
from benchmarks.trials.map_signals import MapSignals
from benchmarks.trials.scores import METRICS, Estimates
from deqmcl_gym.numerics import Floats, Indices, Reals
from deqmcl_gym.validation import InputError
from localizers import Belief, quality_of
from localizers.models.feasibility import PlanSensor
from localizers.models.motion import increments

_READ = ("feasible", "tempering", "log_evidence")  # of ``PlanReading``
PLAN_COLUMNS = ("conflict", *_READ, "trusted")
PROFILE_STRIDE = 5  # states between those at which the error is taken at every offset
_PROFILE_OFFSETS = 4  # on either side of the present
_BATCH = 16384  # poses measured in one pass: they fit a core's second cache
_CALIBRATION = ("energy", "rank", "nees", "log_score", "outlier_share")
_EACH = {metric.name: metric.each for metric in METRICS if metric.each}


def plan_row(belief: Any, truth: Reals, task: Surroundings) -> list[float]:
    """Return whether the plan collides from the true pose, then signals; NaN if none was read."""
    reading = getattr(belief, "plan_reading", None)
    if reading is None or np.isnan(reading.feasible):
        return [np.nan] * len(PLAN_COLUMNS)
    sensor = PlanSensor(floor_plan=task.floor_plan, radius=task.radius)
    pose = np.asarray(truth, np.float32)[:, None]
    known = np.isfinite(pose).all()
    conflict = float(sensor.collisions(pose, reading.seen)[0] > 0) if known else np.nan
    trusted = float(getattr(belief, "trusted", np.nan))
    return [conflict, *(float(getattr(reading, name)) for name in _READ), trusted]


def plan_columns(rows: Sequence[Sequence[float]]) -> dict[str, list[float | None]] | None:
    """Return the rows of the steps t = 1 … T as columns by name; None if no plan was read."""
    table: Floats = np.array(rows, np.float64).reshape(len(rows), len(PLAN_COLUMNS))
    if np.isnan(table).all():
        return None
    return dict(zip(PLAN_COLUMNS, map(unless_nan, table.T.tolist()), strict=True))


@dataclass(frozen=True, kw_only=True)
class Trace:
    """An episode as arrays."""

    unit: str  # of lengths
    thresholds: Thresholds
    lag: int  # L, the farthest offset that was asked for
    truth: Floats  # the true poses x_0 … x_T, (T + 1, 3); NaN where a log has no reference
    offsets: dict[int, Estimates]  # what was believed; offsets that the localizer holds
    scans_used: int  # scans with at least one beam in range
    seconds: float  # the localizer's time, reset left out
    quality: Floats  # confidence that it is not lost after step t = 0 … T, (T + 1,); NaN for none
    plans: list[list[float]] = field(default_factory=list)  # ``plan_row`` after step t = 0 … T
    events: dict[str, int] = field(default_factory=dict)  # the localizer's counts of trouble
    journey: WholeRun | None = None  # what is kept of the whole run; None if that is not asked for
    track: RecordedTrack | None = None  # likewise
    # means of (x, y, cos θ, sin θ) at more offsets, by offset: states (k,) and means (k, 4), at
    # every ``PROFILE_STRIDE``-th state
    profile: dict[int, tuple[Indices, Floats]] = field(default_factory=dict)
    # columns of ``map_signals`` after step t = 1 … T; None where the world is as on the map
    against_map: dict[str, list[float | None]] | None = None

    @property
    def steps(self) -> int:
        """Steps carried out, T."""
        return len(self.truth) - 1


def trace_of(
    episode: Iterable[Step],
    offsets: Iterable[int],
    task: Surroundings,
    whole: JourneyLog | TrackLog | None = None,
    against: MapSignals | None = None,
) -> Trace:
    """Run an episode to its end; keep its trace at these offsets, and what ``whole`` keeps.

    ``against`` collects what contradicts the map, where the world differs from it.
    """
    asked = tuple(offsets)
    lag = max(map(abs, asked), default=0)
    lap = _Lap(task)
    scored = _Beliefs(asked, lap, partial(_measured, task=task))
    sampled = _Beliefs(_between(asked, lag), lap, belief_moments, stride=PROFILE_STRIDE)
    for moment in episode:
        for collector in (lap, scored, sampled):
            collector.see(moment)
        for own in (whole, against):
            if own is not None:  # it trusts the form of a belief
                own.see(moment)
    journey, track = (None, None) if whole is None else whole.kept()
    events = getattr(lap.belief, "events", None)
    unit, truth = task.floor_plan.unit, np.array(lap.truth, np.float64)
    return Trace(
        unit=unit,
        thresholds=task.thresholds,
        lag=lag,
        truth=truth,
        offsets={
            k: Estimates(
                states=states,
                truth=truth[states],
                means=table[:, :4].copy(),
                variances=table[:, 4:8].copy(),
                values=dict(zip((*_CALIBRATION, *_EACH), table[:, 8:].T.copy(), strict=True)),
                common=(states >= lag) & (states < len(truth) - lag),
                thresholds=task.thresholds,
                unit=unit,
            )
            for k, (states, table) in scored.tables().items()
        },
        scans_used=lap.scans_used,
        seconds=lap.seconds,
        quality=np.array(lap.quality),
        plans=lap.plans,
        events={} if events is None else {name: int(n) for name, n in vars(events).items()},
        journey=journey,
        track=track,
        profile={k: (states, table[:, :4]) for k, (states, table) in sampled.tables().items()},
        against_map=None if against is None else against.columns(),
    )


class _Lap:
    """Collects the truth, commands, qualities, readings of plans, and what is counted."""

    def __init__(self, task: Surroundings) -> None:
        self._task = task
        self.plans: list[list[float]] = []
        self.truth: list[Reals] = []
        self.moves: list[Reals] = []
        self.quality: list[float] = []
        self._ranges: list[Reals] = []
        self.seconds = 0.0
        self.belief: Belief | None = None

    @property
    def scans_used(self) -> int:
        """Scans with at least one beam that is a number in [0, max_range]."""
        ranges = np.array(self._ranges, np.float64)
        usable = (ranges >= 0.0) & (ranges <= self._task.max_range)  # false for NaN
        return int(usable.any(axis=-1).sum())

    def see(self, moment: Step) -> None:
        self.belief = moment.belief
        self.truth.append(moment.truth)
        action = moment.action
        self.moves.append(np.zeros(3) if action is None else increments(action))
        quality = quality_of(moment.belief)
        self.quality.append(np.nan if quality is None else quality)
        self.plans.append(plan_row(moment.belief, moment.truth, self._task))
        if moment.t > 0:
            self.seconds += moment.seconds
            self._ranges.append(moment.ranges)


class _Beliefs:
    """Collects what is believed at some offsets about every n-th state, measured in passes."""

    def __init__(
        self,
        offsets: Iterable[int],
        lap: _Lap,
        measure: Callable[[Clouds], Floats],
        stride: int = 1,
    ) -> None:
        self._offsets, self._lap = tuple(offsets), lap
        self._measure, self._stride = measure, stride
        self._ahead: dict[int, list[Cloud]] = {}
        self._due: list[Cloud] = []
        self._points = 0  # of those due
        self._labels: list[tuple[int, int]] = []
        self._tables: list[Floats] = []

    def see(self, moment: Step) -> None:
        for offset in self._offsets:
            state = moment.t + offset
            if state < 0 or state % self._stride:
                continue
            if (points := moment.belief.points(offset)) is not None:
                cloud = cloud_of(state, offset, points)
                self._ahead.setdefault(max(state, moment.t), []).append(cloud)
            elif offset == 0:
                raise InputError(f"its belief of state {state} holds no points of the present.")
        for cloud in self._ahead.pop(moment.t, ()):
            self._due.append(cloud)
            self._points += cloud.weights.size
        if self._points >= _BATCH:
            self._measure_due()

    def tables(self) -> dict[int, tuple[Indices, Floats]]:
        """By offset: the states and a row of each, (k, c); what is held of no state is out."""
        self._measure_due()
        if not self._tables:
            return {}
        states, offsets = np.array(self._labels).T
        table = np.concatenate(self._tables)
        own = {k: np.flatnonzero(offsets == k) for k in self._offsets}
        return {k: (states[rows], table[rows]) for k, rows in own.items() if rows.size}

    def _measure_due(self) -> None:
        if self._due:
            truth = [self._lap.truth[cloud.state] for cloud in self._due]
            moves = [self._lap.moves[cloud.state] for cloud in self._due]
            self._tables.append(self._measure(joined(self._due, truth, moves)))
            self._labels += [(cloud.state, cloud.offset) for cloud in self._due]
            self._due, self._points = [], 0


def _measured(clouds: Clouds, task: Surroundings) -> Floats:
    """Moments, scores, and what metrics ask each state for, side by side."""
    rows = belief_scores(clouds, task.floor_plan.unit, task.thresholds.far)
    return np.column_stack([rows, *(each(clouds, task) for each in _EACH.values())])


def _between(offsets: Sequence[int], lag: int) -> list[int]:
    """Offsets at equal steps as far as the outermost of those scored, these left out."""
    step = max(1, lag // _PROFILE_OFFSETS)
    farthest = lag // step * step
    return [k for k in range(-farthest, farthest + 1, step) if k not in offsets]
