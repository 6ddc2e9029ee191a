"""The compiled inner loops of particle filters: log-weights and resampling."""

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.exponential_kernels import exp64, log64
from deqmcl_gym.numerics.types import Floats, Indices, Ints
from localizers.inference.parts import LogWeights, Weights


@compiled
def largest(values: Floats) -> float:
    """Return the maximum, -inf of none, in four strands: one alone would wait at every step."""
    first, second, third, fourth = -np.inf, -np.inf, -np.inf, -np.inf
    whole = values.size - values.size % 4
    for i in range(0, whole, 4):
        first = max(first, values[i])
        second = max(second, values[i + 1])
        third = max(third, values[i + 2])
        fourth = max(fourth, values[i + 3])
    for i in range(whole, values.size):
        first = max(first, values[i])
    return max(first, second, third, fourth)


@compiled
def normalize(log_weights: Floats, out: Floats) -> float:
    """Fill in weights with sum 1; return log Σ exp(log w), -inf (and fill in none) if all are 0."""
    top = largest(log_weights)
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
    top, top_both = largest(before), largest(after)
    if not (top > -np.inf and top_both > -np.inf):
        return top_both - top  # -inf, or NaN
    alike = True  # as after resampling: then each exponential is 1
    for i in range(before.size):
        alike &= before[i] == top
    weights, both = float(before.size), 0.0
    if not alike:
        for i in range(before.size):
            before[i] = exp64(before[i] - top)
        weights = 0.0
        for i in range(before.size):
            weights += before[i]
    for i in range(after.size):
        after[i] = exp64(after[i] - top_both)
    for i in range(after.size):
        both += after[i]
    return float(top_both - top + log64(both / weights))


@compiled
def two_states(start: float, stay: float, enter: float, log_ratios: Floats) -> float:
    """Probability of the first of two states after observations, by the forward recursion.

    Args:
        start: its probability before them.
        stay, enter: probabilities of staying in it and of entering it, before each observation.
        log_ratios: log p(o | second) - log p(o | first); NaN is no information.
    """
    first = start
    for i in range(log_ratios.size):
        first = first * stay + (1.0 - first) * enter
        ratio = log_ratios[i]
        if ratio > 0.0:
            likely = first * exp64(-ratio)
            first = likely / (likely + (1.0 - first))
        elif ratio <= 0.0:
            first = first / (first + (1.0 - first) * exp64(ratio))
    return first


@compiled
def square_sum(weights: Floats) -> float:
    """Σ w²."""
    total = 0.0
    for i in range(weights.size):
        total += weights[i] * weights[i]
    return total


@compiled
def tempering(
    weights: Floats, collisions: Ints, beta: float, keep: float
) -> tuple[float, float, float]:
    """Return λ, the largest of 0 … 1 at which exp(-λ β C) leaves ``keep`` of the sample size.

    By bisection, to 2⁻⁴⁰; the effective sample size is never less. It is one of weight and squared
    weight at each value of C.

    Args:
        weights: with sum 1, (n,).
        collisions: C, (n,).
        beta: β ≥ 0, may be infinite: then λ is 1, or 0 as a limit.
        keep: share of the effective sample size.

    Returns:
        λ, the weight where C is 0, and log Σ w exp(-λ β C).
    """
    sums, squares = np.zeros((2, collisions.max() + 1))
    for i in range(weights.size):
        sums[collisions[i]] += weights[i]
        squares[collisions[i]] += weights[i] * weights[i]
    least = 0
    while not sums[least] > 0.0:
        least += 1
    wanted = keep / np.sum(squares)
    factor = np.ones(sums.size)
    low, high, power = 0.0, 1.0, 1.0
    for _ in range(40):
        total, square = sums[least], squares[least]
        for c in range(least + 1, sums.size):
            factor[c] = exp64(-power * (beta * (c - least)))
            total += factor[c] * sums[c]
            square += factor[c] * factor[c] * squares[c]
        if total * total >= wanted * square:
            low = power
        else:
            high = power
        if low == 1.0:
            break
        power = 0.5 * (low + high)
    total = sums[least]
    for c in range(least + 1, sums.size):
        total += sums[c] * (exp64(-low * (beta * (c - least))) if low > 0.0 else 1.0)
    shift = low * (beta * least) if least > 0 and low > 0.0 else 0.0
    return low, sums[0], log64(total) - shift


