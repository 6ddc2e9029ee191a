"""Beam models: each is a probability distribution over [0, max_range], and has its book's form."""

import math
from itertools import pairwise

import numpy as np
import pytest

from deqmcl_gym.maps.map import scaled
from deqmcl_gym.validation import InputError
from localizers import BeamModel, CensoredGaussianUniform, GaussianUniform
from localizers.models.beams import beam_model

MAX = 400.0
MODELS = [GaussianUniform, CensoredGaussianUniform, BeamModel]


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


@pytest.mark.parametrize("model", MODELS)
def test_a_beam_with_nothing_in_its_way_is_one_whose_wall_is_far_beyond_the_limit(model):
    """At 1e6 px, 1e5 standard deviations beyond the limit, no normal is left in float64."""
    ranges, nothing = np.array([0.0, 3.0, 200.0, MAX]), np.full((2, 4), np.inf)
    beyond = np.full_like(nothing, 1e6)
    told, far = (model(sigma=5.0).log_likelihood(ranges, e, MAX) for e in (nothing, beyond))
    assert np.isfinite(told).all()
    np.testing.assert_array_equal(told, far)


@pytest.mark.parametrize("sigma", [5.0, 100.0])
@pytest.mark.parametrize("expected", [0.5, 5.0, 120.0, 395.0, 400.0, 420.0, 800.0])
def test_densities_and_atoms_come_to_one(expected, sigma):
    censored = CensoredGaussianUniform(sigma=sigma)
    atoms = density(censored, [0.0, MAX], expected).sum()
    assert integral(censored, expected) + atoms == pytest.approx(1.0, abs=1e-5)
    # Table 6.1 gives the atom as a share of its own beside the densities: it is the jump there,
    # where the uniform part ends.
    beam = BeamModel(sigma=sigma)
    below, at = density(beam, [np.nextafter(MAX, 0), MAX], expected)
    assert at - below + beam.rand / MAX == pytest.approx(beam.max, abs=1e-9)
    assert integral(beam, expected) + beam.max == pytest.approx(1.0, abs=1e-5)
    # As published: the normal is not renormalised, so what lies beyond [0, max_range] is lost.
    kept = phi((MAX - expected) / sigma) - phi(-expected / sigma)
    published = integral(GaussianUniform(sigma=sigma), expected)
    assert published == pytest.approx(0.95 * kept + 0.05, abs=1e-5)


@pytest.mark.parametrize(
    ("model", "bad", "words"),
    [
        *[(model, {"sigma": 0}, r"^scan\.sigma is 0.* above 0\.$") for model in MODELS],
        (GaussianUniform, {"uniform": 1.1}, r"^scan\.uniform is .* from 0 to 1\.$"),
        (CensoredGaussianUniform, {"uniform": -0.1}, r"^scan\.uniform is .* from 0 to 1\.$"),
        (BeamModel, {"hit": 0.9}, "must add up to 1"),
        (BeamModel, {"rand": -0.1}, r"scan\.rand is -0\.1"),
        (BeamModel, {"decay": 0}, r"scan\.decay is 0"),
    ],
)
def test_a_bad_parameter_is_refused_with_its_field(model, bad, words):
    with pytest.raises(InputError, match=words):
        model(**bad)


def exact_density(model, o: float, expected: float) -> float:
    """A beam's density, or mass, by the formulas alone."""
    sigma, seen = model.sigma, min(expected, MAX)
    normal = math.exp(-0.5 * ((o - expected) / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi))
    if isinstance(model, BeamModel):
        normal = math.exp(-0.5 * ((o - seen) / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi))
        hit = normal / (phi((MAX - seen) / sigma) - phi(-seen / sigma))
        short = math.exp(-model.decay * o) / -math.expm1(-model.decay * seen) if o <= seen else 0
        other = model.max if o == MAX else model.rand / MAX
        return model.hit * hit + model.short * model.decay * short + other
    if isinstance(model, GaussianUniform):
        return (1 - model.uniform) * normal + model.uniform / MAX
    hit = (
        phi(-expected / sigma) if o == 0 else phi((expected - MAX) / sigma) if o == MAX else normal
    )
    return (1 - model.uniform) * hit + model.uniform / 402


