"""How many particles to draw: KLD-sampling."""

from dataclasses import dataclass

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Floats, Singles
from deqmcl_gym.validation import InputError, integer, number


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
