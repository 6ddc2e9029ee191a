"""From a trace to the record of one trial: its scores, one row per offset, and its curves."""

from dataclasses import asdict
from typing import Any

import numpy as np

from benchmarks.setup.thresholds import Thresholds
from benchmarks.trials.metrics import METRICS, Estimates, mean, state_error
from benchmarks.trials.plans import plan_record
from benchmarks.trials.trace import PROFILE_STRIDE, OffsetTrace, Trace
from deqmcl_gym.numerics.types import Floats

SCORE_NAMES = tuple(metric.name for metric in METRICS)


def scores(trace: Trace, lag: int, thresholds: Thresholds) -> list[dict[str, Any]]:
    """Score each offset of a trace by every metric; NaN is not available.

    Args:
        trace: what was believed.
        lag: L; it sets the states that every offset estimates.
        thresholds: what counts as lost.

    Returns:
        A row per offset: "offset" and ``SCORE_NAMES``.
    """
    return [
        {"offset": offset} | {metric.name: metric.of(estimates) for metric in METRICS}
        for offset, kept in trace.offsets.items()
        for estimates in [_estimates(trace, kept, lag, thresholds)]
    ]


def record(trace: Trace, lag: int, thresholds: Thresholds) -> dict[str, Any]:
    """Return a trial's result as JSON-able values: scores, curves, qualities, counts, plans.

    What not every trial has stands only where it has it: ``plan``, ``journey``, ``track``. An error
    is null where the truth is unknown; the scores are of the states where it is known.
    """
    return {
        "unit": trace.unit,
        "thresholds": asdict(thresholds),
        "scores": [_finite(row) for row in scores(trace, lag, thresholds)],
        "curves": {
            str(offset): {
                "first_state": int(kept.states[0]),
                "error": _unless_unknown(state_error(kept.means, trace.truth[kept.states])),
            }
            for offset, kept in trace.offsets.items()
        },
        "quality": _rated(trace.quality),
        "profile": {str(k): _sig(e) for k, e in sorted(profile(trace, lag).items())},
        "steps_done": trace.steps,
        "scans_used": trace.scans_used,
        "events": trace.events,
    } | (plan_record(trace.plans[1:]) | trace.whole)


def profile(trace: Trace, lag: int) -> dict[int, float]:
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


def _rated(quality: Floats) -> list[float | None] | None:
    """P(not lost) after the steps t = 1 … T, with all digits: it is about how near it is to 1."""
    given = quality[1:]
    return None if np.isnan(given).all() else [None if np.isnan(q) else q for q in given.tolist()]


def _unless_unknown(errors: Floats) -> list[float | None]:
    return [None if np.isnan(error) else _sig(error) for error in errors]


def _sig(value: float) -> float:
    """Six digits: enough for a curve."""
    return float(f"{value:.6g}")


def _finite(row: dict[str, Any]) -> dict[str, Any]:
    """JSON has no NaN: what is not available is null."""
    return {
        name: None if isinstance(value, float) and not np.isfinite(value) else value
        for name, value in row.items()
    }
