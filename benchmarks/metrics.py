"""Scores of a belief, all derived from its weighted points. Units: px, rad, nats.

The paper's state for scoring is (x, y, cos θ, sin θ), px and unitless mixed.
"""

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Smallest variances that entropy is computed from: (0.1 px)² and 10⁻⁶.
VARIANCE_FLOOR = np.array([1e-2, 1e-2, 1e-6, 1e-6])


def components(poses: NDArray[np.floating]) -> Floats:
    """(x, y, cos θ, sin θ) of poses (n, 3), (n, 4)."""
    x, y, heading = np.asarray(poses, dtype=np.float64).T
    return np.column_stack([x, y, np.cos(heading), np.sin(heading)])


def cloud_moments(poses: NDArray[np.floating], weights: Floats) -> tuple[Floats, Floats]:
    """Weighted mean and variance of (x, y, cos θ, sin θ), (4,) each; one point has none (NaN).

    Args:
        poses: (n, 3) px, px, rad.
        weights: with sum 1, (n,).
    """
    cloud = components(poses)
    share = np.asarray(weights, dtype=np.float64)[:, None]
    mean: Floats = (share * cloud).sum(axis=0)
    if len(cloud) == 1:
        return mean, np.full(4, np.nan)
    variance: Floats = (share * np.square(cloud - mean)).sum(axis=0)
    return mean, variance


def state_error(means: Floats, truth: NDArray[np.floating]) -> Floats:
    """e_t, the norm of (estimate - truth) over (x, y, cos θ, sin θ); the paper's eq. (4), (k,).

    Args:
        means: estimates of (x, y, cos θ, sin θ), (k, 4).
        truth: true poses, (k, 3).
    """
    error: Floats = np.sqrt(np.square(means - components(truth)).sum(axis=1))
    return error


def position_error(means: Floats, truth: Floats) -> Floats:
    """Distance of estimate and truth in (x, y), px, (k,)."""
    error: Floats = np.hypot(*(means[:, :2] - truth[:, :2]).T)
    return error


def heading_error(means: Floats, truth: Floats) -> Floats:
    """Angle between the direction of the mean (cos θ, sin θ) and the true heading, rad, (k,)."""
    apart = np.arctan2(means[:, 3], means[:, 2]) - truth[:, 2]
    error: Floats = np.abs((apart + math.pi) % (2 * math.pi) - math.pi)
    return error


def entropy(variances: Floats) -> Floats:
    """Σ_i ½ log(2πe max(v_i, f_i)) over the four components, f = VARIANCE_FLOOR, nats, (k,).

    The entropy of a Gaussian with these variances and no correlation. The paper gives no formula.
    """
    floored = np.maximum(variances, VARIANCE_FLOOR)  # NaN stays NaN
    total: Floats = (0.5 * np.log(2 * math.pi * math.e * floored)).sum(axis=1)
    return total


def rms(values: Floats) -> float:
    """Root of the mean square; NaN of nothing."""
    return math.sqrt(float(np.square(values).mean())) if values.size else math.nan


def mean(values: Floats) -> float:
    """Arithmetic mean; NaN of nothing."""
    return float(values.mean()) if values.size else math.nan
