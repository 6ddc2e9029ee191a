"""Statistics over worlds, and how many worlds they need.

One value per world: runs on the same world are averaged before.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import accumulate
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics import Floats

ALPHA = 0.05
QUANTILES = (1 - 0.95) / 2, (1 + 0.95) / 2  # ends of an interval; 0.025 would change last digits
_RESAMPLES = 10_000
_BLOCK = 1_000  # resamples held at once
_EXACT = 50  # signed ranks whose distribution is counted rather than approximated


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
    """Return the mean of one value per world with its bootstrap interval."""
    return Interval(float(values.mean()), *paired_bootstrap(values)) if values.size else NOT_KNOWN


def sample_sd(values: Floats) -> float:
    """Standard deviation with ddof 1; NaN of fewer than two."""
    return float(np.std(values, ddof=1)) if values.size > 1 else float("nan")


def paired_bootstrap(differences: Floats) -> tuple[float, float]:
    """95 % percentile bootstrap interval of the mean of paired differences, over worlds.

    10,000 resamples with a fixed seed; NaN of fewer than two. With ten worlds it is somewhat too
    narrow, as every percentile bootstrap is.
    """
    if differences.size < 2 or np.isnan(differences).any():
        return math.nan, math.nan
    drawn = _resamples(differences.size, _RESAMPLES)
    return _middle([differences[worlds].mean(axis=1) for worlds in drawn], QUANTILES)


def relative_change(differences: Floats, reference: Floats) -> Interval:
    """Mean difference over mean reference, (W,) each; 95 % percentile bootstrap, drawn together."""
    if not differences.size or not reference.mean() > 0:
        return NOT_KNOWN
    share = float(differences.mean() / reference.mean())
    if differences.size < 2 or np.isnan(differences).any():
        return Interval(share)
    drawn = _resamples(differences.size, _RESAMPLES)
    shares = [differences[one].sum(axis=1) / reference[one].sum(axis=1) for one in drawn]
    return Interval(share, *_middle(shares, (0.025, 0.975)))


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
    if not differences.size or np.isnan(differences).any():
        return math.nan
    return float(((differences < 0).sum() + 0.5 * (differences == 0).sum()) / differences.size)


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
    if n <= _EXACT:
        least = min(positive, n * (n + 1) - positive)
        return float(min(1.0, 2 * _subsets_by_sum(doubled)[: least + 1].sum() / 2**n))
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
    adjusted = list(p_values)
    family = sorted((p, i) for i, p in enumerate(p_values) if not math.isnan(p))
    largest = 0.0
    for rank, (p, i) in enumerate(family):
        largest = max(largest, min(1.0, (len(family) - rank) * p))
        adjusted[i] = largest
    return adjusted


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
    blocks = []
    for drawn in _resamples(n, _RESAMPLES):
        of_resample = np.arange(len(drawn))[:, None] * n + drawn
        counts = np.bincount(of_resample.ravel(), minlength=drawn.size)
        blocks.append(counts.reshape(drawn.shape))
    return np.concatenate(blocks).astype(np.float64)


def _middle(blocks: Sequence[Floats], ends: tuple[float, float]) -> tuple[float, float]:
    low, high = np.quantile(np.concatenate(blocks), ends)
    return float(low), float(high)


@lru_cache(maxsize=1)
def _resamples(n: int, count: int) -> list[NDArray[np.int32]]:
    """Worlds drawn with replacement, (block, n) each; kept, as many intervals share their n."""
    rng = np.random.default_rng(0)
    blocks = [min(_BLOCK, count - start) for start in range(0, count, _BLOCK)]
    return [rng.integers(n, size=(block, n)).astype(np.int32) for block in blocks]


def _subsets_by_sum(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many subsets of at most 62 numbers have the sums 0, 1, … their total."""
    ways = np.zeros(numbers.sum() + 1, np.int64)
    ways[0] = 1
    for number in numbers:
        ways[number:] += ways[:-number].copy()
    return ways


POWER = 0.8


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
    scaled = (reach + normal.inv_cdf(POWER)) * sd / difference
    return max(math.ceil(math.pi / 3 * scaled**2 + reach**2 / 2), least_worlds(tests))
