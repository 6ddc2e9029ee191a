"""States and log-weights of particles over any state space; the parts of a filter, as protocols.

States are columns, (d, n): row i holds component i of all n particles. On a map they are poses,
d = 3 (x, y, heading); the tests of exactness use a ring of five states.
"""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics import Floats, Indices
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import exp64, log64
from localizers.models.scan import Scan

States = NDArray[Any]  # (d, n)
LogWeights = Floats  # (n,)
Weights = Floats  # (n,), with sum 1
Action = Floats  # (k,)
Actions = Floats  # (steps, k)


class Initial(Protocol):
    """p(x_0)."""

    def sample(self, n: int, rng: np.random.Generator) -> NDArray[Any]:
        """Draw n states, (n, d)."""


class BeamFilter(Protocol):
    """Which beams of a scan a belief uses."""

    def kept(self, states: States, log_weights: LogWeights, scan: Scan) -> Scan:
        """Return a scan without the beams that the belief before it leaves out.

        The belief is the particles' states, moved, (d, n), and their log-weights, (n,).
        """


class Feasibility(Protocol):
    """g(x', x), how feasible the step x' → x is on the map."""

    def log_g(self, before: States, after: States) -> LogWeights:
        """Log g of each step, (n,)."""


Paths = Callable[[Indices], list[States]]


class Walk(Protocol):
    """Several steps of p(x_s | x_{s-1}, u_s), each charged by g."""

    def __call__(
        self, states: States, actions: Actions, rng: np.random.Generator, *, keep: bool
    ) -> tuple[Paths, LogWeights]:
        """Draw one path from each state, (d, n), by the same draws, and bits, as ``StepByStep``.

        Return the states after each step, (d, k) each, of the k paths that are asked for by number
        (none unless ``keep``), and log Π g of each path, (n,).
        """


@compiled
def maximum(values: Floats) -> float:
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


def log_sum_exp(log_weights: LogWeights) -> float:
    """Log Σ exp(log w), -inf if all weights are zero."""
    return normalize(log_weights, np.empty_like(log_weights))


def normalized_with_log_sum(log_weights: LogWeights) -> tuple[Weights, float]:
    """Weights with sum 1, (n,), and log Σ exp(log w), -inf if all weights are zero."""
    weights = np.empty(log_weights.size)
    log_sum = normalize(log_weights, weights)
    return weights, log_sum
