"""Statistics over worlds, against SciPy and their definitions; sweeps that stop when decided."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from report_cases import finished, trial_of, trials, whole
from scipy import stats as scipy_stats

from benchmarks.tables import stats
from benchmarks.tables.comparison import decide
from benchmarks.tables.frames import by_run, trials_frame
from benchmarks.tables.stats import FIRST, TIGHT, Rule, ratio, shares, wilson
from benchmarks.trials.scores import JOURNEY_SCORES

NUMBERS = st.floats(-1e6, 1e6)
TIED = st.integers(-3, 4).map(float)  # zeros among them
P_VALUES = st.lists(st.floats(0, 1) | st.sampled_from([0.01, 0.5, math.nan]), max_size=12)


def worlds(least=0, most=60, of=NUMBERS | TIED):
    return st.lists(of, min_size=least, max_size=most).map(np.array)


@pytest.mark.parametrize("unknown", [[], [1.0, math.nan]])
def test_of_nothing_or_with_an_unknown_difference_every_statistic_is_unknown(unknown):
    differences = np.array(unknown)
    assert all(map(math.isnan, stats.estimate(differences)))
    assert math.isnan(stats.win_rate(differences))
    assert math.isnan(stats.wilcoxon(differences))
    assert all(map(math.isnan, stats.estimate(np.array([1.0]))[1:]))  # one world
    assert all(map(math.isnan, stats.wilson(0.0, 0)))
    assert math.isnan(stats.sign_test(np.empty(0)))


@settings(deadline=None, max_examples=20)
@given(worlds(2, 12))
def test_the_interval_is_that_of_resampling_one_after_the_other(differences):
    n, rng = differences.size, np.random.default_rng(0)
    means = [differences[rng.integers(n, size=n)].mean() for _ in range(10_000)]
    low, high = np.quantile(means, [0.025, 0.975])
    _, *seen = stats.estimate(differences)
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


@pytest.mark.parametrize("n", [20, 57, 400])
def test_a_ratio_is_excluded_exactly_where_the_mixture_t_test_of_its_differences_rejects(n):
    rng = np.random.default_rng(n)
    reference = rng.gamma(4, 5, n)
    apart = -0.4 * reference + rng.normal(0, 6, n)
    found = ratio(apart, reference, 0.01)
    c2 = TIGHT / (-2 * math.log(0.01) + math.log(1 - 2 * math.log(0.01)))
    for end in (found.low, found.high):
        left = apart - end * reference
        t2 = n * left.mean() ** 2 / left.var(ddof=1) / (n - 1)
        k = c2 / (n + c2)
        bayes = math.sqrt(k) * ((1 + t2) / (1 + k * t2)) ** (n / 2)  # Lai 1976, mixed by N(0, 1/c²)
        assert bayes == pytest.approx(1 / 0.01, rel=1e-6)
    assert found.low < found.mean < found.high


def test_bets_exclude_the_true_mean_at_some_look_with_at_most_alpha_enumerated():
    chances = {-1.0: 0.3, 0.0: 0.2, 1.0: 0.5}
    alpha, missed = 0.3, 0.0
    for seen in itertools.product(chances, repeat=6):
        looks = shares(np.array(seen), alpha)
        if any(not look.low <= 0.2 <= look.high for look in looks):
            missed += math.prod(chances[one] for one in seen)
    assert 0.02 < missed <= alpha


def rows_of(records, failed=()):
    """The rows of one method, by run; worlds on which it failed."""
    return by_run(trials_frame(records, [trial_of("mcl", world) for world in failed]))


def relation(*compared):
    return decide(*compared)[0][-1].relation


def outcomes(errors):
    return rows_of(trials("mcl", errors))


def decided(apart, reference, *, margin, family, worlds):
    """Who is better and after how many worlds, of differences as they come; and the interval."""
    for n in Rule(margin=margin, family=family, worlds=worlds).looks:
        found = ratio(apart[:n], reference[:n], 0.05 / family)
        if found.high < -margin or found.low > margin:
            return n, found
        if -margin < found.low and found.high < margin:
            break
    return None, found


def null_sweeps(draw, margin, worlds=200, family=1, sweeps=2000):
    """How many of so many sweeps of methods that do not differ say that one does."""
    rng, wrong = np.random.default_rng(5), 0
    for _ in range(sweeps):
        reference = rng.gamma(16, 1.25, worlds)  # mean 20, SD 5
        how = {"margin": margin, "family": family, "worlds": worlds}
        found = [decided(draw(rng, worlds), reference, **how) for _ in range(family)]
        wrong += any(n is not None for n, _ in found)
    return wrong / sweeps


def test_of_2000_sweeps_of_equal_methods_at_most_5_percent_are_ever_decided():
    share = null_sweeps(lambda rng, n: rng.normal(0, 8, n), margin=0.0)
    low, high = wilson(share, 2000)
    assert 0 < low < high <= 0.05


def skewed(rng, n):
    """Differences as a plan's on scenario guided: skewness -2.5, an SD of half the error."""
    return 10 * (0.8 - rng.gamma(0.64, 1.25, n))


