"""From a trace to the record of one trial: its scores, one row per offset, and its curves."""

from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.collecting import Number, RecordedTrack, WholeRun, if_finite, unless_nan
from benchmarks.trials.scores import METRICS, Estimates, state_error
from benchmarks.trials.spec import Trial
from benchmarks.trials.trace import PROFILE_STRIDE, OffsetTrace, Trace, plan_columns
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


def scores(trace: Trace, lag: int, thresholds: Thresholds) -> list[dict[str, Any]]:
    """Score each offset of a trace by every metric, a row each; NaN is not available."""
    return [
        {"offset": offset} | {metric.name: metric.of(estimates) for metric in METRICS}
        for offset, kept in trace.offsets.items()
        for estimates in [_estimates(trace, kept, lag, thresholds)]
    ]


def record(trace: Trace, lag: int, thresholds: Thresholds) -> TrialRecord:
    """Return a trial's result; its scores are of the states whose truth is known."""
    quality, held = trace.quality[1:], error_profile(trace, lag)
    return TrialRecord(
        unit=trace.unit,
        thresholds=thresholds,
        scores=[if_finite(row) for row in scores(trace, lag, thresholds)],
        curves={
            offset: ErrorCurve(
                first_state=int(kept.states[0]),
                error=unless_nan(_short(state_error(kept.means, trace.truth[kept.states]))),
            )
            for offset, kept in trace.offsets.items()
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


def error_profile(trace: Trace, lag: int) -> dict[int, float]:
    """Mean error e by offset, each over the same states: every 5th with L ≤ s ≤ T - L."""
    held = {k: (kept.states, kept.means) for k, kept in trace.offsets.items()} | trace.profile
    errors = {}
    for offset, (states, means) in held.items():
        shared = (states >= lag) & (states <= trace.steps - lag) & (states % PROFILE_STRIDE == 0)
        shared &= trace.known[states]
        if shared.any():
            errors[offset] = mean(state_error(means[shared], trace.truth[states[shared]]))
    return errors


def _estimates(trace: Trace, kept: OffsetTrace, lag: int, thresholds: Thresholds) -> Estimates:
    scored = (kept.states >= 1) & trace.known[kept.states]
    states = kept.states[scored]
    return Estimates(
        truth=trace.truth[states],
        means=kept.means[scored],
        variances=kept.variances[scored],
        values={name: values[scored] for name, values in kept.values.items()},
        common=(states >= lag) & (states <= trace.steps - lag),
        thresholds=thresholds,
        unit=trace.unit,
    )


def _short(values: Iterable[float]) -> list[float]:
    """Return values with six digits: enough for a curve."""
    return [float(f"{value:.6g}") for value in values]
