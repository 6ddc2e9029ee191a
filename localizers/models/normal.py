"""The standard normal distribution."""

import math

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats


def normal_pdf(z: Floats) -> Floats:
    """N(z; 0, 1)."""
    density: Floats = arrays.exp(-0.5 * np.square(z)) / math.sqrt(2 * math.pi)
    return density


def normal_cdf(z: Floats) -> Floats:
    """Φ(z), element by element."""
    return arrays.normal_cdf(z)
