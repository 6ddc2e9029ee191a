"""From a trace to the record of one trial: its scores, one row per offset, and its curves."""

from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.collecting import Number, RecordedTrack, WholeRun, if_finite, unless_nan
from benchmarks.trials.scores import METRICS, state_error
from benchmarks.trials.spec import Trial
from benchmarks.trials.trace import PROFILE_STRIDE, Trace, plan_columns
from benchmarks.trials.tracks import mean

SCORE_NAMES = tuple(metric.name for metric in METRICS)

Count = Annotated[int, Meta(ge=0, le=10**9)]
Offset = Annotated[int, Meta(ge=-(10**9), le=10**9)]


class ErrorCurve(Struct, frozen=True):
    """Error e of the beliefs at one offset, by state; None where the truth is not known."""

    first_state: Count
    error: list[Number | None]


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
    # ``map_signals.MAP_COLUMNS`` of the steps t = 1 … T; None where the world is as on the map
    against_map: dict[str, list[Number | None]] | None = None
    journey: WholeRun | None = None
    track: RecordedTrack | None = None

    def __post_init__(self) -> None:
        for name in ("offset", *SCORE_NAMES):
            if any(name not in row for row in self.scores):
                raise ValueError(f"has no {name} among its scores")

    @property
    def offsets(self) -> list[int]:
        """The offsets scored, in their order."""
        return [int(row["offset"] or 0) for row in self.scores]


class Finished(TrialRecord, frozen=True, kw_only=True):
    """A finished trial: its record, the trial, its key, and its seconds (None: not known)."""

    trial: Trial
    key: str
    seconds: float | None


def scores(trace: Trace) -> list[dict[str, Any]]:
    """Score each offset of a trace by every metric, a row each; NaN is not available."""
    return [
        {"offset": offset} | {metric.name: metric.of(estimates) for metric in METRICS}
        for offset, held in trace.offsets.items()
        for estimates in [held.scored]
    ]


def record(trace: Trace) -> TrialRecord:
    """Return a trial's result; its scores are of the states whose truth is known."""
    quality, held = trace.quality[1:], error_profile(trace)
    return TrialRecord(
        unit=trace.unit,
        thresholds=trace.thresholds,
        scores=[if_finite(row) for row in scores(trace)],
        curves={
            offset: ErrorCurve(int(held.states[0]), unless_nan(_short(held.error)))
            for offset, held in trace.offsets.items()
        },
        # with all digits: it is about how near it is to 1
        quality=None if np.isnan(quality).all() else unless_nan(quality.tolist()),
        profile=dict(zip(held, _short(held.values()), strict=True)),
        steps_done=trace.steps,
        scans_used=trace.scans_used,
        events=trace.events,
        plan=plan_columns(trace.plans[1:]),
        against_map=trace.against_map,
        journey=trace.journey,
        track=trace.track,
    )


def error_profile(trace: Trace) -> dict[int, float]:
    """Mean error e by offset, each over the same states: every 5th with L ≤ s ≤ T - L."""
    held = {k: (one.states, one.means) for k, one in trace.offsets.items()} | trace.profile
    errors = {}
    for offset, (states, means) in held.items():
        shared = (states >= trace.lag) & (states <= trace.steps - trace.lag)
        shared &= (states % PROFILE_STRIDE == 0) & np.isfinite(trace.truth[states, 0])
        if shared.any():
            errors[offset] = mean(state_error(means[shared], trace.truth[states[shared]]))
    return errors


def _short(values: Iterable[float]) -> list[float]:
    """Return values with six digits: enough for a curve."""
    return [float(f"{value:.6g}") for value in values]
