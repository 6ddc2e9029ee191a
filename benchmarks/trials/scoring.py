"""The record of a trial: its scores, a row per offset, its curves, and what is kept of its run."""

import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Self

import numpy as np
from msgspec import Meta, Struct

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials import Trial
from benchmarks.trials.scores import JOURNEY_SCORES, METRICS, journey_scores, state_error
from benchmarks.trials.trace import PROFILE_STRIDE, Trace, TrackLog, plan_columns
from benchmarks.trials.tracks import EstimatedTrack, Journey, mean, unless_nan
from deqmcl_gym.logs import Log

SCORE_NAMES = tuple(metric.name for metric in METRICS)

Number = Annotated[float, Meta(ge=-1e100, le=1e100)]  # squares are finite
Count = Annotated[int, Meta(ge=0, le=10**9)]
Offset = Annotated[int, Meta(ge=-(10**9), le=10**9)]

_ENTRIES = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # of a symmetric matrix, in its upper half


class ErrorCurve(Struct, frozen=True):
    """Error e of the beliefs at one offset, by state; None where the truth is not known."""

    first_state: Count
    error: list[Number | None]


class WholeRun(Struct, frozen=True, kw_only=True):
    """What a trial's record has of its whole run; a score that is None is censored or unknown.

    All curves are at the same steps; "way" is what was driven until then, m.
    """

    scores: dict[str, Number | None]
    curves: dict[str, list[Number]]

    def __post_init__(self) -> None:
        if other := self.scores.keys() - JOURNEY_SCORES.keys():
            raise ValueError(f"has a score of the whole run named {min(other)[:20]!r}")

    @classmethod
    def of(cls, run: Journey, scores: Mapping[str, float]) -> Self:
        """Return what is kept of a run; curves have four digits, as a long run is many numbers."""
        curves = {"way": run.way, "distance": run.distance, "angle": run.angle}
        if run.masses is not None:
            curves |= dict(zip(("mass_truth", "mass_twin"), run.masses.T, strict=True))
        rounded = {name: _short(values, 4) for name, values in curves.items()}
        return cls(scores=_if_finite(scores), curves=rounded)


class RecordedTrack(Struct, frozen=True, kw_only=True):
    """What the record of a trial on a whole log has of it: best clusters, x, y, θ; scores."""

    best: tuple[list[Number], list[Number], list[Number]]
    scores: dict[str, Number | None]
    # second moments of the belief about them: xx, xy, xθ, yy, yθ, θθ; None unknown
    spread: list[list[Number | None]] | None = None

    @classmethod
    def of(cls, log: TrackLog) -> Self:
        """Return what is kept of a track."""
        track = log.track
        x, y, heading = track.best.T.tolist()
        upper = np.asarray(track.spread)[:, *np.triu_indices(3)]
        spread = [unless_nan(_short(row, 8)) for row in upper.T]
        return cls(best=(x, y, heading), scores=_if_finite(log.scores()), spread=spread)

    def on(self, log: Log) -> EstimatedTrack:
        """Return the track on the log that it is of."""
        known = self.spread is not None
        spread = np.array(self.spread, np.float64).T[:, _ENTRIES] if known else None
        return EstimatedTrack(log, np.array(self.best).T, spread)


class TrialRecord(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What came of a trial of T steps: the shape of its line in a file."""

    unit: Annotated[str, Meta(pattern="^(px|m)$")]
    thresholds: Thresholds
    # a row per offset: "offset" and ``SCORE_NAMES``, None not available
    scores: list[dict[str, Offset | Number | None]]
    curves: dict[Offset, ErrorCurve]
    quality: list[Number | None] | None  # that it is not lost after t = 1 …; None: it is not given
    profile: dict[Offset, Number]  # mean error e by offset, each over the same states
    steps_done: Count
    scans_used: Count  # those with at least one beam in range
    events: dict[str, Count]
    # ``trace.plan_columns`` of the steps t = 1 … T; None if no plan was read
    plan: dict[str, list[Number | None]] | None = None
    journey: WholeRun | None = None
    track: RecordedTrack | None = None

    def __post_init__(self) -> None:
        for name in ("offset", *SCORE_NAMES):
            if any(name not in row for row in self.scores):
                raise ValueError(f"has no {name} among its scores")


class Finished(TrialRecord, frozen=True, kw_only=True):
    """A finished trial: its record, the trial, its key, and its seconds (None: not known)."""

    trial: Trial
    key: str
    seconds: float | None


def scores(trace: Trace) -> list[dict[str, Any]]:
    """Score each offset of a trace by every metric, a row each; NaN is not available."""
    scored = {offset: held.scored for offset, held in trace.offsets.items()}
    return [
        {"offset": offset} | {metric.name: metric.of(held) for metric in METRICS}
        for offset, held in scored.items()
    ]


def record(trace: Trace) -> TrialRecord:
    """Return a trial's result; its scores are of the states whose truth is known."""
    whole, quality, profile = trace.whole, trace.quality[1:], error_profile(trace)
    journey = None
    if whole is not None and (run := whole.journey(trace)) is not None:
        journey = WholeRun.of(run, journey_scores(run, whole.groups))
    return TrialRecord(
        unit=trace.task.floor_plan.unit,
        thresholds=trace.task.thresholds,
        scores=[_if_finite(row) for row in scores(trace)],
        curves={
            offset: ErrorCurve(int(held.states[0]), unless_nan(_short(held.error)))
            for offset, held in trace.offsets.items()
        },
        # with all digits: it is about how near it is to 1
        quality=None if np.isnan(quality).all() else unless_nan(quality.tolist()),
        profile=dict(zip(profile, _short(profile.values()), strict=True)),
        steps_done=trace.steps,
        scans_used=trace.scans_used,
        events=trace.events,
        plan=plan_columns(trace.plans[1:]),
        journey=journey,
        track=RecordedTrack.of(whole) if isinstance(whole, TrackLog) else None,
    )


def error_profile(trace: Trace) -> dict[int, float]:
    """Mean error e by offset, each over the same states: every 5th with L ≤ s ≤ T - L."""
    tables = {k: (held.states, held.table) for k, held in trace.offsets.items()} | trace.profile
    errors = {}
    for offset, (states, table) in tables.items():
        shared = (states >= trace.lag) & (states <= trace.steps - trace.lag)
        shared &= (states % PROFILE_STRIDE == 0) & np.isfinite(trace.truth[states, 0])
        if shared.any():
            errors[offset] = mean(state_error(table[shared, :4], trace.truth[states[shared]]))
    return errors


def _short(values: Iterable[float], figures: int = 6) -> list[float]:
    """Return values with some digits: six are enough for a curve."""
    return [float(f"{value:.{figures}g}") for value in values]


def _if_finite(scores: Mapping[str, float]) -> dict[str, float | None]:
    """Return scores as a record has them: an infinite one and an unknown one are None."""
    return {name: value if math.isfinite(value) else None for name, value in scores.items()}
