"""A share of unexplained beams that each scan has anew: summed out exactly, and a distribution."""

import math
from itertools import product

import numpy as np
import pytest
from following import density

from localizers import CensoredGaussianUniform, LatentShare

MAX = 400.0
SETTINGS = [(0.05, 2.0), (0.5, 0.3), (0.2, 50.0)]


def parts(model, ranges, expected):
    """p_hit and p_any of each beam, (n, B) each."""
    return [
        density(CensoredGaussianUniform(sigma=model.sigma, uniform=share), ranges, expected, MAX)
        for share in (0.0, 1.0)
    ]


def log_beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)


@pytest.mark.parametrize("power", [1.0, 0.3])
@pytest.mark.parametrize(("uniform", "concentration"), SETTINGS)
def test_it_is_the_sum_over_which_beams_are_unexplained_weighed_by_the_moments_of_their_share(
    uniform, concentration, power
):
    model = LatentShare(sigma=20.0, uniform=uniform, concentration=concentration, power=power)
    a, b = concentration * uniform, concentration * (1 - uniform)
    ranges = np.array([50.0, 0.0, MAX, 200.0, 120.0, 119.0])
    expected = np.random.default_rng(0).uniform(0.5, 500, (130, 6)).astype(np.float32)
    hit, other = parts(model, ranges, expected)
    total = np.zeros(130)
    for unexplained in product((False, True), repeat=6):
        k = sum(unexplained)
        moment = math.exp(log_beta(a + k, b + 6 - k) - log_beta(a, b))  # E[u^k (1 - u)^(6 - k)]
        total += moment * np.where(unexplained, other, hit).prod(axis=1)
    seen = model.log_likelihood(ranges, expected, MAX)
    # logs of some tens, from densities right to some 1e-13
    np.testing.assert_allclose(seen, power * np.log(total), rtol=1e-12, atol=1e-11)


def test_hundreds_of_beams_neither_under_nor_overflow():
    rng = np.random.default_rng(2)
    for uniform, sigma in ((0.05, 1e-6), (1e-300, 5.0), (0.9, 1e6)):
        model = LatentShare(sigma=sigma, uniform=uniform)
        expected = rng.uniform(1, 400, (3, 700)).astype(np.float32)
        for ranges in (expected[0].astype(np.float64), rng.uniform(0, MAX, 700)):
            seen = model.log_likelihood(ranges, expected, MAX)
            assert np.isfinite(seen).all()
            assert (seen >= 700 * math.log(model.least_density(MAX))).all()