@pytest.mark.parametrize("sigma", [0.5, 5.0, 100.0, 1000.0])
@pytest.mark.parametrize("model", MODELS)
def test_the_compiled_log_likelihood_is_the_sum_of_the_logs_of_the_formulas(model, sigma):
    rng, beam = np.random.default_rng(1), model(sigma=sigma)
    measured = rng.uniform(0, MAX, 40)  # more than one fold
    measured[::5], measured[1::5] = 0.0, MAX
    expected = rng.uniform(0.5, 500, (600, 40)).astype(np.float32)  # more than one block
    exact = [
        sum(math.log(exact_density(beam, o, e)) for o, e in zip(measured, row, strict=True))
        for row in expected.astype(float).tolist()
    ]
    # The share of a hit is wide by some 1e-16, in the tails to z² times that; it is under 1e-13 of
    # a density that has a floor, where z < 12. The logarithms are of some units, forty of them.
    seen = beam.log_likelihood(measured, expected, MAX)
    assert seen == pytest.approx(exact, rel=1e-12, abs=40 * 1e-13)
    densities = beam.density(measured, expected.astype(float), MAX)
    assert np.log(densities).sum(axis=1) == pytest.approx(exact, rel=1e-12, abs=40 * 1e-13)


def test_without_a_uniform_share_what_cannot_be_has_no_likelihood_and_tails_keep_theirs():
    beam = CensoredGaussianUniform(sigma=5.0, uniform=0.0)
    expected = np.array([[400.0], [380.0], [250.0], [200.0]], np.float32)
    seen = beam.log_likelihood(np.array([MAX]), expected, MAX)
    exact = [math.log(phi((e - MAX) / 5)) for e in (400, 380, 250)]
    assert seen.tolist() == pytest.approx([*exact, -math.inf], rel=1e-12)


def test_beam_models_are_made_by_name():
    assert beam_model("gaussian-uniform") == GaussianUniform()
    assert beam_model("censored-gaussian-uniform", sigma=5) == CensoredGaussianUniform(sigma=5)
    assert beam_model("beam-model", hit=0.7, max=0.15) == BeamModel(hit=0.7, max=0.15)
    with pytest.raises(InputError, match=r"unknown beam model 'beam': did you mean 'beam-model'\?"):
        beam_model("beam")
    with pytest.raises(
        InputError, match=r"the beam model 'beam-model' 'sigm': did you mean 'sigma'"
    ):
        beam_model("beam-model", sigm=3.0)


@pytest.mark.parametrize("model", [model() for model in MODELS])
def test_lengths_in_another_unit_are_the_same_model(model):
    measured, expected = np.array([0.0, 90.0, 399.0, 400.0]), np.array([[20, 100, 250, 500]])
    in_px = model.density(measured, expected.astype(float), MAX)
    in_m = scaled(model, 0.02).density(measured * 0.02, expected * 0.02, MAX * 0.02)
    densities = 0.02 if isinstance(model, GaussianUniform) else np.array([[1, 0.02, 0.02, 1]])
    if not isinstance(model, BeamModel):  # its mass at the end stands beside a density
        assert in_m * densities == pytest.approx(in_px, rel=1e-12)
    else:
        assert in_m[:, :3] * 0.02 == pytest.approx(in_px[:, :3], rel=1e-12)


@pytest.mark.parametrize("model", [model() for model in MODELS])
def test_nan_in_a_scan_or_among_the_exact_ranges_is_no_likelihood(model):
    expected = np.array([[100.0, 50.0], [100.0, np.nan], [np.nan, 50.0]], np.float32)
    told = model.log_likelihood(np.array([90.0, 60.0]), expected, MAX)
    assert np.isnan(told).tolist() == [False, True, True]
    assert np.isnan(model.log_likelihood(np.array([90.0, np.nan]), expected, MAX)).all()


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("power", [1.0, 0.5, 0.1])
def test_the_power_scales_the_log_likelihood_and_widens_what_a_beam_says(model, power):
    plain, tempered = model(sigma=20.0), model(sigma=20.0, power=power)
    rng = np.random.default_rng(0)
    expected = rng.uniform(1, 500, (40, 7)).astype(np.float32)
    ranges = np.append(rng.uniform(0, MAX, 6), MAX)
    whole = plain.log_likelihood(ranges, expected, MAX)
    np.testing.assert_array_equal(tempered.log_likelihood(ranges, expected, MAX), power * whole)
    logs = np.log(tempered.density(ranges, expected.astype(np.float64), MAX)).sum(axis=1)
    np.testing.assert_allclose(logs, power * whole, rtol=1e-6)
    assert tempered.least_density(MAX) == plain.least_density(MAX) ** power
    variances = [one.hit_moments(np.array([[50.0]]), MAX)[1].item() for one in (plain, tempered)]
    assert variances[1] == variances[0] / power


@pytest.mark.parametrize("power", [0, 1.1, -1, float("nan")])
def test_a_power_outside_its_range_is_refused(power):
    with pytest.raises(InputError, match=r"^scan\.power is "):
        GaussianUniform(power=power)
