"""A share of unexplained beams that each scan has anew: summed out exactly, and a distribution."""

import math
from itertools import product

import numpy as np
import pytest

from localizers import CensoredGaussianUniform, LatentShare

MAX = 400.0
SETTINGS = [(0.05, 2.0), (0.5, 0.3), (0.2, 50.0)]


def parts(model, ranges, expected):
    """p_hit and p_any of each beam, (n, B) each."""
    return [
        CensoredGaussianUniform(sigma=model.sigma, uniform=share).density(ranges, expected, MAX)
        for share in (0.0, 1.0)
    ]


def log_beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)


@pytest.mark.parametrize(("uniform", "concentration"), SETTINGS)
def test_it_is_the_sum_over_which_beams_are_unexplained_weighed_by_the_moments_of_their_share(
    uniform, concentration
):
    model = LatentShare(sigma=20.0, uniform=uniform, concentration=concentration)
    a, b = concentration * uniform, concentration * (1 - uniform)
    ranges = np.array([50.0, 0.0, MAX, 200.0, 120.0, 119.0])
    expected = np.random.default_rng(0).uniform(0.5, 500, (130, 6)).astype(np.float32)
    hit, other = parts(model, ranges, expected.astype(np.float64))
    total = np.zeros(130)
    for unexplained in product((False, True), repeat=6):
        k = sum(unexplained)
        moment = math.exp(log_beta(a + k, b + 6 - k) - log_beta(a, b))  # E[u^k (1 - u)^(6 - k)]
        total += moment * np.where(unexplained, other, hit).prod(axis=1)
    seen = model.log_likelihood(ranges, expected, MAX)
    # logs of some tens, from densities right to some 1e-13
    np.testing.assert_allclose(seen, np.log(total), rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize(("uniform", "concentration"), SETTINGS)
def test_summed_over_what_one_beam_may_read_it_is_the_likelihood_of_the_other_beams(
    uniform, concentration
):
    """So by induction all readings come to 1, as those of one beam do.

    Midpoints h = 0.2 px apart: off by h²/24 · 400 · max|f''|, |f''| ≤ 1/(σ³ √2π) = 5e-5, less than
    4e-5 of the other beams' likelihood, which weighs p_hit by 1 at most.
    """
    model = LatentShare(sigma=20.0, uniform=uniform, concentration=concentration)
    expected = np.array([[100.0, 250.0, 390.0], [300.0, 5.0, 450.0]], np.float32)
    others = np.array([110.0, 40.0])
    middles = (np.arange(2000) + 0.5) * 0.2

    def likelihood(reading: float) -> np.ndarray:
        return np.exp(model.log_likelihood(np.append(others, reading), expected, MAX))

    total = sum(map(likelihood, middles)) * 0.2 + likelihood(0.0) + likelihood(MAX)
    alone = np.exp(model.log_likelihood(others, expected[:, :2], MAX))
    np.testing.assert_allclose(total / alone, 1.0, atol=1e-4)


@pytest.mark.parametrize("power", [1.0, 0.3])
def test_of_one_beam_and_where_scans_are_alike_it_is_the_censored_model(power):
    ranges = np.array([50.0, 0.0, MAX, 200.0])
    expected = np.random.default_rng(1).uniform(0.5, 500, (70, 4)).astype(np.float32)
    same = {"sigma": 20.0, "uniform": 0.1, "power": power}
    censored = CensoredGaussianUniform(**same)
    one = LatentShare(**same).log_likelihood(ranges[:1], expected[:, :1], MAX)
    np.testing.assert_allclose(
        one, censored.log_likelihood(ranges[:1], expected[:, :1], MAX), rtol=1e-12
    )
    # E[u^k (1-u)^(B-k)] is u^k (1-u)^(B-k) but for a share of B² / (u c)
    alike = LatentShare(**same, concentration=1e9).log_likelihood(ranges, expected, MAX)
    np.testing.assert_allclose(
        alike, censored.log_likelihood(ranges, expected, MAX), rtol=0, atol=16 / 1e8
    )


def test_an_unexplained_beam_makes_the_next_one_likelier():
    model = LatentShare(sigma=5.0)
    expected = np.full((1, 2), 200.0, np.float32)
    both = model.log_likelihood(np.array([50.0, 60.0]), expected, MAX)
    each = [model.log_likelihood(np.array([r]), expected[:, :1], MAX) for r in (50.0, 60.0)]
    assert both[0] > sum(each)[0] + 1


def test_hundreds_of_beams_neither_under_nor_overflow():
    rng = np.random.default_rng(2)
    for uniform, sigma in ((0.05, 1e-6), (1e-300, 5.0), (0.9, 1e6)):
        model = LatentShare(sigma=sigma, uniform=uniform)
        expected = rng.uniform(1, 400, (3, 700)).astype(np.float32)
        for ranges in (expected[0].astype(np.float64), rng.uniform(0, MAX, 700)):
            seen = model.log_likelihood(ranges, expected, MAX)
            assert np.isfinite(seen).all()
            assert (seen >= 700 * math.log(model.least_density(MAX))).all()
