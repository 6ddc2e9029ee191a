"""The compiled loops of KLD-sampling: draws by weight in their own order, and when to stop."""

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Floats, Indices, Singles


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
