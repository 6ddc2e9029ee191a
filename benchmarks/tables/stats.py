"""Statistics over worlds, how many worlds they need, and when to stop.

One value per world: runs on the same world are averaged before. The intervals of comparisons that
are looked at again and again are confidence sequences (Darling & Robbins 1967), which cover at all
looks together with probability 1 - α. Who stops when a bootstrap interval excludes 0 is wrong far
more often.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics import Floats

ALPHA = 0.05
QUANTILES = (1 - 0.95) / 2, (1 + 0.95) / 2  # ends of an interval; 0.025 would change last digits


class Interval(NamedTuple):
    """A mean over worlds with its 95 % interval; NaN is not available."""

    mean: float = math.nan
    low: float = math.nan
    high: float = math.nan

    @property
    def percent(self) -> "Interval":
        """The same, times 100."""
        return Interval(*(100 * value for value in self))


NOT_KNOWN = Interval()


def estimate(values: Floats) -> Interval:
    """Return the mean of one value per world with its 95 % percentile bootstrap interval.

    10,000 resamples with a fixed seed; no interval of fewer than two values. With ten worlds it is
    somewhat too narrow, as every percentile bootstrap is.
    """
    if not values.size:
        return NOT_KNOWN
    if values.size < 2 or np.isnan(values).any():
        return Interval(float(values.mean()))
    means = [values[worlds].mean(axis=1) for worlds in _resamples(values.size)]
    return Interval(float(values.mean()), *np.quantile(np.concatenate(means), QUANTILES).tolist())


def sample_sd(values: Floats) -> float:
    """Standard deviation with ddof 1; NaN of fewer than two."""
    return float(np.std(values, ddof=1)) if values.size > 1 else float("nan")


def relative_change(differences: Floats, reference: Floats) -> Interval:
    """Mean difference over mean reference, (W,) each; 95 % percentile bootstrap, drawn together."""
    if not differences.size or not reference.mean() > 0:
        return NOT_KNOWN
    share = float(differences.mean() / reference.mean())
    if differences.size < 2 or np.isnan(differences).any():
        return Interval(share)
    drawn = _resamples(differences.size)
    shares = [differences[worlds].sum(axis=1) / reference[worlds].sum(axis=1) for worlds in drawn]
    return Interval(share, *np.quantile(np.concatenate(shares), (0.025, 0.975)).tolist())


def median_estimate(values: Floats) -> Interval:
    """Return the median with its 95 % interval between two of the values; NaN of fewer than six.

    The k-th smallest and k-th largest, k the largest with P(Binomial(n, ½) < k) ≤ 2.5 %: whatever
    the distribution (Conover 1999, section 3.2). It is infinite if half of the values are.
    """
    ordered, n = sorted(values.tolist()), values.size
    middle = float(np.median(ordered))
    below = accumulate(math.comb(n, i) / 2**n for i in range(n))
    k = sum(p <= 0.025 for p in below)
    return Interval(middle, ordered[k - 1], ordered[n - k]) if k else Interval(middle)


def win_rate(differences: Floats) -> float:
    """Share of worlds with a difference below zero, ties counted half; NaN of nothing."""
    return float(np.heaviside(-differences, 0.5).mean()) if differences.size else math.nan


def wilcoxon(differences: Floats) -> float:
    """Two-sided p of the signed-rank test that differences are symmetric about 0 (Wilcoxon 1945).

    Zeros are dropped, ties share their mean rank. Exact for up to 50 differences, with ties too;
    else the normal approximation with the variance corrected for ties and no continuity correction.
    1 if all are zero, NaN of nothing.
    """
    if not differences.size or np.isnan(differences).any():
        return math.nan
    nonzero = differences[differences != 0]
    n = nonzero.size
    if n == 0:
        return 1.0
    _, place, counts = np.unique(np.abs(nonzero), return_inverse=True, return_counts=True)
    doubled = (2 * np.cumsum(counts) - counts + 1)[place]  # ranks times 2: whole with ties too
    positive = int(doubled[nonzero > 0].sum())
    if n <= 50:
        least = min(positive, n * (n + 1) - positive)
        subsets = np.zeros(doubled.sum() + 1, np.int64)  # how many have the sum 0, 1, …
        subsets[0] = 1
        for rank in doubled:
            subsets[rank:] += subsets[:-rank].copy()
        return float(min(1.0, 2 * subsets[: least + 1].sum() / 2**n))
    variance = n * (n + 1) * (2 * n + 1) / 24 - float((counts**3 - counts).sum()) / 48
    z = (positive / 2 - n * (n + 1) / 4) / math.sqrt(variance)
    return float(math.erfc(abs(z) / math.sqrt(2)))


def sign_test(differences: Floats) -> float:
    """Two-sided exact p of the test that a difference is as often above 0 as below.

    Zeros are dropped. Of differences of 0 and 1 it is McNemar's test, exact. 1 if all are zero, NaN
    of nothing.
    """
    if not differences.size or np.isnan(differences).any():
        return math.nan
    above, below = int((differences > 0).sum()), int((differences < 0).sum())
    n = above + below
    tail = sum(math.comb(n, i) for i in range(min(above, below) + 1))
    return float(min(1.0, 2 * tail / 2**n))


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's (1979) adjusted p-values of a family of tests; NaN is no member and stays NaN."""
    adjusted = np.array(p_values, np.float64)
    order = np.argsort(adjusted)[: np.count_nonzero(~np.isnan(adjusted))]  # NaN is last
    steps = np.minimum(adjusted[order] * np.arange(order.size, 0, -1), 1.0)
    adjusted[order] = np.maximum.accumulate(steps)
    return [float(p) for p in adjusted]


