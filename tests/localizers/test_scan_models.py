"""Beam models: each is a probability distribution over [0, max_range], and has its book's form."""

import math
from itertools import pairwise

import numpy as np
import pytest

from deqmcl_gym.validation import InputError
from localizers import BeamModel, CensoredGaussianUniform, GaussianUniform

MAX = 400.0
EXPECTED = [0.5, 5.0, 120.0, 395.0, 400.0, 420.0, 800.0]
SIGMAS = [5.0, 100.0]


def phi(z: float) -> float:
    """The standard normal's distribution function."""
    return 0.5 * math.erfc(-z / math.sqrt(2))


def density(model, ranges, expected: float) -> np.ndarray:
    ranges = np.atleast_1d(np.asarray(ranges, dtype=np.float64))
    return model.density(ranges, np.full((1, ranges.size), expected), MAX)[0]


def integral(model, expected: float) -> float:
    """∫ over the open interval (0, max_range), split where a density may jump.

    Midpoint rule with 200,000 intervals of h ≤ 2e-3 px: its error is h²/24 (b - a) max|f''|, and
    |f''| ≤ 1/(σ³ √2π) = 3.2e-3 for a normal of σ = 5, or p(0) λ² ≤ 2 · 1e-4 for the exponential
    on at least 0.5 px: below 1e-6.
    """
    knots, total = sorted({0.0, min(expected, MAX), MAX}), 0.0
    for a, b in pairwise(knots):
        n = 200_000
        middles = a + (np.arange(n) + 0.5) * (b - a) / n
        total += density(model, middles, expected).sum() * (b - a) / n
    return total


@pytest.mark.parametrize("sigma", SIGMAS)
@pytest.mark.parametrize("expected", EXPECTED)
def test_the_censored_model_and_its_two_atoms_come_to_one(expected, sigma):
    model = CensoredGaussianUniform(sigma=sigma)
    atoms = density(model, [0.0, MAX], expected).sum()
    assert integral(model, expected) + atoms == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("sigma", SIGMAS)
@pytest.mark.parametrize("expected", EXPECTED)
def test_the_beam_model_and_its_atom_at_max_range_come_to_one(expected, sigma):
    # Table 6.1 gives the atom as a share of its own beside the densities: it is the jump there.
    model = BeamModel(sigma=sigma)
    below, at = density(model, [np.nextafter(MAX, 0), MAX], expected)
    # the uniform part ends where the atom is; the short part ends at ô
    continuous = below - model.rand / MAX
    assert at - continuous == pytest.approx(model.max, abs=1e-9)
    assert integral(model, expected) + model.max == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("sigma", SIGMAS)
@pytest.mark.parametrize("expected", EXPECTED)
def test_the_gaussian_uniform_comes_to_one_but_for_the_normals_tails_beyond_the_range(
    expected, sigma
):
    # As published: the normal is not renormalised, so what lies beyond [0, max_range] is lost.
    model = GaussianUniform(sigma=sigma)
    kept = phi((MAX - expected) / sigma) - phi(-expected / sigma)
    assert integral(model, expected) == pytest.approx(0.95 * kept + 0.05, abs=1e-5)


@pytest.mark.parametrize("sigma", SIGMAS)
@pytest.mark.parametrize("expected", EXPECTED)
@pytest.mark.parametrize("measured", [1e-9, 3.0, 118.0, 399.0])
def test_the_gaussian_uniform_is_its_formula_and_the_censored_one_nearly(measured, expected, sigma):
    normal = math.exp(-0.5 * ((measured - expected) / sigma) ** 2) / (
        sigma * math.sqrt(2 * math.pi)
    )
    plain = density(GaussianUniform(sigma=sigma), measured, expected)[0]
    censored = density(CensoredGaussianUniform(sigma=sigma), measured, expected)[0]
    assert plain == pytest.approx(0.95 * normal + 0.05 / 400, rel=1e-12)
    assert censored == pytest.approx(0.95 * normal + 0.05 / 402, rel=1e-12)


@pytest.mark.parametrize("sigma", SIGMAS)
@pytest.mark.parametrize("expected", EXPECTED)
def test_the_censored_atoms_are_the_tails_and_a_pixel_of_the_uniform_share(expected, sigma):
    at_zero, at_max = density(CensoredGaussianUniform(sigma=sigma), [0.0, MAX], expected)
    assert at_zero == pytest.approx(0.95 * phi(-expected / sigma) + 0.05 / 402, rel=1e-12)
    assert at_max == pytest.approx(0.95 * phi((expected - MAX) / sigma) + 0.05 / 402, rel=1e-12)


