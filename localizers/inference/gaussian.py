"""Points that represent a Gaussian belief over poses."""

import math
from functools import lru_cache

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats
from localizers.inference import gaussian_kernels as kernels

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
    root = np.zeros((3, 3))
    kernels.cholesky(covariance, root)
    x, y, z = _standard_points()
    offsets = [row[0] * x + row[1] * y + row[2] * z for row in root]
    poses: Floats = mean + np.stack(offsets, axis=1)
    return poses


def sigma_points(mean: Floats, covariance: Floats) -> Floats:
    """Return the six poses μ ± √3 L_i, equally weighted, of this mean and covariance, (3, 6)."""
    root = np.zeros((3, 3))
    kernels.cholesky(covariance, root)
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
    root, covariance = np.zeros((3, 3)), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            covariance[i, j] = (points[i] * points[j]).mean()
    kernels.cholesky(covariance, root)
    for i in range(3):  # points ← root⁻¹ points, by forward substitution
        for j in range(i):
            points[i] -= root[i, j] * points[j]
        points[i] /= root[i, i]
    return points