def wilson(share: float, n: int) -> tuple[float, float]:
    """Wilson's (1927) 95 % interval of a probability of which ``share`` was seen in n cases."""
    if n == 0 or math.isnan(share):
        return math.nan, math.nan
    z = NormalDist().inv_cdf(QUANTILES[1])
    centre = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    # exact ends at shares of 0 and 1, where the difference leaves round-off
    return min(share, max(0.0, centre - half)), max(share, min(1.0, centre + half))


def multiplicities(n: int) -> Floats:
    """How often each of n worlds is drawn in each of the 10,000 resamples, (10,000, n)."""
    drawn = np.concatenate(_resamples(n))
    of_resample = np.arange(len(drawn))[:, None] * n + drawn
    counts = np.bincount(of_resample.ravel(), minlength=drawn.size)
    return counts.reshape(drawn.shape).astype(np.float64)


@lru_cache(maxsize=1)
def _resamples(n: int) -> list[NDArray[np.int32]]:
    """Worlds drawn with replacement, (block, n) each; kept, as many intervals share their n."""
    rng = np.random.default_rng(0)
    return [rng.integers(n, size=(1_000, n)).astype(np.int32) for _ in range(10)]


def least_p(worlds: int, tests: int = 1) -> float:
    """Smallest p of exact signed-rank tests after Holm: tests · 2^(1 - worlds), at most 1."""
    return min(1.0, tests * 2.0 ** (1 - worlds))


def least_worlds(tests: int = 1) -> int:
    """Fewest worlds on which a difference can have a corrected p below 0.05."""
    return next(n for n in range(1, 64) if least_p(n, tests) < ALPHA)


def worlds_to_see(difference: float, sd: float, tests: int = 1) -> int:
    """Worlds on which a difference δ of SD s, in a family of m tests, is detected with 80 % power.

    N = (π/3) (z[1 - α/2m] + z[0.8])² (s / δ)² + z[1 - α/2m]² / 2, at least ``least_worlds(m)``:
    the number of the paired t-test with Guenther's (1981) correction for an estimated s, over the
    relative efficiency 3/π of the signed-rank test for normal differences (Lehmann 1975). α = 0.05;
    α/m for all m tests of a family bounds Holm's correction from above.
    """
    normal = NormalDist()
    reach = normal.inv_cdf(1 - ALPHA / (2 * tests))
    scaled = (reach + normal.inv_cdf(0.8)) * sd / difference
    return max(math.ceil(math.pi / 3 * scaled**2 + reach**2 / 2), least_worlds(tests))


FIRST, _EVERY = 20, 10  # worlds before the first look at a comparison, and between two looks
TIGHT = 20  # worlds at which the interval of a ratio is as short as it can be
_STEP = 1e-3  # between the means that are tried for an interval of shares
_MOST = 0.75  # of the capital that is bet at once


@dataclass(frozen=True, kw_only=True)
class Rule:
    """When to stop; α = 0.05 is shared equally by all comparisons of a sweep, fixed before it runs.

    All intervals of a sweep (methods, settings, looks) hold together with a probability of 95 %.
    """

    margin: float  # difference that does not matter: as a share of the baseline's error, or of runs
    family: int  # comparisons of the sweep
    worlds: int  # most worlds of a setting

    @property
    def looks(self) -> Iterator[int]:
        """The numbers of worlds after which one looks."""
        yield from range(FIRST, self.worlds, _EVERY)
        yield self.worlds


