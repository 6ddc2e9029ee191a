"""Arithmetic of log-weights."""

import math

import numpy as np
from numpy.typing import NDArray

from localizers.inference.parts import LogWeights


def log_sum_exp(log_weights: NDArray[np.float64]) -> float:
    """Log Σ exp(log w), -inf if all weights are zero."""
    top = float(log_weights.max())
    return top + math.log(float(np.exp(log_weights - top).sum())) if math.isfinite(top) else top


def normalized(log_weights: LogWeights) -> NDArray[np.float64]:
    """Weights with sum 1, (n,)."""
    weights = np.exp(log_weights - log_weights.max())
    shares: NDArray[np.float64] = weights / weights.sum()
    return shares


def effective_sample_size(weights: NDArray[np.float64]) -> float:
    """1 / Σ w², from 1 to n, for weights with sum 1 (Kong, Liu & Wong 1994)."""
    return 1.0 / float(np.square(weights).sum())
