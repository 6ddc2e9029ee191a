"""The standard normal distribution, compiled."""

import math

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.floorplan.compiling import compiled

Floats = NDArray[np.float64]


def normal_pdf(z: Floats) -> Floats:
    """N(z; 0, 1)."""
    density: Floats = np.exp(-0.5 * np.square(z)) / math.sqrt(2 * math.pi)
    return density


def normal_cdf(z: Floats) -> Floats:
    """Φ(z), element by element."""
    out = np.empty(z.shape)
    _fill_cdf(np.ascontiguousarray(z).ravel(), out.reshape(-1))
    return out


@compiled
def _fill_cdf(z: Floats, out: Floats) -> None:
    for i in range(z.size):
        out[i] = 0.5 * math.erfc(-z[i] / math.sqrt(2.0))
