"""A Gaussian belief over poses, and points that represent it.

Its compiled arithmetic uses no BLAS, so that every machine gives the same bits.
"""

import math
from functools import lru_cache

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.arrays import cholesky
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, sin64
from deqmcl_gym.numerics.types import Floats


@compiled
def predict(
    mean: Floats,
    covariance: Floats,
    distance: float,
    bearing: float,
    turn: float,
    sd_distance: float,
    sd_turn: float,
) -> None:
    """μ ← f(μ, a), P ← F P Fᵀ + V Q Vᵀ, in place: turn, then drive in direction θ' + bearing.

    F = ∂f/∂x and V = ∂f/∂ε at the mean; Q = diag(sd_distance², sd_turn²).
    """
    heading = mean[2] + turn
    sine, cosine = sin64(heading + bearing), cos64(heading + bearing)
    mean[0] += distance * cosine
    mean[1] += distance * sine
    mean[2] = heading
    lever_x, lever_y = -distance * sine, distance * cosine
    for j in range(3):  # F P
        covariance[0, j] += lever_x * covariance[2, j]
        covariance[1, j] += lever_y * covariance[2, j]
    for i in range(3):  # (F P) Fᵀ
        covariance[i, 0] += lever_x * covariance[i, 2]
        covariance[i, 1] += lever_y * covariance[i, 2]
    drive, swing = (cosine, sine, 0.0), (lever_x, lever_y, 1.0)
    for i in range(3):
        for j in range(3):
            covariance[i, j] += sd_distance * drive[i] * (sd_distance * drive[j])
            covariance[i, j] += sd_turn * swing[i] * (sd_turn * swing[j])


@compiled
def correct(
    mean: Floats,
    covariance: Floats,
    innovations: Floats,
    slopes: Floats,
    variances: Floats,
    gate: float,
) -> int:
    """Take in independent measurements one after another, in place; return how many were gated.

    Each has ν = o - h(μ), of variance S = H P Hᵀ + R; left out if ν² > gate S. All are linearised
    at the mean before the first. P in Joseph's form, which stays symmetric and positive. A beam
    with S = 0, sure to read max_range because every wall is far beyond it, changes nothing.

    Args:
        innovations: o - h at the mean before the first, (B,).
        slopes: H, (B, 3).
        variances: R ≥ 0, (B,).
        gate: largest ν² / S of a beam that is used; inf: all are.
    """
    moved = np.zeros(3)  # of the mean since the linearisation
    projected, gain = np.empty(3), np.empty(3)
    kept = np.empty((3, 3))
    gated = 0
    for b in range(innovations.size):
        slope = slopes[b]
        innovation, spread = innovations[b], variances[b]
        for i in range(3):
            projected[i] = 0.0
            for j in range(3):
                projected[i] += covariance[i, j] * slope[j]
        for i in range(3):
            innovation -= slope[i] * moved[i]
            spread += slope[i] * projected[i]
        if innovation * innovation > gate * spread:
            gated += 1
            continue
        for i in range(3):
            gain[i] = projected[i] / spread if spread > 0.0 else 0.0
            moved[i] += gain[i] * innovation
        for i in range(3):  # (I - K H) P
            for j in range(3):
                kept[i, j] = covariance[i, j] - gain[i] * projected[j]
        for i in range(3):
            along = 0.0
            for j in range(3):
                along += kept[i, j] * slope[j]
            for j in range(3):  # ((I - K H) P)(I - K H)ᵀ + K R Kᵀ
                covariance[i, j] = kept[i, j] - along * gain[j] + gain[i] * variances[b] * gain[j]
    for i in range(3):
        mean[i] += moved[i]
    return gated


def covariance_of(offsets: Floats) -> Floats:
    """Return the mean products of offsets (d, n) from a mean, (d, d)."""
    apart = np.ascontiguousarray(offsets)
    products: Floats = (apart[:, None] * apart).mean(axis=2)
    return products


POINTS = 512
# Powers -1 to -4 of 1.1673039782614187, the steps of an even sequence in four dimensions; written
# out, as NumPy's powers differ between processors.
_STEPS = np.array([0.8566748838545029, 0.733891856627126, 0.6287067210378086, 0.53859725722361])


def gaussian_points(mean: Floats, covariance: Floats) -> Floats:
    """Return ``POINTS`` equally weighted poses with exactly this mean and covariance, (n, 3).

    Fixed points that look standard normal, in pairs ±z and with unit covariance, through the
    Cholesky factor. Six sigma points have these moments too, but they all lie on one ellipsoid: the
    share of points inside an ellipsoid, which coverage counts, would be meaningless.
    """
    root = cholesky(covariance)
    x, y, z = _standard_points()
    offsets = [row[0] * x + row[1] * y + row[2] * z for row in root]
    poses: Floats = mean + np.stack(offsets, axis=1)
    return poses


def sigma_points(mean: Floats, covariance: Floats) -> Floats:
    """Return the six poses μ ± √3 L_i, equally weighted, of this mean and covariance, (3, 6)."""
    root = cholesky(covariance)
    poses: Floats = mean[:, None] + math.sqrt(3) * np.hstack([root, -root])
    return poses


@lru_cache(maxsize=1)
def _standard_points() -> Floats:
    """Columns of mean 0 and covariance I, (3, n)."""
    even = (0.5 + np.arange(POINTS // 2)[:, None] * _STEPS) % 1.0
    radius = np.sqrt(-2 * arrays.log(even[:, :2]))  # Box & Muller 1958
    angle = 2 * np.pi * even[:, 2:]
    half = np.hstack([radius * arrays.cos(angle), radius[:, :1] * arrays.sin(angle[:, :1])]).T
    points = np.hstack([half, -half])
    root = cholesky(covariance_of(points))
    for i in range(3):  # points ← root⁻¹ points, by forward substitution
        for j in range(i):
            points[i] -= root[i, j] * points[j]
        points[i] /= root[i, i]
    return points
