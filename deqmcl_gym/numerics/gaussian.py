"""How well offsets from a mean fit a Gaussian: NEES and log score, by a Cholesky factor.

Compiled, without LAPACK, so that every machine gives the same bits.
"""

import math

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import log64
from deqmcl_gym.numerics.types import Floats

_LOG_TURN = math.log(2 * math.pi)


@compiled
def cholesky(covariance: Floats, least: float = 0.0) -> Floats:
    """Return the lower L with L Lᵀ = covariance, (d, d); a direction without variance gets 0.

    ``least`` is known of the variance of each component given those before it: against rounding.
    """
    d, out = covariance.shape[0], np.zeros(covariance.shape)
    for j in range(d):
        for i in range(j, d):
            rest = covariance[i, j]
            for k in range(j):
                rest -= out[i, k] * out[j, k]
            if i == j:
                out[j, j] = np.sqrt(max(rest, least))
            elif out[j, j] > 0.0:
                out[i, j] = rest / out[j, j]
    return out


@compiled
def fit(root: Floats, off: Floats) -> tuple[float, float, float]:
    """Return how an offset (3,) from the mean fits N(0, P), P = root rootᵀ.

    Its squared Mahalanobis distance in (x, y); in (x, y, θ), which is the NEES dᵀ P⁻¹ d; and the
    log score -log N(d; 0, P) = ½ (NEES + log det 2πP), nats.
    """
    u0 = off[0] / root[0, 0]
    u1 = (off[1] - root[1, 0] * u0) / root[1, 1]
    u2 = (off[2] - root[2, 0] * u0 - root[2, 1] * u1) / root[2, 2]
    distance = u0 * u0 + u1 * u1
    nees = distance + u2 * u2
    size = log64(root[0, 0] * root[1, 1] * root[2, 2])
    return distance, nees, 0.5 * (nees + 3 * _LOG_TURN) + size


@compiled
def fits(offsets: Floats, covariances: Floats, out: Floats) -> None:
    """Fill in the ``fit`` of each offset (n, 3) to N(0, P) of its own covariance, (n, 3)."""
    for i in range(len(offsets)):
        out[i, 0], out[i, 1], out[i, 2] = fit(cholesky(covariances[i]), offsets[i])
