"""Scores of a belief, all derived from its weighted points. Units: px, rad, nats.

The paper's state for scoring is (x, y, cos θ, sin θ), px and unitless mixed.
"""

import math
from typing import NamedTuple

import numpy as np

from benchmarks.trials import kernels
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Reals

# Smallest variances that entropy is computed from: (0.1 px)² and 10⁻⁶.
VARIANCE_FLOOR = np.array([1e-2, 1e-2, 1e-6, 1e-6])
# Added to the variances of x, y and θ before a distance is measured in them: px², px², rad².
COVARIANCE_FLOOR = np.array([1e-2, 1e-2, 1e-6])
# Particles whose mutual distances stand for those of the whole cloud in the energy score.
PAIRED = 128


class CloudScores(NamedTuple):
    """A belief about one state, scored against the truth; NaN is not available.

    Attributes:
        mean: of x, y, cos θ, sin θ, (4,).
        variance: of the same, (4,).
        energy: energy score of the position, px.
        rank: weight nearer to the mean than the truth is, 0 to 1.
        nees: normalised estimation error squared of (x, y, θ), 3 degrees of freedom.
    """

    mean: Floats
    variance: Floats
    energy: float
    rank: float
    nees: float


def components(poses: Reals) -> Floats:
    """(x, y, cos θ, sin θ) of poses (n, 3), (n, 4)."""
    x, y, heading = np.asarray(poses, dtype=np.float64).T
    return np.column_stack([x, y, arrays.cos(heading), arrays.sin(heading)])


def cloud_moments(poses: Reals, weights: Floats) -> tuple[Floats, Floats]:
    """Weighted mean and variance of (x, y, cos θ, sin θ), (4,) each; one point has none (NaN).

    Args:
        poses: (n, 3) px, px, rad.
        weights: with sum 1, (n,).
    """
    return _moments(_rows(poses), _doubles(weights))


def cloud_scores(poses: Reals, weights: Floats, truth: Floats) -> CloudScores:
    """Moments of a belief and what they and its points say of the truth.

    With X, X' drawn from the belief and z the truth, in (x, y):

    - energy score E|X - z| - ½ E|X - X'| (Gneiting & Raftery 2007). The first term is that of all
      particles; the second of the pairs of ``PAIRED`` of them, at equal steps of the cumulative
      weight: of one cloud it is right to a few per cent, its mean over a lap to 1 %. Of one point
      the score is its distance to the truth.
    - rank P(D(X) < D(z)), D the Mahalanobis distance to the belief's mean under its covariance. The
      credible region of level p, the p of the weight nearest to the mean, covers the truth if
      rank ≤ p. No shape is assumed: the distances are ranked among the belief's own.
    - NEES dᵀ P⁻¹ d, d = truth - estimate in (x, y, θ), θ about the direction of the mean and
      wrapped, P the second moments of the belief about the estimate. On average 3 if the truth is
      a draw from the belief.

    ``COVARIANCE_FLOOR`` keeps a collapsed cloud from dividing by zero.

    Args:
        poses: (n, 3) px, px, rad.
        weights: with sum 1, (n,).
        truth: the true pose, (3,).
    """
    rows, shares = _rows(poses), _doubles(weights)
    mean, variance = _moments(rows, shares)
    true = _doubles(truth)
    if shares.size == 1:
        chosen = np.empty(0, np.intp)
        return CloudScores(
            mean, variance, kernels.energy(rows, shares, true, chosen), math.nan, math.nan
        )
    chosen = np.empty(PAIRED, np.intp)
    kernels.thinned(shares, chosen)
    energy = kernels.energy(rows, shares, true, chosen)
    rank, nees = kernels.rank_and_nees(rows, shares, mean, true, COVARIANCE_FLOOR)
    return CloudScores(mean, variance, energy, rank, nees)


def state_error(means: Floats, truth: Reals) -> Floats:
    """e_t, the norm of (estimate - truth) over (x, y, cos θ, sin θ); the paper's eq. (4), (k,).

    Args:
        means: estimates of (x, y, cos θ, sin θ), (k, 4).
        truth: true poses, (k, 3).
    """
    error: Floats = np.sqrt(np.square(means - components(truth)).sum(axis=1))
    return error


def position_error(means: Floats, truth: Floats) -> Floats:
    """Distance of estimate and truth in (x, y), px, (k,)."""
    error: Floats = np.sqrt(np.square(means[:, :2] - truth[:, :2]).sum(axis=1))
    return error


def directions(means: Floats) -> Floats:
    """Headings of the mean (cos θ, sin θ), rad in (-π, π], (k,)."""
    return arrays.arctan2(means[:, 3], means[:, 2])


def heading_error(means: Floats, truth: Floats) -> Floats:
    """Angle between the direction of the mean (cos θ, sin θ) and the true heading, rad, (k,)."""
    error: Floats = np.abs((directions(means) - truth[:, 2] + math.pi) % (2 * math.pi) - math.pi)
    return error


def entropy(variances: Floats) -> Floats:
    """Σ_i ½ log(2πe max(v_i, f_i)) over the four components, f = VARIANCE_FLOOR, nats, (k,).

    The entropy of a Gaussian with these variances and no correlation. The paper gives no formula.
    """
    floored = np.maximum(variances, VARIANCE_FLOOR)  # NaN stays NaN
    total: Floats = (0.5 * arrays.log(2 * math.pi * math.e * floored)).sum(axis=1)
    return total


def rms(values: Floats) -> float:
    """Root of the mean square; NaN of nothing."""
    return math.sqrt(float(np.square(values).mean())) if values.size else math.nan


def mean(values: Floats) -> float:
    """Arithmetic mean; NaN of nothing."""
    return float(values.mean()) if values.size else math.nan


def _moments(rows: Floats, weights: Floats) -> tuple[Floats, Floats]:
    out = np.empty((2, 4))
    kernels.moments(rows, weights, out)
    if weights.size == 1:
        out[1] = np.nan
    return out[0], out[1]


def _rows(poses: Reals) -> Floats:
    """Poses (n, 3) as contiguous rows (3, n)."""
    return np.ascontiguousarray(np.asarray(poses).T, dtype=np.float64)


def _doubles(values: Reals) -> Floats:
    return np.ascontiguousarray(values, dtype=np.float64)
