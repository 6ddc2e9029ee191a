"""The standard normal distribution."""

import math

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics import elementary

Floats = NDArray[np.float64]


def normal_pdf(z: Floats) -> Floats:
    """N(z; 0, 1)."""
    density: Floats = np.exp(-0.5 * np.square(z)) / math.sqrt(2 * math.pi)
    return density


def normal_cdf(z: Floats) -> Floats:
    """Φ(z), element by element."""
    out = np.empty(z.shape)
    elementary.normal_cdf(np.ascontiguousarray(z).ravel(), out.reshape(-1))
    return out
