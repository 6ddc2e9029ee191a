"""Arithmetic of log-weights."""

import numpy as np
from numpy.typing import NDArray

from localizers import kernels
from localizers.inference.parts import LogWeights

Weights = NDArray[np.float64]


def normalized(log_weights: LogWeights) -> tuple[Weights, float]:
    """Return weights with sum 1, (n,), and log Σ exp(log w)."""
    weights = np.empty_like(log_weights)
    return weights, kernels.normalize(log_weights, weights)


def effective_sample_size(weights: Weights) -> float:
    """1 / Σ w², from 1 to n, for weights with sum 1 (Kong, Liu & Wong 1994)."""
    return 1.0 / kernels.square_sum(weights)
