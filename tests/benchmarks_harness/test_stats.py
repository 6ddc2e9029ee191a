"""Statistics over worlds, against SciPy and against resampling by hand."""

import math

import numpy as np
import pytest
from scipy import stats as scipy_stats

from benchmarks.tables import stats


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


def test_one_world_has_no_interval():
    assert all(map(math.isnan, stats.paired_bootstrap(np.array([1.0]))))


def test_the_interval_covers_the_true_mean_in_about_95_percent_of_experiments(monkeypatch):
    # 400 experiments of 40 worlds. A percentile bootstrap of 40 normal differences covers as
    # ±1.96 σ̂₀/√40 does: P(|t_39| < 1.96 √(39/40)) = 94.0 %; 400 resamples instead of 10,000, for
    # speed, cost about 0.4 %. Binomial(400, 0.936) is below 356 or above 391 with probability
    # 3·10⁻⁴: the false-alarm rate over seeds. 85 % or 99.7 % would fail in 98 % of seeds.
    monkeypatch.setattr(stats, "_RESAMPLES", 400)
    rng = np.random.default_rng(1)
    covered = 0
    for _ in range(400):
        low, high = stats.paired_bootstrap(rng.normal(2.0, 3.0, 40))
        covered += low <= 2.0 <= high
    assert 356 <= covered <= 391


@pytest.mark.parametrize("worlds", [2, 7, 40])
def test_the_interval_is_that_of_resampling_one_after_the_other(worlds):
    differences = np.random.default_rng(worlds).normal(3, 5, worlds)
    rng = np.random.default_rng(0)
    means = [differences[rng.integers(worlds, size=worlds)].mean() for _ in range(10_000)]
    expected = tuple(np.quantile(means, [0.025, 0.975]))
    assert stats.paired_bootstrap(differences) == pytest.approx(expected, rel=1e-12)


def test_a_win_is_a_smaller_error_and_a_tie_half_a_win():
    assert stats.win_rate(np.array([-1.0, -2.0, 3.0, 0.0])) == (2 + 0.5) / 4


@pytest.mark.parametrize("n", [1, 2, 5, 12, 50])
def test_wilcoxon_is_scipys_exact_test_where_there_are_no_ties(n):
    for seed in range(5):
        differences = np.random.default_rng([n, seed]).normal(0.3, 1, n)
        expected = scipy_stats.wilcoxon(differences, method="exact").pvalue
        assert stats.wilcoxon(differences) == pytest.approx(expected, rel=1e-12)


TIED = np.random.default_rng(1).integers(-4, 6, 30).astype(float)  # zeros among them
MANY = [np.random.default_rng(n).normal(0.1, 1, n) for n in (51, 200)]


@pytest.mark.parametrize("differences", [TIED, *MANY])
def test_wilcoxon_is_scipys_approximation_of_many_or_with_ties_and_zeros(differences):
    expected = scipy_stats.wilcoxon(differences, correction=False, method="approx").pvalue
    assert stats.wilcoxon(differences) == pytest.approx(expected, rel=1e-12)


def test_wilcoxon_of_no_difference_at_all_is_1():
    assert stats.wilcoxon(np.zeros(5)) == 1.0


@pytest.mark.parametrize(
    ("alone", "corrected"),
    [
        # sorted 0.01, 0.02, 0.03, 0.04 times 4, 3, 2, 1, made monotone
        ([0.04, 0.01, 0.03, 0.02], [0.06, 0.04, 0.06, 0.06]),
        ([0.9, math.nan, 0.6], [1.0, math.nan, 1.0]),  # what was not tested is no member
    ],
)
def test_holm_is_the_example_by_hand(alone, corrected):
    assert stats.holm(alone) == pytest.approx(corrected, nan_ok=True)


@pytest.mark.parametrize(("k", "n"), [(0, 10), (3, 10), (10, 10), (0, 200), (17, 200)])
def test_the_wilson_interval_is_scipys(k, n):
    expected = scipy_stats.binomtest(k, n).proportion_ci(method="wilson")
    # at 0 and n of n scipy's end is exactly 0 or 1, ours up to rounding
    assert stats.wilson(k / n, n) == pytest.approx(tuple(expected), rel=1e-9, abs=1e-15)


def test_the_wilson_interval_of_nothing_is_unknown():
    assert all(map(math.isnan, stats.wilson(0.0, 0)))
