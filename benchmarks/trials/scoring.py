"""From a trace to the scores of one trial: one row per offset."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.trials import metrics
from benchmarks.trials.trace import PROFILE_STRIDE, OffsetTrace, Trace
from deqmcl_gym.numerics.types import Floats

LEVELS = (50, 80, 95)  # of the credible regions, per cent
LOST_STEPS = 20  # a trial is lost if over its last steps …
LOST_DISTANCE = 50.0  # … the mean position error is above this, px


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
        energy_score: mean energy score of the position, px.
        coverage_50, coverage_80, coverage_95: share of states inside the credible region.
        nees: mean normalised estimation error squared of (x, y, θ); 3 if consistent.
        lost: 1 if the mean position error of the last 20 states is above 50 px, else 0.
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
    energy_score: float
    coverage_50: float
    coverage_80: float
    coverage_95: float
    nees: float
    lost: float


SCORE_NAMES = tuple(name for name in Scores.__annotations__ if name != "offset")


def scores(trace: Trace, lag: int) -> list[Scores]:
    """Score each offset of a trace; ``lag`` = L sets the common window."""
    return [_scores(trace, offset, kept, lag) for offset, kept in trace.offsets.items()]


def record(trace: Trace, lag: int) -> dict[str, Any]:
    """Return a trial's result as JSON-able values: scores, error curves, qualities, counts."""
    return {
        "scores": [_finite(asdict(row)) for row in scores(trace, lag)],
        "curves": {
            str(offset): {
                "first_state": int(kept.states[0]),
                "error": [_sig(e) for e in _errors(trace, kept)],
            }
            for offset, kept in trace.offsets.items()
        },
        "quality": _rated(trace.quality),
        "profile": {str(k): _sig(e) for k, e in sorted(profile(trace, lag).items())},
        "steps_done": trace.steps,
        "scans_used": trace.scans_used,
        "events": trace.events,
    }


def profile(trace: Trace, lag: int) -> dict[int, float]:
    """Mean error e by offset, each over the same states: every 5th with L ≤ s ≤ T - L."""
    held = {k: (kept.states, kept.means) for k, kept in trace.offsets.items()} | trace.profile
    errors = {}
    for offset, (states, means) in held.items():
        shared = (states >= lag) & (states <= trace.steps - lag) & (states % PROFILE_STRIDE == 0)
        if shared.any():
            e = metrics.state_error(means[shared], trace.truth[states[shared]])
            errors[offset] = metrics.mean(e)
    return errors


def _scores(trace: Trace, offset: int, kept: OffsetTrace, lag: int) -> Scores:
    truth = trace.truth[kept.states]
    scored = kept.states >= 1
    window = scored & (kept.states >= lag) & (kept.states <= trace.steps - lag)
    error = _errors(trace, kept)
    variance = kept.variances[scored]
    spread = [metrics.mean(column) for column in variance.T]
    apart = metrics.position_error(kept.means, truth)
    rank = kept.rank[scored]
    inside = [np.where(np.isnan(rank), np.nan, rank <= level / 100) for level in LEVELS]
    coverage = [metrics.mean(covered) for covered in inside]
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
        position_rmse=metrics.rms(apart[scored]),
        heading_rmse=metrics.rms(metrics.heading_error(kept.means, truth)[scored]),
        wall_share=metrics.mean(kept.wall_share[scored]),
        energy_score=metrics.mean(kept.energy[scored]),
        coverage_50=coverage[0],
        coverage_80=coverage[1],
        coverage_95=coverage[2],
        nees=metrics.mean(kept.nees[scored]),
        lost=_lost(apart[scored]),
    )


def _lost(distances: Floats) -> float:
    if not distances.size:
        return np.nan
    return float(distances[-LOST_STEPS:].mean() > LOST_DISTANCE)


def _errors(trace: Trace, kept: OffsetTrace) -> Floats:
    return metrics.state_error(kept.means, trace.truth[kept.states])


def _rated(quality: Floats) -> list[float | None] | None:
    """P(not lost) after the steps t = 1 … T, with all digits: it is about how near it is to 1."""
    given = quality[1:]
    return None if np.isnan(given).all() else [None if np.isnan(q) else q for q in given.tolist()]


def _sig(value: float) -> float:
    """Six digits: enough for a curve."""
    return float(f"{value:.6g}")


def _finite(row: dict[str, Any]) -> dict[str, Any]:
    """JSON has no NaN: what is not available is null."""
    return {
        name: None if isinstance(value, float) and not np.isfinite(value) else value
        for name, value in row.items()
    }
