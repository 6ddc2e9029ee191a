"""Statistics over worlds, against SciPy and against their definitions, on generated worlds."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats as scipy_stats

from benchmarks.tables import stats

NUMBERS = st.floats(-1e6, 1e6)
TIED = st.integers(-3, 4).map(float)  # zeros among them


def worlds(least=0, most=60, of=NUMBERS | TIED):
    return st.lists(of, min_size=least, max_size=most).map(np.array)


def test_the_sample_sd_divides_by_n_minus_1_and_needs_two():
    assert stats.sample_sd(np.array([1.0, 2.0, 6.0])) == pytest.approx(math.sqrt(7), rel=1e-15)
    assert math.isnan(stats.sample_sd(np.array([1.0])))
    assert math.isnan(stats.sample_sd(np.empty(0)))


@pytest.mark.parametrize("unknown", [[], [1.0, math.nan]])
def test_of_nothing_or_with_an_unknown_difference_every_statistic_is_unknown(unknown):
    differences = np.array(unknown)
    assert all(map(math.isnan, stats.paired_bootstrap(differences)))
    assert math.isnan(stats.win_rate(differences))
    assert math.isnan(stats.wilcoxon(differences))
    assert all(map(math.isnan, stats.paired_bootstrap(np.array([1.0]))))  # one world
    assert all(map(math.isnan, stats.wilson(0.0, 0)))
    assert math.isnan(stats.sign_test(np.empty(0)))


@settings(deadline=None, max_examples=20)
@given(worlds(2, 12))
def test_the_interval_is_that_of_resampling_one_after_the_other(differences):
    n, rng = differences.size, np.random.default_rng(0)
    means = [differences[rng.integers(n, size=n)].mean() for _ in range(10_000)]
    low, high = np.quantile(means, [0.025, 0.975])
    seen = stats.paired_bootstrap(differences)
    size = np.abs(differences).max()  # the mean of a row and of a block are added in two orders
    assert seen == pytest.approx((low, high), rel=1e-12, abs=1e-14 * size)


@given(worlds(1))
def test_a_win_is_a_smaller_error_and_a_tie_half_a_win(differences):
    points = [1.0 if d < 0 else 0.5 if d == 0 else 0.0 for d in differences]
    assert stats.win_rate(differences) == pytest.approx(sum(points) / len(points), rel=1e-12)


@settings(deadline=None)
@given(worlds(1, 10, TIED) | worlds(1, 10))
def test_wilcoxon_is_scipys_permutation_test_of_few_with_ties_and_zeros(differences):
    nonzero = differences[differences != 0]
    every_sign = scipy_stats.PermutationMethod(n_resamples=2**10)
    expected = scipy_stats.wilcoxon(nonzero, method=every_sign).pvalue if nonzero.size > 1 else 1.0
    assert stats.wilcoxon(differences) == pytest.approx(expected, rel=1e-12)


@settings(deadline=None)
@given(st.integers(1, 50), st.integers(0, 2**32 - 1))
def test_wilcoxon_is_scipys_exact_test_of_up_to_fifty(n, seed):
    differences = np.random.default_rng(seed).normal(0.3, 1, n)
    expected = scipy_stats.wilcoxon(differences, method="exact").pvalue
    assert stats.wilcoxon(differences) == pytest.approx(expected, rel=1e-12)


@settings(deadline=None)
@given(worlds(60, 200, st.integers(1, 9).map(float) | st.integers(-9, -1).map(float)))
def test_wilcoxon_is_scipys_approximation_of_many_with_ties(differences):
    expected = scipy_stats.wilcoxon(differences, correction=False, method="approx").pvalue
    assert stats.wilcoxon(differences) == pytest.approx(expected, rel=1e-12)


P_VALUES = st.lists(st.floats(0, 1) | st.sampled_from([0.01, 0.5, math.nan]), max_size=12)


@given(P_VALUES, st.floats(0, 0.999))
def test_holm_rejects_at_each_level_what_the_steps_down_reject(alone, level):
    family = sorted((p, i) for i, p in enumerate(alone) if not math.isnan(p))
    rejected = set()
    for rank, (p, i) in enumerate(family):  # Holm 1979: stop at the first that is too large
        if (len(family) - rank) * p > level:
            break
        rejected.add(i)
    corrected = stats.holm(alone)
    assert {i for i, p in enumerate(corrected) if p <= level} == rejected
    assert [math.isnan(p) for p in corrected] == [math.isnan(p) for p in alone]


@given(st.integers(0, 300), st.integers(1, 300))
def test_the_wilson_interval_is_scipys(k, n):
    k = min(k, n)
    expected = scipy_stats.binomtest(k, n).proportion_ci(method="wilson")
    low, high = stats.wilson(k / n, n)
    assert (low, high) == pytest.approx(tuple(expected), rel=1e-9, abs=1e-15)
    assert low <= k / n <= high  # to the last bit: charts draw the distances


@pytest.mark.parametrize(("sd", "tests"), [(1.0, 1), (2.0, 1), (1.5, 5)])
def test_so_many_worlds_find_the_difference_in_four_of_five_experiments(sd, tests):
    worlds = stats.worlds_to_see(1.0, sd, tests)
    rng = np.random.default_rng(0)
    repeats = 1500  # SD of the share: 0.0103

    def found(worlds):
        drawn = (1.0 + sd * rng.standard_normal(worlds) for _ in range(repeats))
        return np.mean([stats.wilcoxon(apart) < 0.05 / tests for apart in drawn])

    assert found(worlds) == pytest.approx(0.8, abs=0.045)
    assert found(worlds * 2 // 3) < 0.72


def test_a_relative_change_is_a_ratio_of_means_with_an_interval_that_covers():
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(200):
        reference = 20 + 4 * rng.standard_normal(40)
        low, high = stats.relative_change(-0.3 * reference + rng.standard_normal(40), reference)[1:]
        inside += low <= -0.3 <= high
    assert inside >= 178  # 190 expected; fewer than this in 1 of 10,000 runs