@compiled
def power_that_keeps(log_weights: Floats, log_factor: Floats, keep: float) -> float:
    """Return the largest λ in [0, 1] at which w f^λ has ``keep`` of the sample size of w.

    By bisection, to 2⁻²⁰; the effective sample size is never less. 1 if no weight is left by f, or
    one is infinite.
    """
    scaled = log_weights + log_factor
    if not abs(largest(scaled)) < np.inf:
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
    top, total, square = largest(log_weights), 0.0, 0.0
    for i in range(log_weights.size):
        weight = exp64(log_weights[i] - top)
        total += weight
        square += weight * weight
    return total * total / square


@compiled
def shifted(log_weights: Floats, log_factor: Floats, out: Floats) -> float:
    """Fill in log w + log factor; return its maximum, -inf if no weight is left."""
    for i in range(out.size):
        out[i] = log_weights[i] + log_factor[i]
    return largest(out)


@compiled
def absorbed(
    log_weights: Floats, log_likelihoods: Floats, most: int, power: float, out: Floats
) -> tuple[float, float]:
    """Do ``shifted``, by f^power, and ``log_evidence``, by f; return what both return."""
    evidence = log_evidence(log_weights, log_likelihoods, most)
    if power < 1.0:
        factor = np.zeros(log_likelihoods.size)
        if power > 0.0:
            factor[:] = power * log_likelihoods
        return shifted(log_weights, factor, out), evidence
    return shifted(log_weights, log_likelihoods, out), evidence


@compiled
def systematic(weights: Floats, offset: float, out: Indices) -> None:
    """Do the same as ``pointed_at`` for the pointers (k + offset) / n, k = 0 … n - 1.

    Each particle is written at its first pointer, over those before it that get none; the other
    pointers repeat the last one written. A search would mispredict a branch at every pointer.
    """
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
def strata(offsets: Floats, out: Floats) -> None:
    """Fill in (k + u) / n for k = 0 … n - 1, u from ``offsets``."""
    n = out.size
    for k in range(n):
        out[k] = (k + offsets[k]) / n


@compiled
def pointed_at(weights: Floats, pointers: Floats, out: Indices) -> None:
    """Fill in which particle each ascending pointer in [0, 1) falls on, by cumulative weight."""
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


@compiled
def agreeing(first: Floats, second: Floats) -> int:
    """How many leading rows of two tables (·, k) are the same, by exact comparison."""
    for row in range(min(len(first), len(second))):
        for column in range(first.shape[1]):
            if first[row, column] != second[row, column]:
                return row
    return min(len(first), len(second))


def log_sum_exp(log_weights: LogWeights) -> float:
    """Log Σ exp(log w), -inf if all weights are zero."""
    return normalize(log_weights, np.empty_like(log_weights))


def normalized(log_weights: LogWeights) -> Weights:
    """Weights with sum 1, (n,)."""
    return normalized_with_log_sum(log_weights)[0]


def normalized_with_log_sum(log_weights: LogWeights) -> tuple[Weights, float]:
    """Weights with sum 1, (n,), and log Σ exp(log w), -inf if all weights are zero."""
    weights = np.empty(log_weights.size)
    log_sum = normalize(log_weights, weights)
    return weights, log_sum


def effective_sample_size(weights: Weights) -> float:
    """1 / Σ w², from 1 to n, for weights with sum 1 (Kong, Liu & Wong 1994)."""
    return 1.0 / square_sum(weights)
