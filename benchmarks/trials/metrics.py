"""What beliefs at one offset say of the states, and how far that is from the truth.

The paper's state for scoring is (x, y, cos θ, sin θ), lengths and unitless numbers mixed.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.clouds import (
    Clouds,
    Surroundings,
    covariance_floor,
    steps_back,
)
from deqmcl_gym.numerics import Bools, Floats, Reals, arrays


@dataclass(frozen=True, kw_only=True)
class Estimates:
    """What beliefs at one offset say of the states s ≥ 1, and the truth: for ``METRICS``."""

    truth: Floats
    means: Floats  # of (x, y, cos θ, sin θ), (k, 4)
    variances: Floats  # of the same
    values: dict[str, Floats]  # further numbers of each state, (k,); see ``trace.OffsetTrace``
    common: Bools  # whether L ≤ s ≤ T - L, the states that every offset estimates, (k,)
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

    @cached_property
    def angle(self) -> Floats:
        """Between the directions of estimate and truth, rad, (k,)."""
        return heading_error(self.means, self.truth)


def state_error(means: Floats, truth: Reals) -> Floats:
    """e_t, the norm of (estimate - truth) over (x, y, cos θ, sin θ); the paper's eq. (4), (k,)."""
    x, y, heading = np.asarray(truth, dtype=np.float64).T
    true = np.column_stack([x, y, arrays.cos(heading), arrays.sin(heading)])
    return _root(np.sum, means - true)


def position_error(means: Floats, truth: Floats) -> Floats:
    """Distance of estimate and truth in (x, y), (k,)."""
    return _root(np.sum, means[:, :2] - truth[:, :2])


def _root(total: Callable[..., Floats], rows: Floats) -> Floats:
    """Root of the total of each row's squares, scaled by a power of two: none is too large."""
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
    """Σ_i ½ log(2πe max(v_i, f_i)) over the four components, f = (0.1 px)² and 10⁻⁶, nats, (k,).

    The entropy of a Gaussian without correlation; the paper gives no formula.
    """
    floored = np.maximum(variances, covariance_floor(unit)[[0, 1, 2, 2]])  # NaN stays NaN
    total: Floats = (0.5 * arrays.log(2 * math.pi * math.e * floored)).sum(axis=1)
    return total


def wall_share(clouds: Clouds, task: Surroundings) -> Floats:
    """Weight on poses where the robot does not fit, (k,)."""
    return _weight_of(~task.floor_plan.free(clouds.poses.T, task.radius), clouds)


def wall_step_share(clouds: Clouds, task: Surroundings) -> Floats:
    """Weight on poses whose last step, as commanded along their heading, passed a wall, (k,)."""
    before = np.empty((2, clouds.weights.size), np.float32)
    steps_back(clouds.poses, clouds.moves, clouds.ends, before)
    return _weight_of(task.floor_plan.collides(before.T, clouds.poses.T, task.radius), clouds)


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


def middle(values: Floats) -> float:
    """Median; NaN of nothing."""
    return float(np.median(values)) if values.size else math.nan