@pytest.mark.parametrize("expected", [30.0, 390.0])
def test_the_censored_model_is_what_a_world_that_clips_its_noise_does(expected):
    # 200,000 beams into 20 bins and two atoms: 44 shares at 5 standard errors, false alarms 3e-5
    rng, n, sigma = np.random.default_rng(1), 200_000, 60.0
    measured = np.clip(expected + sigma * rng.standard_normal(n), 0, MAX)
    model = CensoredGaussianUniform(sigma=sigma, uniform=0.0)
    edges = np.linspace(0, MAX, 21)
    shares = [np.mean(measured == 0), np.mean(measured == MAX)]
    inside = measured[(measured > 0) & (measured < MAX)]
    shares += (np.histogram(inside, edges)[0] / n).tolist()
    exact = density(model, [0.0, MAX], expected).tolist()
    for a, b in pairwise(edges):
        middles = a + (np.arange(2000) + 0.5) * (b - a) / 2000
        exact.append(density(model, middles, expected).mean() * (b - a))
    error = np.sqrt(np.array(exact) * (1 - np.array(exact)) / n)
    assert (np.abs(np.array(shares) - exact) <= 5 * error + 1e-7).all()


def test_the_beam_model_is_table_6_1():
    model = BeamModel(hit=0.7, short=0.1, max=0.1, rand=0.1, sigma=20.0, decay=0.02)
    normal = math.exp(-0.5 * (10 / 20) ** 2) / (20 * math.sqrt(2 * math.pi))
    hit = normal / (phi((400 - 150) / 20) - phi(-150 / 20))
    short = 0.02 * math.exp(-0.02 * 140) / (1 - math.exp(-0.02 * 150))
    assert density(model, 140.0, 150.0)[0] == pytest.approx(
        0.7 * hit + 0.1 * short + 0.1 / 400, rel=1e-12
    )
    assert density(model, 160.0, 150.0)[0] == pytest.approx(0.7 * hit + 0.1 / 400, rel=1e-12)


@pytest.mark.parametrize("model", [GaussianUniform(), CensoredGaussianUniform(), BeamModel()])
def test_beams_and_poses_are_independent_of_each_other(model):
    measured, expected = (
        np.array([0.0, 10.0, 250.0, 400.0]),
        np.array([[5, 90, 260, 395.0], [1, 400, 3, 500]]),
    )
    together = model.density(measured, expected, MAX)
    assert together.shape == (2, 4)
    for pose in range(2):
        for beam in range(4):
            alone = model.density(
                measured[beam : beam + 1], expected[pose, beam].reshape(1, 1), MAX
            )
            assert together[pose, beam] == alone[0, 0]


@pytest.mark.parametrize("model", [GaussianUniform, CensoredGaussianUniform, BeamModel])
@pytest.mark.parametrize("bad", [0, 0.0, -1, math.nan, math.inf, "a", None])
def test_a_sigma_that_is_not_above_zero_is_refused(model, bad):
    with pytest.raises(InputError, match=r"^scan\.sigma is .* above 0\.$"):
        model(sigma=bad)


@pytest.mark.parametrize("model", [GaussianUniform, CensoredGaussianUniform])
@pytest.mark.parametrize("bad", [-0.1, 1.1, math.nan])
def test_a_uniform_share_outside_zero_to_one_is_refused(model, bad):
    with pytest.raises(InputError, match=r"^scan\.uniform is .* from 0 to 1\.$"):
        model(uniform=bad)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ({"hit": 0.9}, "must add up to 1"),
        ({"rand": -0.1}, r"scan\.rand is -0\.1"),
        ({"decay": 0}, r"scan\.decay is 0"),
    ],
)
def test_a_beam_model_whose_shares_or_decay_are_bad_is_refused(bad, words):
    with pytest.raises(InputError, match=words):
        BeamModel(**bad)


@pytest.mark.parametrize("model", [GaussianUniform(), CensoredGaussianUniform(), BeamModel()])
def test_nan_in_a_scan_or_among_the_exact_ranges_is_no_likelihood(model):
    expected = np.array([[100.0, 50.0], [100.0, np.nan], [np.nan, 50.0]], np.float32)
    told = model.log_likelihood(np.array([90.0, 60.0]), expected, MAX)
    assert np.isnan(told).tolist() == [False, True, True]
    assert np.isnan(model.log_likelihood(np.array([90.0, np.nan]), expected, MAX)).all()
