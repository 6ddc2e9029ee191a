"""The scores of a trial: each a ``Metric`` with its unit, all of them in ``METRICS``.

The paper's state for scoring is (x, y, cos θ, sin θ), lengths and unitless numbers mixed.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.clouds import Clouds, Task, covariance_floor, steps_back, weights_beyond
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Bools, Floats, Reals

LEVELS = (50, 80, 95)  # of the credible regions, per cent


@dataclass(frozen=True, kw_only=True)
class Estimates:
    """What beliefs at one offset say of the states s ≥ 1, and the truth: what metrics are made of.

    Attributes:
        truth: true poses, (k, 3).
        means, variances: of (x, y, cos θ, sin θ), (k, 4).
        values: further numbers of each state, (k,); see ``trace.OffsetTrace``.
        common: whether L ≤ s ≤ T - L, the states that every offset estimates, (k,).
        thresholds: of the scenario.
        unit: of lengths.
    """

    truth: Floats
    means: Floats
    variances: Floats
    values: dict[str, Floats]
    common: Bools
    thresholds: Thresholds
    unit: str

    @cached_property
    def error(self) -> Floats:
        """E of each state, (k,)."""
        return state_error(self.means, self.truth)

    @cached_property
    def distance(self) -> Floats:
        """Of the estimate to the truth in (x, y), (k,)."""
        return position_error(self.means, self.truth)


@dataclass(frozen=True)
class Metric:
    """A score of one trial at one offset.

    Attributes:
        name: in records and tables.
        unit: "length" (the map's unit), "length²", "rad", "share", "nats" or "" (a number).
        words: what it is; a mean over the states if it does not say otherwise.
        of: the score; NaN is not available.
        each: what is measured of the belief about each state, (k,), if ``of`` needs it:
            ``Estimates.values`` has it by the metric's name.
        later: whether records that lack it, made before it was added, are sound.
    """

    name: str
    unit: str
    words: str
    of: Callable[[Estimates], float]
    each: Callable[[Clouds, Task], Floats] | None = None
    later: bool = False


def state_error(means: Floats, truth: Reals) -> Floats:
    """e_t, the norm of (estimate - truth) over (x, y, cos θ, sin θ); the paper's eq. (4), (k,).

    Args:
        means: estimates of (x, y, cos θ, sin θ), (k, 4).
        truth: true poses, (k, 3).
    """
    x, y, heading = np.asarray(truth, dtype=np.float64).T
    true = np.column_stack([x, y, arrays.cos(heading), arrays.sin(heading)])
    return _root(np.sum, means - true)


def position_error(means: Floats, truth: Floats) -> Floats:
    """Distance of estimate and truth in (x, y), (k,)."""
    return _root(np.sum, means[:, :2] - truth[:, :2])


def _root(total: Callable[..., Floats], rows: Floats) -> Floats:
    """Root of the total of the squares of each row of (k, n), (k,).

    Scaled by a power of two, which changes no bit, so that no square is too large.
    """
    _, exponents = np.frexp(np.abs(rows).max(axis=1))
    squares = np.square(np.ldexp(rows, -exponents[:, None]))
    return np.ldexp(np.sqrt(total(squares, axis=1)), exponents)


def directions(means: Floats) -> Floats:
    """Headings of the mean (cos θ, sin θ), rad in (-π, π], (k,)."""
    return arrays.arctan2(means[:, 3], means[:, 2])


def heading_error(means: Floats, truth: Floats) -> Floats:
    """Angle between the direction of the mean (cos θ, sin θ) and the true heading, rad, (k,)."""
    return np.abs((directions(means) - truth[:, 2] + math.pi) % (2 * math.pi) - math.pi)


def entropy(variances: Floats, unit: str) -> Floats:
    """Σ_i ½ log(2πe max(v_i, f_i)) over the four components, nats, (k,).

    The entropy of a Gaussian with these variances and no correlation, f = (0.1 px)² and 10⁻⁶. The
    paper gives no formula.
    """
    floored = np.maximum(variances, covariance_floor(unit)[[0, 1, 2, 2]])  # NaN stays NaN
    total: Floats = (0.5 * arrays.log(2 * math.pi * math.e * floored)).sum(axis=1)
    return total


def wall_share(clouds: Clouds, task: Task) -> Floats:
    """Weight on poses where the robot does not fit, (k,)."""
    return _weight_of(~task.floor_plan.free(clouds.poses.T, task.radius), clouds)


def wall_step_share(clouds: Clouds, task: Task) -> Floats:
    """Weight on poses whose last step passed through a wall, (k,).

    The step is the one commanded on the way to the state, along the heading of the pose: so all
    beliefs can be asked, those too that hold no past.
    """
    before = np.empty((2, clouds.weights.size), np.float32)
    steps_back(clouds.poses, clouds.moves, clouds.ends, before)
    return _weight_of(task.floor_plan.collides(before.T, clouds.poses.T, task.radius), clouds)


def outlier_share(clouds: Clouds, task: Task) -> Floats:
    """Weight farther than ``task.far`` from the truth in (x, y), (k,)."""
    out = np.empty(len(clouds.each))
    weights_beyond(clouds.poses, clouds.weights, clouds.ends, clouds.truth, task.far, out)
    return out


def _weight_of(chosen: Bools, clouds: Clouds) -> Floats:
    """Weight of the poses of each cloud that are chosen, (k,)."""
    those = np.flatnonzero(chosen)
    cuts = [0, *np.searchsorted(those, clouds.ends).tolist()]
    return np.array([clouds.weights[those[a:b]].sum() if a < b else 0.0 for a, b in pairwise(cuts)])


def rms(values: Floats) -> float:
    """Root of the mean square; NaN of nothing."""
    return float(_root(np.mean, values[None])[0]) if values.size else math.nan


def mean(values: Floats) -> float:
    """Arithmetic mean; NaN of nothing."""
    return float(values.mean()) if values.size else math.nan


def _mean_of(name: str) -> Callable[[Estimates], float]:
    return lambda found: mean(found.values[name])


def _variance_of(column: int) -> Callable[[Estimates], float]:
    return lambda found: mean(found.variances[:, column])


def _coverage(level: int) -> Metric:
    def inside(found: Estimates) -> float:
        rank = found.values["rank"]
        return mean(np.where(np.isnan(rank), np.nan, rank <= level / 100))

    return Metric(f"coverage_{level}", "share", f"states in the {level} % credible region", inside)


def _lost(found: Estimates) -> float:
    last = found.distance[-found.thresholds.lost_steps :]
    return float(last.mean() > found.thresholds.lost) if last.size else math.nan


def _sd(values: Floats) -> float:
    return float(values.std()) if values.size else math.nan


METRICS = (
    Metric("error", "", "error e", lambda found: mean(found.error)),
    Metric("error_window", "", "e, common states", lambda found: mean(found.error[found.common])),
    Metric("error_sd_steps", "", "SD of e over the states", lambda found: _sd(found.error)),
    Metric("entropy", "nats", "entropy", lambda found: mean(entropy(found.variances, found.unit))),
    Metric("var_x", "length²", "variance of x", _variance_of(0)),
    Metric("var_y", "length²", "variance of y", _variance_of(1)),
    Metric("var_cos", "", "variance of cos θ", _variance_of(2)),
    Metric("var_sin", "", "variance of sin θ", _variance_of(3)),
    Metric("position_rmse", "length", "position RMSE", lambda found: rms(found.distance)),
    Metric(
        "heading_rmse", "rad", "heading RMSE", lambda it: rms(heading_error(it.means, it.truth))
    ),
    Metric("wall_share", "share", "weight in walls", _mean_of("wall_share"), wall_share),
    Metric("energy_score", "length", "energy score", _mean_of("energy")),
    *map(_coverage, LEVELS),
    Metric("nees", "", "NEES; 3 if consistent", _mean_of("nees")),
    Metric("lost", "share", "lost at the end", _lost),
    Metric(
        "wall_step_share",
        "share",
        "weight that came through walls",
        _mean_of("wall_step_share"),
        wall_step_share,
        later=True,
    ),
    Metric(
        "outlier_share",
        "share",
        "weight far from the truth, common states",
        lambda found: mean(found.values["outlier_share"][found.common]),
        outlier_share,
        later=True,
    ),
)
