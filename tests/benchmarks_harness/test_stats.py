"""The paired bootstrap and the sample SD."""

import math

import numpy as np
import pytest
from scipy import stats as scipy_stats

from benchmarks.tables import stats


def test_the_sample_sd_divides_by_n_minus_1_and_needs_two():
    assert stats.sample_sd(np.array([1.0, 2.0, 6.0])) == pytest.approx(math.sqrt(7), rel=1e-15)
    assert math.isnan(stats.sample_sd(np.array([1.0])))
    assert math.isnan(stats.sample_sd(np.empty(0)))


@pytest.mark.parametrize("worlds", [2, 3, 10, 200])
def test_the_interval_contains_the_mean_and_stays_between_the_extremes(worlds):
    differences = np.random.default_rng(worlds).normal(3, 5, worlds)
    low, high = stats.paired_bootstrap(differences)
    assert differences.min() <= low < differences.mean() < high <= differences.max()


def test_constant_differences_have_an_interval_of_no_width():
    assert stats.paired_bootstrap(np.full(7, -2.5)) == (-2.5, -2.5)


def test_the_same_differences_give_the_same_interval_and_no_global_randomness_is_touched():
    differences = np.array([1.0, 5.0, -2.0, 0.5])
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    first = stats.paired_bootstrap(differences)
    assert stats.paired_bootstrap(differences.copy()) == first
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002


@pytest.mark.parametrize("too_few", [[], [1.0]])
def test_fewer_than_two_worlds_have_no_interval(too_few):
    assert all(math.isnan(end) for end in stats.paired_bootstrap(np.array(too_few)))


def test_the_interval_moves_and_scales_with_the_differences():
    differences = np.array([1.0, 5.0, -2.0, 0.5, 8.0])
    low, high = stats.paired_bootstrap(differences)
    moved = stats.paired_bootstrap(4 * differences + 16)
    assert moved == pytest.approx((4 * low + 16, 4 * high + 16), rel=1e-12)  # roundings


def test_of_many_normal_differences_the_interval_is_the_normal_one():
    # The mean of 400 is normal with SD σ/20, σ the SD of the sample (ddof 0: what is resampled
    # from); its skewness, √(6/400)/20 at most twice over, shifts a quantile by less than 0.01 SD.
    # A 2.5 % quantile of 10,000 resamples has the standard error √(0.025 · 0.975 / 10⁴) / 0.0584
    # = 0.027 SD. Bound: five of them and the skewness, 0.15 SD; a 90 % interval is off by 0.31 SD.
    differences = np.random.default_rng(0).normal(1, 10, 400)
    sd = differences.std() / 20
    low, high = stats.paired_bootstrap(differences)
    assert low == pytest.approx(differences.mean() - 1.96 * sd, abs=0.15 * sd)
    assert high == pytest.approx(differences.mean() + 1.96 * sd, abs=0.15 * sd)


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


def test_the_interval_is_that_of_resampling_one_after_the_other():
    differences = np.array([1.0, 5.0, -2.0, 0.5, 8.0, 3.5, -7.0])
    rng = np.random.default_rng(0)
    means = [differences[rng.integers(7, size=7)].mean() for _ in range(10_000)]
    expected = tuple(np.quantile(means, [0.025, 0.975]))
    assert stats.paired_bootstrap(differences) == pytest.approx(expected, rel=1e-12)


def test_an_unknown_difference_makes_every_statistic_unknown():
    unknown = np.array([1.0, math.nan])
    assert all(math.isnan(end) for end in stats.paired_bootstrap(unknown))
    assert math.isnan(stats.win_rate(unknown))
    assert math.isnan(stats.wilcoxon(unknown))


def test_a_win_is_a_smaller_error_and_a_tie_half_a_win():
    assert stats.win_rate(np.array([-1.0, -2.0, 3.0, 0.0])) == (2 + 0.5) / 4
    assert math.isnan(stats.win_rate(np.empty(0)))


@pytest.mark.parametrize("n", [1, 2, 5, 12, 50])
def test_wilcoxon_is_scipys_exact_test_where_there_are_no_ties(n):
    for seed in range(5):
        differences = np.random.default_rng([n, seed]).normal(0.3, 1, n)
        expected = scipy_stats.wilcoxon(differences, method="exact").pvalue
        assert stats.wilcoxon(differences) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("n", [51, 200])
def test_wilcoxon_is_scipys_approximation_of_many(n):
    differences = np.random.default_rng(n).normal(0.1, 1, n)
    expected = scipy_stats.wilcoxon(differences, correction=False, method="approx").pvalue
    assert stats.wilcoxon(differences) == pytest.approx(expected, rel=1e-12)


def test_wilcoxon_is_scipys_approximation_where_there_are_ties_and_zeros():
    differences = np.random.default_rng(1).integers(-4, 6, 30).astype(float)
    assert (differences == 0).any()
    expected = scipy_stats.wilcoxon(differences, correction=False, method="approx").pvalue
    assert stats.wilcoxon(differences) == pytest.approx(expected, rel=1e-12)


def test_wilcoxon_of_no_difference_at_all_is_1_and_of_nothing_unknown():
    assert stats.wilcoxon(np.zeros(5)) == 1.0
    assert math.isnan(stats.wilcoxon(np.empty(0)))


def test_the_smallest_p_of_wilcoxon_counts_sign_patterns():
    assert stats.wilcoxon(np.arange(1.0, 11.0)) == 2 / 2**10


def test_holm_is_the_example_by_hand():
    # sorted 0.01, 0.02, 0.03, 0.04 times 4, 3, 2, 1, made monotone
    assert stats.holm([0.04, 0.01, 0.03, 0.02]) == pytest.approx([0.06, 0.04, 0.06, 0.06])


def test_holm_bounds_at_1_and_leaves_out_what_was_not_tested():
    adjusted = stats.holm([0.9, math.nan, 0.4])
    assert adjusted[0] == 0.9
    assert math.isnan(adjusted[1])
    assert adjusted[2] == 0.8


@pytest.mark.parametrize(("k", "n"), [(0, 10), (3, 10), (10, 10), (0, 200), (17, 200)])
def test_the_wilson_interval_is_scipys(k, n):
    expected = scipy_stats.binomtest(k, n).proportion_ci(method="wilson")
    # at 0 and n of n scipy's end is exactly 0 or 1, ours up to rounding
    assert stats.wilson(k / n, n) == pytest.approx(tuple(expected), rel=1e-9, abs=1e-15)


def test_the_wilson_interval_of_nothing_is_unknown():
    assert all(math.isnan(end) for end in stats.wilson(0.0, 0))
