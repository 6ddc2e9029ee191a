"""How many worlds a comparison needs: for any finding at all, and to see a given difference."""

import math
from statistics import NormalDist

from benchmarks.tables.stats import ALPHA

POWER = 0.8


def least_p(worlds: int, tests: int = 1) -> float:
    """Smallest corrected p that so many worlds can give: tests · 2^(1 - worlds), at most 1.

    The exact signed-rank test has its smallest p, two of the 2^n signs, where all differences lie
    on one side; Holm multiplies the smallest of a family by the number of its tests.
    """
    return min(1.0, tests * 2.0 ** (1 - worlds))


def least_worlds(tests: int = 1) -> int:
    """Fewest worlds on which a difference can have a corrected p below 0.05."""
    return next(n for n in range(1, 64) if least_p(n, tests) < ALPHA)


def worlds_to_see(difference: float, sd: float, tests: int = 1) -> int:
    """Worlds on which a difference is detected with 80 % power.

    N = (π/3) (z[1 - α/2m] + z[0.8])² (s / δ)² + z[1 - α/2m]² / 2, at least ``least_worlds(m)``:
    the number of the paired t-test with Guenther's (1981) correction for an estimated s, over the
    relative efficiency 3/π of the signed-rank test for normal differences (Lehmann 1975). α = 0.05;
    α/m for all m tests of a family bounds Holm's correction from above.

    Args:
        difference: δ, of the errors.
        sd: s, of the paired differences over worlds.
        tests: m, of the family.
    """
    normal = NormalDist()
    reach = normal.inv_cdf(1 - ALPHA / (2 * tests))
    scaled = (reach + normal.inv_cdf(POWER)) * sd / difference
    return max(math.ceil(math.pi / 3 * scaled**2 + reach**2 / 2), least_worlds(tests))


def worth_seeing(error: float) -> float:
    """A round difference, 1, 2 or 5 times a power of ten, near 5 % of an error."""
    wanted = 0.05 * error
    if not wanted > 0:
        return math.nan
    power = 10.0 ** math.floor(math.log10(wanted))
    return power * min((1, 2, 5, 10), key=lambda step: abs(math.log(step * power / wanted)))
