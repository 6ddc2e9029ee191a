"""Resampling: how often each particle is copied, and what is drawn from the rng."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from localizers.inference.resampling import (
    SCHEMES,
    Always,
    WhenDegenerate,
    pointed_at,
    stratified,
    systematic,
)
from localizers.inference.weights import largest, normalized


def counts(chosen: np.ndarray) -> np.ndarray:
    return np.bincount(chosen, minlength=chosen.size)


def random_weights(n: int, rng: np.random.Generator) -> np.ndarray:
    """From nearly equal to nearly all on one, some of them zero."""
    weights = rng.exponential(size=n) ** rng.choice([0.2, 1.0, 8.0]) * (rng.random(n) > 0.2)
    weights[rng.integers(n)] += 0.1
    return weights / weights.sum()


@pytest.mark.parametrize("n", [1, 2, 7, 64, 1000])
def test_a_particle_is_copied_floor_or_ceil_n_w_times_or_within_two_of_n_w_if_stratified(n):
    # n w is rounded: a count may differ where n w is within 1e-9 of a whole number. Of the strata
    # those that a particle's interval covers wholly give one copy each, those at its ends may.
    rng = np.random.default_rng(n)
    for _ in range(200):
        weights = random_weights(n, rng)
        copies = counts(systematic(weights, rng))
        assert (copies >= np.floor(n * weights - 1e-9)).all()
        assert (copies <= np.ceil(n * weights + 1e-9)).all()
        assert (np.abs(counts(stratified(weights, rng)) - n * weights) < 2 + 1e-9).all()


def test_systematic_resampling_of_weights_that_are_all_zero_gives_the_first_particle():
    assert systematic(np.zeros(3), np.random.default_rng(0)).tolist() == [0] * 3


@pytest.mark.parametrize("n", range(10))
def test_the_largest_of_numbers_is_found_wherever_it_stands(n):
    values = -1.0 - np.arange(n)
    assert largest(values) == max(values, default=-math.inf)
    for place in range(n):
        assert largest(np.roll(values, place)) == -1.0
    assert largest(np.full(n, -math.inf)) == -math.inf


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("n", [1, 5, 100])
def test_n_valid_indices_come_out_in_ascending_order_and_none_of_weight_zero(name, n):
    rng = np.random.default_rng(3)
    for _ in range(100):
        weights = random_weights(n, rng)
        chosen = SCHEMES[name](weights, rng)
        assert chosen.shape == (n,)
        assert (np.diff(chosen) >= 0).all()
        assert (weights[chosen] > 0).all()


def test_multinomial_resampling_has_the_multinomial_variance():
    # n w (1 - w); its estimate from 10,000 draws has a relative standard error of about √(2/10⁴)
    weights, rng = np.array([0.1, 0.2, 0.3, 0.4]), np.random.default_rng(5)
    copies = np.array([counts(SCHEMES["multinomial"](weights, rng)) for _ in range(10_000)])
    assert copies.var(axis=0) == pytest.approx(4 * weights * (1 - weights), rel=5 * 0.015)


def test_equal_weights_under_systematic_and_stratified_keep_every_particle():
    for scheme in (systematic, stratified):
        chosen = scheme(np.full(50, 1 / 50), np.random.default_rng(6))
        assert chosen.tolist() == list(range(50))


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("weights", [[1, 1, 1, 1.0], [1, 2, 3, 4.0], [1, 1e-9, 0, 0.0]])
def test_the_rng_is_used_the_same_whether_or_not_resampling_triggers(name, weights):
    states = []
    for strategy in (
        Always(SCHEMES[name]),
        *(WhenDegenerate(t, SCHEMES[name]) for t in (0, 0.5, 1)),
    ):
        rng = np.random.default_rng(7)
        with np.errstate(divide="ignore"):
            strategy.ancestors(normalized(np.log(weights)), rng)
        states.append(rng.bit_generator.state)
    assert all(state == states[0] for state in states)
    assert states[0] != np.random.default_rng(7).bit_generator.state


@pytest.mark.parametrize("threshold", [0.0, 0.3, 0.5, 0.9, 1.0])
def test_resampling_triggers_iff_the_effective_sample_size_is_below_the_threshold(threshold):
    rng, seen = np.random.default_rng(9), set()
    for _ in range(200):
        log_weights = np.log(random_weights(20, rng) + 1e-300)
        chosen = WhenDegenerate(threshold).ancestors(normalized(log_weights), rng)
        weights = np.exp(log_weights)
        degenerate = weights.sum() ** 2 / (weights**2).sum() < threshold * 20
        assert (chosen is not None) == degenerate
        seen.add(degenerate)
    assert seen == {0.0: {False}, 1.0: {True}}.get(threshold, {True, False})


@pytest.mark.parametrize("n", [1, 2, 7, 1000])
def test_systematic_resampling_takes_what_equidistant_pointers_point_at(n):
    rng = np.random.default_rng(12)
    for _ in range(50):
        weights = rng.random(n) * (rng.random(n) < 0.5)  # many are 0, at both ends too
        weights[rng.integers(n)] = rng.random() + 1e-3
        offset = rng.random()
        chosen = systematic(weights, SimpleNamespace(random=lambda u=offset: u))
        assert chosen.tolist() == pointed_at(weights, (np.arange(n) + offset) / n).tolist()
