"""Expectation maximization of the beam model: it finds what made the readings, and never falls."""

import math

import numpy as np
import pytest
from refusals import refused

from localizers import BeamModel
from localizers.models.beams import fitted

PARTS = ("hit", "short", "max", "rand")
SETTINGS = [
    (BeamModel(hit=0.7, short=0.15, max=0.1, rand=0.05, sigma=20.0, decay=0.01), 400.0),
    (BeamModel(hit=0.6, short=0.25, max=0.05, rand=0.1, sigma=0.05, decay=0.5), 12.0),
]


def readings(model, max_range, k=20_000, seed=0):
    """Readings drawn part by part, and the exact ranges."""
    rng = np.random.default_rng(seed)
    expected = rng.uniform(0.02, 1.2, k) * max_range
    seen = np.minimum(expected, max_range)
    hit = np.full(k, np.nan)
    while (again := ~((hit >= 0) & (hit <= max_range))).any():
        hit[again] = rng.normal(seen[again], model.sigma)
    short = -np.log1p(rng.random(k) * np.expm1(-model.decay * seen)) / model.decay
    part = rng.choice(4, k, p=[getattr(model, name) for name in PARTS])
    return np.choose(
        part, [hit, short, np.full(k, max_range), rng.uniform(0, max_range, k)]
    ), expected


def log_density(x, ranges, expected, max_range):
    """Log p of readings below the largest range, x = (z_hit, z_short, z_rand, log σ, log λ)."""
    hit, short, rand, log_sigma, log_decay = x
    sigma, decay, seen = math.exp(log_sigma), math.exp(log_decay), np.minimum(expected, max_range)

    def phi(z):
        return 0.5 * np.vectorize(math.erfc)(-z / math.sqrt(2))

    inside = phi((max_range - seen) / sigma) - phi(-seen / sigma)
    normal = np.exp(-0.5 * ((ranges - seen) / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi))
    early = decay * np.exp(-decay * ranges) / -np.expm1(-decay * seen) * (ranges <= seen)
    return np.log(hit * normal / inside + short * early + rand / max_range)


@pytest.mark.parametrize(("model", "max_range"), SETTINGS)
def test_it_finds_the_parameters_that_made_the_readings_within_their_standard_errors(
    model, max_range
):
    """By the information of the scores at the truth; shares add up to 1: one follows the others."""
    ranges, expected = readings(model, max_range)
    fit = fitted(ranges, expected, max_range)
    own = ranges < max_range
    free = np.array([model.hit, model.short, math.log(model.sigma), math.log(model.decay)])

    def logs(values):
        hit, short, sigma, decay = values
        x = (hit, short, 1 - model.max - hit - short, sigma, decay)
        return log_density(x, ranges[own], expected[own], max_range)

    steps = np.eye(4) * 1e-5
    scores = np.stack([(logs(free + step) - logs(free - step)) / 2e-5 for step in steps])
    errors = np.sqrt(np.diag(np.linalg.inv(scores @ scores.T)))
    # given the readings at the largest range, whose share is binomial and a fit of its own
    found, inside = fit.model, (1 - model.max) / (1 - fit.model.max)
    told = [found.hit * inside, found.short * inside, math.log(found.sigma), math.log(found.decay)]
    assert np.abs((told - free) / errors).max() < 5
    assert abs(found.max - model.max) < 5 * math.sqrt(model.max * (1 - model.max) / ranges.size)
    assert fit.readings == ranges.size


@pytest.mark.parametrize("seed", range(6))
def test_the_log_likelihood_never_falls_and_is_that_of_the_model(seed):
    """Of readings of the model, and of others; sums of 1,500 logs are right to 1e-13 each."""
    rng = np.random.default_rng(seed)
    model, max_range = SETTINGS[seed % 2]
    ranges, expected = readings(model, max_range, 1500, seed)
    if seed > 1:  # of no such model
        ranges[: 300 * seed] = max_range * rng.beta(*rng.uniform(0.3, 4, 2), 300 * seed)
    fit = fitted(ranges, expected, max_range)
    assert np.diff(fit.log_likelihoods).min() >= -1e-12
    own = ranges < max_range
    parts = [getattr(fit.model, name) for name in ("hit", "short", "rand")]
    told = log_density(
        (*parts, math.log(fit.model.sigma), math.log(fit.model.decay)),
        ranges[own], expected[own], max_range,
    )  # fmt: skip
    at_max = int((~own).sum())
    whole = (told.sum() + at_max * math.log(fit.model.max)) / ranges.size
    # a share below one reading is raised to it, which takes less than 3 readings of 1,500 from rest
    assert fit.log_likelihoods[-1] == pytest.approx(whole, abs=1e-9 if min(parts) > 0.01 else 3e-3)


def test_what_did_not_occur_stays_possible():
    expected = np.random.default_rng(0).uniform(1.0, 8.0, 500)
    ranges = expected + np.random.default_rng(1).normal(0, 0.05, 500)
    model = fitted(ranges, expected, 10.0).model
    assert min(model.short, model.max, model.rand) > 0.9 / 500
    assert model.least_density(10.0) > 0


def test_unusable_readings_are_left_out_and_too_few_are_refused():
    ranges, expected = readings(*SETTINGS[1], 2000)
    bad_ranges = np.concatenate([ranges, [np.nan, np.inf, -1.0, 13.0, 5.0]])
    bad_expected = np.concatenate([expected, [5.0, 5.0, 5.0, 5.0, np.nan]])
    assert fitted(bad_ranges, bad_expected, 12.0) == fitted(ranges, expected, 12.0)
    with refused("99 readings are below the largest range of 12"):
        fitted(np.append(ranges[ranges < 12][:99], 12.0), np.full(100, 6.0), 12.0)
