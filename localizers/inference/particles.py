"""States and log-weights of particles over any state space, resampling; a filter's parts.

States are columns, (d, n): row i holds component i of all n particles. On a map they are poses,
d = 3 (x, y, heading); the tests of exactness use a ring of five states. Particles are resampled
always or by effective sample size, systematically or otherwise; how many may depend on how far
they spread: KLD-sampling. A scan's likelihood may be tempered, for coarse clouds to survive it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics import Floats, Indices, Singles
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import exp64, log64
from deqmcl_gym.validation import integer, number
from localizers.models.scan import Scan

States = NDArray[Any]  # (d, n)
LogWeights = Floats  # (n,)
Weights = Floats  # (n,), with sum 1
Action = Floats  # (k,)
Actions = Floats  # (steps, k)


class BeamFilter(Protocol):
    """Which beams of a scan a belief uses."""

    def kept(self, states: States, log_weights: LogWeights, scan: Scan) -> Scan:
        """Return a scan without the beams that the belief before it leaves out.

        The belief is the particles' states, moved, (d, n), and their log-weights, (n,).
        """


@compiled
def maximum(values: Floats) -> float:
    """Return the maximum, -inf of none."""
    top = -np.inf
    for i in range(values.size):
        top = max(top, values[i])
    return top


@compiled
def normalize(log_weights: Floats, out: Floats) -> float:
    """Fill in weights with sum 1; return log Σ exp(log w), -inf (and fill in none) if all are 0."""
    top = maximum(log_weights)
    if not top > -np.inf:
        return top
    total = 0.0
    for i in range(log_weights.size):
        out[i] = exp64(log_weights[i] - top)
    for i in range(out.size):
        total += out[i]
    for i in range(out.size):
        out[i] /= total
    return float(top + log64(total))


@compiled
def log_evidence(log_weights: Floats, log_likelihoods: Floats, most: int) -> float:
    """Log (Σ w p / Σ w) over at most ``most`` evenly spaced particles; NaN if they weigh 0."""
    stride = (log_weights.size - 1) // most + 1
    before = log_weights[::stride].copy()
    after = before + log_likelihoods[::stride]
    top, top_both = maximum(before), maximum(after)
    if not (top > -np.inf and top_both > -np.inf):
        return top_both - top  # -inf, or NaN
    weights, both = 0.0, 0.0
    for i in range(before.size):
        before[i], after[i] = exp64(before[i] - top), exp64(after[i] - top_both)
    for i in range(before.size):
        weights, both = weights + before[i], both + after[i]
    return float(top_both - top + log64(both / weights))


@compiled
def effective_sample_size(weights: Weights) -> float:
    """1 / Σ w², from 1 to n, for weights with sum 1 (Kong, Liu & Wong 1994)."""
    square = 0.0
    for i in range(weights.size):
        square += weights[i] * weights[i]
    return 1.0 / square


@compiled
def shifted(log_weights: Floats, log_factor: Floats, out: Floats) -> float:
    """Fill in log w + log factor; return its maximum, -inf if no weight is left."""
    for i in range(out.size):
        out[i] = log_weights[i] + log_factor[i]
    return maximum(out)


def log_sum_exp(log_weights: LogWeights) -> float:
    """Log Σ exp(log w), -inf if all weights are zero."""
    return normalize(log_weights, np.empty_like(log_weights))


def normalized_with_log_sum(log_weights: LogWeights) -> tuple[Weights, float]:
    """Weights with sum 1, (n,), and log Σ exp(log w), -inf if all weights are zero."""
    weights = np.empty(log_weights.size)
    log_sum = normalize(log_weights, weights)
    return weights, log_sum


@compiled
def fill_systematic(weights: Floats, offset: float, out: Indices) -> None:
    """Do as ``pointed_at`` for (k + offset) / n, without a branch to mispredict at each pointer."""
    n = weights.size
    before = np.empty(n)  # the weight of the particles before each
    total = 0.0
    for i in range(n):
        before[i] = total
        total += weights[i]
    last = n - 1  # of weight above zero
    while last > 0 and not weights[last] > 0.0:
        last -= 1
    per_weight = n / total
    for i in range(n):
        before[i] = np.ceil(before[i] * per_weight - offset)
    written = np.zeros(n)
    for i in range(last + 1):
        first = int(before[i])
        if 0 <= first < n:
            written[first] = i
    furthest = 0.0  # not an int: of its maximum the compiler would make a branch
    for k in range(n):
        furthest = max(furthest, written[k])
        out[k] = int(furthest)


@compiled
def pointed_at(weights: Floats, pointers: Floats) -> Indices:
    """Return which particle each ascending pointer in [0, 1) falls on, by cumulative weight."""
    out = np.empty(pointers.size, np.intp)
    total = 0.0
    last = 0  # of weight above zero
    for i in range(weights.size):
        total += weights[i]
        last = i if weights[i] > 0.0 else last
    reached = weights[0]
    particle = 0
    for k in range(pointers.size):
        goal = pointers[k] * total
        while reached <= goal and particle < last:
            particle += 1
            reached += weights[particle]
        out[k] = particle
    return out


Scheme = Callable[[Weights, np.random.Generator], Indices]


def systematic(weights: Weights, rng: np.random.Generator) -> Indices:
    """One uniform offset for n equidistant pointers: each particle ⌊n w⌋ or ⌈n w⌉ times.

    Thrun et al. 2005, table 4.4 ("low variance sampler"); Kitagawa 1996.
    """
    chosen = np.empty(weights.size, np.intp)
    fill_systematic(weights, rng.random(), chosen)
    return chosen


def stratified(weights: Weights, rng: np.random.Generator) -> Indices:
    """One uniform pointer in each of n equal strata (Kitagawa 1996)."""
    n = weights.size
    return pointed_at(weights, (np.arange(n) + rng.random(n)) / n)


def multinomial(weights: Weights, rng: np.random.Generator) -> Indices:
    """N independent draws by weight (Gordon, Salmond & Smith 1993)."""
    return pointed_at(weights, np.sort(rng.random(weights.size)))


SCHEMES: dict[str, Scheme] = {one.__name__: one for one in (systematic, stratified, multinomial)}


@dataclass(frozen=True)
class Resampling:
    """When to resample, and how; random numbers are drawn in any case: runs stay comparable."""

    scheme: Scheme = systematic  # how; one of ``SCHEMES``
    # when the effective sample size is below this share of n; None: at every step, as in the paper
    ess_threshold: float | None = None

    def __post_init__(self) -> None:
        if self.ess_threshold is not None:
            number("ess_threshold", self.ess_threshold, low=0, high=1)

    def ancestors(self, weights: Weights, rng: np.random.Generator) -> Indices | None:
        """Return the particles to keep by weights of sum 1, (n,); None: all, with their weights."""
        chosen, threshold = self.scheme(weights, rng), self.ess_threshold
        if threshold is None or effective_sample_size(weights) < threshold * weights.size:
            return chosen
        return None


@compiled
def power_that_keeps(log_weights: Floats, log_factor: Floats, keep: float) -> float:
    """Return the largest λ in [0, 1] at which w f^λ has ``keep`` of the sample size of w.

    In a cloud spread over a building the least wrong particle would take all the weight; λ grows as
    the cloud contracts. A filter is exact only at ``keep`` = 0. By bisection, to 2⁻²⁰, never less;
    1 if no weight is left by f, or one is infinite.
    """
    scaled = log_weights + log_factor
    if not abs(maximum(scaled)) < np.inf:
        return 1.0
    wanted = keep * _sample_size(log_weights)
    low, high, power = 0.0, 1.0, 1.0
    for _ in range(20):
        for i in range(scaled.size):
            scaled[i] = log_weights[i] + power * log_factor[i]
        if _sample_size(scaled) >= wanted:
            low = power
        else:
            high = power
        if low == 1.0:
            break
        power = 0.5 * (low + high)
    return low


@compiled
def _sample_size(log_weights: Floats) -> float:
    """(Σ w)² / Σ w²."""
    top, total, square = maximum(log_weights), 0.0, 0.0
    for i in range(log_weights.size):
        weight = exp64(log_weights[i] - top)
        total += weight
        square += weight * weight
    return total * total / square


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
    """Return the first number of these draws (3, n), in order, above their limit; n if none."""
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
    """

    least: int  # lower bound of n
    most: int  # upper bound
    error: float  # ε > 0
    quantile: float  # z
    bin_size: tuple[float, float, float]  # of x and y, in the map's unit, and of θ, rad

    def __post_init__(self) -> None:
        integer("max_particles", self.most, low=1)
        integer("min_particles (at most max_particles)", self.least, low=1, high=self.most)
        number("pf_err", self.error, low=0, above=True)
        number("pf_z", self.quantile)

    def enough(self, states: Singles) -> int:
        """Return how many of these draws (3, ``most``), taken in order, are enough."""
        sizes = np.array(self.bin_size)
        return enough(states, sizes, self.least, self.error, self.quantile)
