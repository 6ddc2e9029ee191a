"""How many particles to draw, and how many at random poses: KLD-sampling and augmented MCL."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Floats, Indices, Singles
from deqmcl_gym.validation import InputError, digits, integer, number
from localizers.inference.parts import Actions


@compiled
def drawn(cumulative: Floats, pointers: Floats, out: Indices) -> None:
    """Fill in the first particle whose cumulative weight is above each pointer, in any order.

    By an index table (Chen & Asau 1974): each search starts at the first possible particle.

    Args:
        cumulative: ascending, (n,).
        pointers: in [0, cumulative[-1]], (k,).
        out: (k,).
    """
    n = cumulative.size
    per_weight = n / cumulative[-1]
    table = np.full(n + 2, n - 1)
    filled = 0
    for i in range(n):
        slot = int(cumulative[i] * per_weight)  # computed as for pointers: monotone
        while filled <= slot:
            table[filled] = i
            filled += 1
    for k in range(pointers.size):
        i = table[int(pointers[k] * per_weight)]
        while i < n - 1 and cumulative[i] <= pointers[k]:
            i += 1
        out[k] = i


@compiled
def limit(bins: int, least: int, most: int, error: float, quantile: float) -> int:
    """Return how many particles draws in so many bins need; see ``KldSampling``."""
    if bins <= 1:
        return most
    k = bins - 1.0
    b = 2 / (9 * k)
    root = 1 - b + quantile * np.sqrt(b)
    return int(min(max(np.ceil(k / (2 * error) * root * root * root), least), most))


@compiled
def enough(states: Singles, bin_size: Floats, least: int, error: float, quantile: float) -> int:
    """Return the first number of these draws (3, n), in their order, above their limit; n if none.

    Bins in use are kept in a hash table, as the number of the first draw that fell into each.
    """
    n = states.shape[1]
    slots = 64
    while slots < 2 * n:
        slots *= 2
    first = np.full(slots, -1)
    column, row, heading = np.empty((3, n), np.int64)
    for i in range(n):
        column[i] = int(np.floor(states[0, i] / bin_size[0]))
        row[i] = int(np.floor(states[1, i] / bin_size[1]))
        heading[i] = int(np.floor(states[2, i] / bin_size[2]))
    bins, bound = 0, n
    for i in range(n):
        mixed = (column[i] * 73856093) ^ (row[i] * 19349663) ^ (heading[i] * 83492791)
        slot = mixed & (slots - 1)
        j = first[slot]
        while j >= 0 and (column[j] != column[i] or row[j] != row[i] or heading[j] != heading[i]):
            slot = (slot + 1) & (slots - 1)
            j = first[slot]
        if j < 0:
            first[slot] = i
            bins += 1
            bound = limit(bins, least, n, error, quantile)
        if i + 1 > bound:
            return int(i + 1)
    return int(n)


@dataclass(frozen=True, kw_only=True)
class KldSampling:
    """Draw until n > (k - 1) / (2 ε) · (1 - 2 / (9 (k - 1)) + z √(2 / (9 (k - 1))))³ (Fox 2003).

    k is the number of bins that the draws have fallen into; the bound is rounded up and kept
    between ``least`` and ``most``. For k = 1 it is ``most``, as in Nav2 (pf.c): a cloud in one bin
    is not a small one. The Kullback-Leibler divergence between the draws and what they are drawn
    from, over the bins, is then below ε with probability Φ(z).

    Attributes:
        least, most: bounds of n.
        error: ε > 0.
        quantile: z.
        bin_size: of x and y, in the map's unit, and of θ, rad.
    """

    least: int
    most: int
    error: float
    quantile: float
    bin_size: tuple[float, float, float]

    def __post_init__(self) -> None:
        integer("min_particles", self.least, low=1)
        integer("max_particles", self.most, low=1)
        if self.least > self.most:
            raise InputError(
                f"min_particles is {self.least}, but must be at most max_particles, {self.most}."
            )
        number("pf_err", self.error, low=0, above=True)
        number("pf_z", self.quantile)

    def enough(self, states: Singles) -> int:
        """Return how many of these draws (3, ``most``), taken in order, are enough."""
        sizes = np.array(self.bin_size)
        return enough(states, sizes, self.least, self.error, self.quantile)


@dataclass(frozen=True, kw_only=True)
class Recovery:
    """max(0, 1 - w_fast / w_slow) of the draws are random poses (Thrun et al. 2005, table 8.3).

    w_slow and w_fast are exponential averages of how likely the scans were; over the first
    1 / α scans they are plain means, so that the first scan, which the particles of a lost robot
    hardly explain, is soon outweighed. With both rates 0 there are no random poses.

    Attributes:
        alpha_slow, alpha_fast: rates in [0, 1], per scan; alpha_fast ≥ alpha_slow.
        slow, fast: w_slow and w_fast; 0 before the first scan.
        scans: how many were averaged.
    """

    alpha_slow: float = 0.0
    alpha_fast: float = 0.0
    slow: float = 0.0
    fast: float = 0.0
    scans: int = 0

    def __post_init__(self) -> None:
        number("recovery_alpha_slow", self.alpha_slow, low=0, high=1)
        number("recovery_alpha_fast", self.alpha_fast, low=0, high=1)
        if self.alpha_fast < self.alpha_slow:
            raise InputError(
                f"recovery_alpha_fast is {digits(self.alpha_fast)}, but must be at least "
                f"recovery_alpha_slow, {digits(self.alpha_slow)}."
            )

    @property
    def share(self) -> float:
        """Probability that a draw is a random pose."""
        return max(0.0, 1.0 - self.fast / self.slow) if self.slow > 0 else 0.0

    def after(self, log_evidence: float, beams: int) -> "Recovery":
        """Return the averages after a scan.

        The likelihood averaged is that of one beam, the geometric mean over the scan, so that scans
        with lost beams are comparable.

        Args:
            log_evidence: log p(o | belief); NaN changes nothing.
            beams: how many beams it is made of; 0 changes nothing.
        """
        if beams == 0 or math.isnan(log_evidence) or self.alpha_fast == 0:
            return self
        # exp of x ≤ 0 only: 1 / exp(-x) where a beam's density is above 1
        log_beam = log_evidence / beams
        size = float(arrays.exp(-abs(log_beam)))
        likelihood = size if log_beam <= 0 else 1.0 / size
        scans = self.scans + 1
        slow, fast = max(self.alpha_slow, 1 / scans), max(self.alpha_fast, 1 / scans)
        return replace(
            self,
            slow=self.slow + slow * (likelihood - self.slow),
            fast=self.fast + fast * (likelihood - self.fast),
            scans=scans,
        )


class Watch(NamedTuple):
    """What a belief remembers of scans and plans.

    Attributes:
        recovery: averages of how likely the scans were.
        plan: the latest, (h, k).
        news: steps for which the route counts as new; see ``injection.Anywhere``.
    """

    recovery: Recovery
    plan: Actions
    news: int = 0
