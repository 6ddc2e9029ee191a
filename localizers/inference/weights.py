"""Arithmetic of log-weights."""

import numpy as np

from localizers.inference import kernels
from localizers.inference.parts import LogWeights, Weights


def log_sum_exp(log_weights: LogWeights) -> float:
    """Log Σ exp(log w), -inf if all weights are zero."""
    return kernels.normalize(log_weights, np.empty_like(log_weights))


def normalized(log_weights: LogWeights) -> Weights:
    """Weights with sum 1, (n,)."""
    return normalized_with_log_sum(log_weights)[0]


def normalized_with_log_sum(log_weights: LogWeights) -> tuple[Weights, float]:
    """Weights with sum 1, (n,), and log Σ exp(log w), -inf if all weights are zero."""
    weights = np.empty(log_weights.size)
    log_sum = kernels.normalize(log_weights, weights)
    return weights, log_sum


def effective_sample_size(weights: Weights) -> float:
    """1 / Σ w², from 1 to n, for weights with sum 1 (Kong, Liu & Wong 1994)."""
    return 1.0 / kernels.square_sum(weights)
