"""From a trace to the scores of one trial: one row per offset."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks import metrics
from benchmarks.trace import OffsetTrace, Trace


@dataclass(frozen=True, kw_only=True)
class Scores:
    """Scores at one offset k; means over the states s = 1 … T that it estimates.

    Attributes:
        offset: k, steps; the belief at t about x_{t+k}.
        error: mean of e over the states.
        error_window: mean of e over the states L ≤ s ≤ T - L, the same for every offset.
        error_sd_steps: SD of e over the states (ddof 0).
        entropy: mean, nats.
        var_x, var_y, var_cos, var_sin: mean variances, px² and unitless.
        position_rmse: px.
        heading_rmse: rad.
        wall_share: mean weight on poses where the robot does not fit.
    """

    offset: int
    error: float
    error_window: float
    error_sd_steps: float
    entropy: float
    var_x: float
    var_y: float
    var_cos: float
    var_sin: float
    position_rmse: float
    heading_rmse: float
    wall_share: float


SCORE_NAMES = tuple(name for name in Scores.__annotations__ if name != "offset")


def scores(trace: Trace, lag: int) -> list[Scores]:
    """Score each offset of a trace; ``lag`` = L sets the common window."""
    return [_scores(trace, offset, kept, lag) for offset, kept in trace.offsets.items()]


def record(trace: Trace, lag: int) -> dict[str, Any]:
    """Return a trial's result as JSON-able values: scores, error curves, counts."""
    return {
        "scores": [_finite(asdict(row)) for row in scores(trace, lag)],
        "curves": {
            str(offset): {
                "first_state": int(kept.states[0]),
                "error": [float(f"{e:.6g}") for e in _errors(trace, kept)],
            }
            for offset, kept in trace.offsets.items()
        },
        "steps_done": trace.steps,
        "scans_used": trace.scans_used,
        "events": trace.events,
    }


def _scores(trace: Trace, offset: int, kept: OffsetTrace, lag: int) -> Scores:
    truth = trace.truth[kept.states]
    scored = kept.states >= 1
    window = scored & (kept.states >= lag) & (kept.states <= trace.steps - lag)
    error = _errors(trace, kept)
    variance = kept.variances[scored]
    spread = [metrics.mean(column) for column in variance.T]
    return Scores(
        offset=offset,
        error=metrics.mean(error[scored]),
        error_window=metrics.mean(error[window]),
        error_sd_steps=float(error[scored].std()) if scored.any() else np.nan,
        entropy=metrics.mean(metrics.entropy(variance)),
        var_x=spread[0],
        var_y=spread[1],
        var_cos=spread[2],
        var_sin=spread[3],
        position_rmse=metrics.rms(metrics.position_error(kept.means, truth)[scored]),
        heading_rmse=metrics.rms(metrics.heading_error(kept.means, truth)[scored]),
        wall_share=metrics.mean(kept.wall_share[scored]),
    )


def _errors(trace: Trace, kept: OffsetTrace) -> metrics.Floats:
    return metrics.state_error(kept.means, trace.truth[kept.states])


def _finite(row: dict[str, Any]) -> dict[str, Any]:
    """JSON has no NaN: what is not available is null."""
    return {
        name: None if isinstance(value, float) and not np.isfinite(value) else value
        for name, value in row.items()
    }
