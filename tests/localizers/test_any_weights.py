"""Weights of any size: a belief is a distribution, or keeps its weights and counts a collapse."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from localizers.inference import grid_motion
from localizers.inference.belief import ParticleBelief
from localizers.inference.gaussian import gaussian_points, sigma_points
from localizers.inference.queue import Queue
from localizers.inference.resampling import SCHEMES, Always, by_own_weight
from localizers.inference.weights import effective_sample_size, log_sum_exp, normalized
from localizers.models.scan import Scan

INF = math.inf
LOG = st.sampled_from([0.0, -INF, -1e308, 1e308, -745.2, -1e-300]) | st.floats(-1.7e308, 1e3)
SHARE = st.sampled_from([0.0, 1e-300, 1e-16, 1.0]) | st.floats(0, 1)


def lists(of, least=1, most=60):
    alike = st.builds(lambda one, n: [one] * n, of, st.integers(least, most))
    return st.lists(of, min_size=least, max_size=most) | alike


def pairs(most=60):
    """Log-weights before, and log-likelihoods, of as many particles."""
    return st.integers(1, most).flatmap(lambda n: st.tuples(lists(LOG, n, n), lists(LOG, n, n)))


def shares_of(logs: list[float]) -> list[float]:
    """exp(log w) / Σ exp(log w), in plain arithmetic; none if all are 0, or one is infinite."""
    top = max(logs)
    weights = [] if math.isinf(top) else [math.exp(log - top) for log in logs]
    return [weight / math.fsum(weights) for weight in weights]


def cloud(log_weights: list[float]) -> ParticleBelief:
    states = np.arange(3.0 * len(log_weights)).reshape(3, -1)
    return ParticleBelief(Queue((states,)), np.array(log_weights), np.empty((0, 2)))


@settings(deadline=None)
@given(lists(LOG))
def test_weights_are_a_distribution_with_the_ratios_of_their_logarithms(logs):
    expected = shares_of(logs)
    if not expected:
        assert log_sum_exp(np.array(logs)) == -INF
        return
    seen = normalized(np.array(logs))
    assert seen == pytest.approx(expected, rel=1e-12, abs=1e-300)
    assert (seen >= 0).all()
    assert seen.sum() == pytest.approx(1.0, abs=1e-12)
    assert effective_sample_size(seen) == pytest.approx(1 / math.fsum(w * w for w in expected))
    total = max(logs) + math.log(math.fsum(math.exp(log - max(logs)) for log in logs))
    assert log_sum_exp(np.array(logs)) == pytest.approx(total)


@settings(deadline=None)
@given(pairs(), st.booleans())
def test_evidence_of_any_size_makes_a_distribution_or_is_dropped_and_counted(given_logs, is_scan):
    before, factor = given_logs
    belief = cloud(before)
    logs = np.array(factor)
    after = belief.scanned(Scan.of(np.zeros(1), 1.0), logs) if is_scan else belief.reweighted(logs)
    expected = shares_of([a + b for a, b in zip(before, factor, strict=True)])
    assert after.events.weight_collapses == (not expected)
    if expected:
        assert after.points()[1] == pytest.approx(expected, rel=1e-12, abs=1e-300)
    else:
        assert after.log_weights.tolist() == before
        assert after.log_evidence == belief.log_evidence


@settings(deadline=None)
@given(lists(SHARE), lists(LOG))
def test_the_mass_of_a_grid_is_a_distribution_or_none_is_left(shares, logs):
    mass = np.resize(shares, max(len(shares), len(logs)))
    mass = mass / max(mass.sum(), 1e-300)
    mass[mass < grid_motion.NOTHING] = 0.0
    logs, after = np.resize(logs, mass.size), np.empty(mass.size)
    evidence = grid_motion.reweight(mass, logs, after)
    top = logs[mass > 0].max(initial=-INF)
    assert (evidence == -INF) == (top == -INF)
    if top > -INF:
        with np.errstate(over="ignore"):  # logs - top
            relative = mass * np.exp(np.minimum(logs - top, 0.0))
        assert after == pytest.approx(relative / relative.sum(), rel=1e-9, abs=1e-12)


@settings(deadline=None)
@given(
    st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3),
    st.lists(st.floats(-1, 1), min_size=3, max_size=3),
    st.lists(st.just(0.0) | st.floats(1e-2, 1), min_size=3, max_size=3),
    st.floats(-6, 6),
)
def test_the_points_of_a_gaussian_have_its_moments_also_where_it_has_no_width(mean, row, sds, size):
    correlated = np.array([[1, 0, 0], [row[0], 1, 0], [row[1], row[2], 1]]) * np.array(sds)[:, None]
    covariance = correlated @ correlated.T * 10.0**size
    centre = np.array(mean)
    scale = np.sqrt(np.trace(covariance)) + 1e-9 * np.abs(centre).max() + 1e-30
    for points in (gaussian_points(centre, covariance), sigma_points(centre, covariance).T):
        apart = (points - centre) / scale
        assert np.abs(apart.mean(axis=0)).max() < 1e-6
        assert apart.T @ apart / len(apart) == pytest.approx(covariance / scale**2, abs=1e-6)


class Same:
    """A generator whose numbers are all the same one."""

    def __init__(self, number: float) -> None:
        self.number = number

    def random(self, size: int | None = None):
        return self.number if size is None else np.full(size, self.number)


@settings(deadline=None)
@given(lists(SHARE, 1, 20).filter(lambda shares: sum(shares) > 1e-290))
def test_resampling_copies_each_particle_n_w_times_on_average_and_no_weightless_one(shares):
    # A pointer's place is uniform in its stratum, so what it copies on average is found on a grid
    # of 200 places: to 1/200 of a pointer at either end of a particle's interval.
    n, weights = len(shares), np.array(shares) / math.fsum(shares)
    for scheme in SCHEMES.values():
        copies = np.zeros(n)
        for place in (np.arange(200) + 0.5) / 200:
            chosen = scheme(weights, Same(place))
            assert (weights[chosen] > 0).all()
            copies += np.bincount(chosen, minlength=n) / 200
        for extreme in (0.0, math.nextafter(1.0, 0.0)):  # (n - 1 + u) / n is rounded to 1
            assert (weights[scheme(weights, Same(extreme))] > 0).all()
        per_pointer = n if scheme is SCHEMES["multinomial"] else 1
        assert np.abs(copies - n * weights).max() <= per_pointer / 200 + 1e-9


@settings(deadline=None)
@given(lists(LOG).filter(lambda logs: max(logs) > -INF), st.integers(0, 2**32 - 1))
def test_a_resampled_belief_is_evenly_weighted_and_has_the_evidence_of_before(logs, seed):
    belief = cloud(logs)
    chosen = Always().ancestors(belief.weights, np.random.default_rng(seed))
    after = belief.resampled(chosen, by_own_weight(belief), log_sum_exp(belief.log_weights))
    n = len(logs)
    assert after.points()[1].tolist() == pytest.approx([1 / n] * n)
    assert set(after.present[0]) <= set(belief.present[0][np.array(logs) > -INF])
    assert after.log_evidence == pytest.approx(belief.log_evidence, rel=1e-9, abs=1e-9)