def ratio(apart: Floats, reference: Floats, alpha: float) -> Interval:
    """Mean difference over mean reference, E[d] / E[b], from paired values of the same worlds.

    The ratios r for which the mixture t-test of E[d - r b] = 0 is below 1 / α, as Fieller (1954)
    inverts a t-test: (d̄ - r b̄)² ≤ K (s_dd - 2 r s_db + r² s_bb) / n, K of ``_reach``. Its coverage
    is exact at all n together where d - r b is normal, and that of large samples elsewhere.

    d and b are (n,), the mean of b above 0. Ends are infinite where no ratio can be excluded;
    ``NOT_KNOWN`` if a value is NaN, or of fewer than two.
    """
    n = apart.size
    if n < 2 or np.isnan(apart).any() or np.isnan(reference).any() or not reference.mean() > 0:
        return NOT_KNOWN
    d, b = float(apart.mean()), float(reference.mean())
    reach, (dd, db, _, bb) = _reach(n, alpha) / n, np.cov(apart, reference).ravel().tolist()
    square, linear, constant = b * b - reach * bb, d * b - reach * db, d * d - reach * dd
    if not square > 0:  # also where the reach is infinite
        return Interval(d / b, -math.inf, math.inf)
    half = math.sqrt(max(0.0, linear * linear - square * constant))  # d / b is one of the ratios
    return Interval(d / b, (linear - half) / square, (linear + half) / square)


def _reach(n: int, alpha: float) -> float:
    """Return K, the t² up to which the mixture t-test of n values stays below 1 / α.

    M_n = √k ((1 + t²/ν) / (1 + k t²/ν))^(n/2), k = c² / (n + c²), ν = n - 1: the likelihood ratio
    with a N(0, 1/c²) mixture over the mean in SDs (Lai 1976; Wang & Ramdas 2024, *Anytime-valid
    t-tests*), a martingale if the mean is 0. Infinite where n is too small for any t.
    """
    reach = -2 * math.log(alpha)
    c2 = TIGHT / (reach + math.log(reach + 1))
    k = c2 / (n + c2)
    bound = (alpha * math.sqrt(k)) ** (-2 / n)
    return (n - 1) * (bound - 1) / (1 - bound * k) if bound * k < 1 else math.inf


def shares(apart: Floats, alpha: float) -> list[Interval]:
    """Mean of differences of shares, from -1 to 1, after each of them: by betting.

    The means m at which nobody who bets against m, with a stake that depends on former values only,
    has ever multiplied his capital by 1 / α: hedged capital with the predictable plug-in
    (Waudby-Smith & Ramdas 2024, *Estimating means of bounded random variables by betting*). Its
    coverage is exact for every distribution.

    No interval is wider than the one before; ends are multiples of 0.001, rounded outwards.
    """
    n = apart.size
    if not n or np.isnan(apart).any():
        return [NOT_KNOWN] * n
    seen = (apart + 1) / 2
    count = np.arange(1, n + 1)
    guess = (0.5 + np.cumsum(seen)) / (count + 1)
    spread = (0.25 + np.cumsum((seen - guess) ** 2)) / (count + 1)
    before = np.concatenate([[0.25], spread[:-1]])
    stake = np.sqrt(2 * math.log(2 / alpha) / (before * count * np.log(count + 1)))[:, None]
    tried = np.arange(_STEP / 2, 1, _STEP / 2)
    gain = seen[:, None] - tried
    up = np.log1p(np.minimum(stake, _MOST / tried) * gain).cumsum(axis=0)
    down = np.log1p(-np.minimum(stake, _MOST / (1 - tried)) * gain).cumsum(axis=0)
    capital = np.maximum.accumulate(np.maximum(up, down), axis=0) - math.log(2)
    means, intervals = np.cumsum(apart) / count, []
    for mean, held in zip(means, capital < -math.log(alpha), strict=True):
        left = np.flatnonzero(held)
        ends = (left[0], left[-1] + 2) if left.size else (0, tried.size + 1)
        low, high = (round(float(end * _STEP - 1), 3) for end in ends)
        intervals.append(Interval(float(mean), low, high))
    return intervals
