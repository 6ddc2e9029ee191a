"""Arithmetic of log-weights."""

import numpy as np
from numpy.typing import NDArray

from localizers import kernels
from localizers.inference.parts import LogWeights

Weights = NDArray[np.float64]


def log_sum_exp(log_weights: LogWeights) -> float:
    """Log Σ exp(log w), -inf if all weights are zero."""
    return kernels.normalize(log_weights, np.empty_like(log_weights))


def normalized(log_weights: LogWeights) -> Weights:
    """Weights with sum 1, (n,)."""
    weights = np.empty_like(log_weights)
    kernels.normalize(log_weights, weights)
    return weights


def effective_sample_size(weights: Weights) -> float:
    """1 / Σ w², from 1 to n, for weights with sum 1 (Kong, Liu & Wong 1994)."""
    return 1.0 / kernels.square_sum(weights)
