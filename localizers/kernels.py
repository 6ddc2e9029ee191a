"""The compiled inner loops of the estimators: weights, resampling, likelihoods of beams."""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import exp32, exp64, log64

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
LANES = 64
_FOLD = 32  # beams multiplied before a logarithm is taken: 32 densities of 1e-9 fit into float64
_HALF = np.float32(0.5)


@compiled
def normalize(log_weights: Floats, out: Floats) -> float:
    """Fill in weights with sum 1; return log Σ exp(log w), -inf (and no weights) if all are zero."""
    top = -np.inf
    for i in range(log_weights.size):
        top = max(top, log_weights[i])
    if not top > -np.inf:
        return top
    total = 0.0
    for i in range(log_weights.size):
        out[i] = exp64(log_weights[i] - top)
    for i in range(out.size):
        total += out[i]
    for i in range(out.size):
        out[i] /= total
    return top + log64(total)


@compiled
def square_sum(weights: Floats) -> float:
    """Σ w²."""
    total = 0.0
    for i in range(weights.size):
        total += weights[i] * weights[i]
    return total


@compiled
def pointed_at(weights: Floats, pointers: Floats, out: NDArray[np.intp]) -> None:
    """Fill in which particle each ascending pointer in [0, 1) falls on, by cumulative weight."""
    total = 0.0
    for i in range(weights.size):
        total += weights[i]
    reached = weights[0]
    particle = 0
    last = weights.size - 1
    for k in range(pointers.size):
        goal = pointers[k] * total
        while reached <= goal and particle < last:
            particle += 1
            reached += weights[particle]
        out[k] = particle


@compiled
def mixture(
    ranges: Singles,
    expected: Singles,
    sigma: np.float32,
    peak: np.float32,
    floor: np.float32,
    out: Floats,
) -> None:
    """Fill in Σ_b log(peak exp(-½ ((o_b - ô_b) / σ)²) + floor) for each pose.

    Args:
        ranges: o, (B,) px.
        expected: ô, (B, n) px.
        sigma: px.
        peak, floor: floor > 0.
        out: (n,).
    """
    inverse = np.float32(1.0) / sigma
    density = np.ones(LANES, np.float32)
    product = np.ones(LANES, np.float64)
    n = expected.shape[1]
    for start in range(0, n, LANES):
        count = min(LANES, n - start)
        total = out[start : start + count]
        for i in range(count):
            total[i] = 0.0
        for first in range(0, ranges.size, _FOLD):
            for i in range(LANES):
                product[i] = 1.0
            for beam in range(first, min(first + _FOLD, ranges.size)):
                measured = ranges[beam]
                row = expected[beam, start : start + count]
                for i in range(count):
                    z = (measured - row[i]) * inverse
                    density[i] = peak * exp32(-_HALF * z * z) + floor
                for i in range(LANES):
                    product[i] *= np.float64(density[i])
            for i in range(count):
                total[i] += log64(product[i])


@compiled
def parabola(ranges: Singles, expected: Singles, sigma: float, peak: float, out: Floats) -> None:
    """Fill in Σ_b log(peak) - ½ ((o_b - ô_b) / σ)² for each pose: the mixture without a floor."""
    for i in range(out.size):
        out[i] = ranges.size * log64(peak)
    for beam in range(ranges.size):
        for i in range(out.size):
            z = (np.float64(ranges[beam]) - np.float64(expected[beam, i])) / sigma
            out[i] -= 0.5 * z * z
