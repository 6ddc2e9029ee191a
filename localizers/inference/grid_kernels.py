"""The compiled inner loops of Markov localization on a grid of (θ, y, x) cells, (H, Y, X)."""

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.exponential_kernels import exp64, log64
from deqmcl_gym.numerics.types import Floats

NOTHING = 1e-140  # cells of less count as empty: below the normal numbers arithmetic is 100x slower


@compiled
def turn(mass: Floats, shares: Floats, out: Floats) -> None:
    """out[h] = Σ_k shares[k] mass[h - k]: circular convolution over the headings."""
    headings = mass.shape[0]
    for h in range(headings):
        goal = out[h].reshape(-1)
        goal[:] = 0.0
        for k in range(headings):
            share = shares[k]
            if share > 0.0:
                source = mass[(h - k) % headings].reshape(-1)
                for i in range(goal.size):
                    goal[i] += share * source[i]


@compiled
def shift(mass: Floats, stencils: Floats, low_row: int, low_column: int, out: Floats) -> None:
    """out[h, y + j, x + i] = Σ stencils[h, j, i] mass[h, y, x]; what leaves the grid is lost.

    Args:
        mass, out: (H, Y, X).
        stencils: (H, J, I), the first row and column of which move by ``low_row``, ``low_column``.
    """
    headings, rows, columns = mass.shape
    for h in range(headings):
        out[h] = 0.0
        for j in range(stencils.shape[1]):
            down = low_row + j
            for i in range(stencils.shape[2]):
                share = stencils[h, j, i]
                if share > 0.0:
                    right = low_column + i
                    first, last = max(0, -right), min(columns, columns - right)
                    for row in range(max(0, -down), min(rows, rows - down)):
                        goal = out[h, row + down]
                        source = mass[h, row]
                        for column in range(first, last):
                            goal[column + right] += share * source[column]


@compiled
def reweight(mass: Floats, log_likelihoods: Floats, out: Floats) -> float:
    """Out ∝ mass exp(log-likelihood) with sum 1; return log Σ mass p / Σ mass.

    -inf (and nothing filled in) if no mass is left. What is below ``NOTHING`` is dropped.
    """
    top, before = -np.inf, 0.0
    for i in range(mass.size):
        before += mass[i]
        if mass[i] > 0.0:
            top = max(top, log_likelihoods[i])
    if not (before > 0.0 and top > -np.inf):
        return -np.inf
    for i in range(mass.size):
        factor = exp64(min(log_likelihoods[i] - top, 0.0))
        out[i] = mass[i] * factor if factor > NOTHING and mass[i] > NOTHING else 0.0
    after = 0.0
    for i in range(mass.size):
        after += out[i]
    if not after > 0.0:
        return -np.inf
    for i in range(mass.size):
        share = out[i] / after
        out[i] = share if share > NOTHING else 0.0
    return float(top + log64(after / before))