def test_with_a_margin_so_it_is_where_differences_are_as_skewed_as_ours_but_not_without():
    assert null_sweeps(skewed, margin=0.05, sweeps=500) <= 0.05
    assert 0.05 < null_sweeps(skewed, margin=0.0, sweeps=500) < 0.1  # what the decision says


# By gain: the median of the worlds needed, as docs/sweeps.md has it. The SD of differences is 8, so
# that 200 fixed worlds show the first with a t of 2.8, and 80 % power.
@pytest.mark.parametrize(("gain", "needed"), [(1.6, 220), (3.2, 60), (8.0, 20)])
def test_at_the_stop_the_interval_covers_and_what_200_worlds_see_takes_some_more(gain, needed):
    rng, sweeps = np.random.default_rng(6), 400
    stops, covered = [], 0
    for _ in range(sweeps):
        reference = rng.gamma(16, 1.25, 1000)
        n, found = decided(rng.normal(-gain, 8, 1000), reference, margin=0.0, family=1, worlds=1000)
        covered += found.low <= -gain / 20 <= found.high
        stops.append(n or math.inf)
    assert covered / sweeps >= 0.95
    assert np.mean(np.isfinite(stops)) > 0.95
    assert np.median(stops) == pytest.approx(needed, rel=0.1)  # blocks of ten; SE of the first: 9


def test_a_decision_depends_on_nothing_but_the_worlds_up_to_its_look():
    rng = np.random.default_rng(7)
    base = rng.gamma(16, 1.25, 60)
    ours = 0.6 * base + rng.normal(0, 4, 60)
    rule = Rule(margin=0.05, family=3, worlds=60)
    all_of = decide(outcomes(ours), outcomes(base), None, rule)
    n, _, relation = all_of[0][-1]
    assert (relation, n < 60) == ("better", True)
    assert decide(outcomes(ours[:n]), outcomes(base), None, rule) == all_of
    shuffled = trials("mcl", ours)
    rng.shuffle(shuffled)
    assert decide(rows_of(shuffled), outcomes(base), None, rule) == all_of
    looks, wanted = decide(outcomes(ours[: n - 1]), outcomes(base), None, rule)
    assert (looks[-1].relation, wanted) == ("open", n)


def test_a_world_that_failed_is_left_out_and_where_none_can_be_compared_nobody_looks_on():
    base = outcomes([20.0 + i % 3 for i in range(40)])
    rule = Rule(margin=0.05, family=1, worlds=40)
    others = [finished("mcl", i, 10.0 + i % 2) for i in range(40) if i % 4]
    half = rows_of(others, failed=range(0, 40, 4))
    assert relation(half, base, None, rule) == "better"
    looks, wanted = decide(rows_of([], failed=range(FIRST)), base, None, rule)
    assert (looks[-1].relation, looks[-1].worlds, wanted) == ("open", FIRST, FIRST)


def test_shares_of_runs_are_decided_by_points_and_a_larger_one_is_better():
    aim = JOURNEY_SCORES["success_1m"]

    def runs(found):
        plain = zip(trials("mcl", [1.0] * len(found)), found, strict=True)
        records = [whole(run, {aim.name: float(one)}, 5.0) for run, one in plain]
        return rows_of(records)

    rule = Rule(margin=0.05, family=1, worlds=200)
    often, rarely = ([i % 10 < k for i in range(200)] for k in (9, 3))
    assert relation(runs(often), runs(rarely), aim, rule) == "better"
    assert relation(runs(rarely), runs(often), aim, rule) == "worse"
    assert relation(runs(often), runs(often), aim, rule) == "equivalent"
