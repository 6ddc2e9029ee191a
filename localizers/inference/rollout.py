"""Futures drawn from given states by planned actions, and how feasible they are."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics import arrays
from localizers.inference.belief import ParticleBelief
from localizers.inference.parts import Actions, Feasibility, LogWeights, Motion, States


@dataclass(frozen=True)
class Rollout:
    """x'_s ~ p(· | x'_{s-1}, u_s) step by step, with Σ log g(x'_{s-1}, x'_s)."""

    motion: Motion
    feasibility: Feasibility

    def futures(
        self, anchor: States, actions: Actions, copies: int, rng: np.random.Generator
    ) -> tuple[list[States], NDArray[np.float64]]:
        """Draw ``copies`` = K futures from each state of ``anchor``, (d, n).

        Returns:
            The states of each step, (d, K, n), and log Π g of each future, (K, n).
        """
        d, n = anchor.shape
        states = np.tile(anchor, (1, copies))
        log_g = np.zeros(copies * n)
        paths = []
        for action in actions:
            before, states = states, self.motion.sample(states, action, rng)
            log_g += self.feasibility.log_g(before, states)
            paths.append(states.reshape(d, copies, n))
        return paths, log_g.reshape(copies, n)

    def queued_log_g(self, belief: ParticleBelief, shared: int = 0) -> LogWeights:
        """Log Π g of each particle's own future from ``shared`` steps ahead on, (n,)."""
        total = np.zeros(belief.log_weights.size)
        after = belief.queue.at(shared)
        for offset in range(shared, belief.queue.ahead):
            before, after = after, belief.queue.at(offset + 1)
            assert before is not None, "the future is held"
            assert after is not None, "the future is held"
            total += self.feasibility.log_g(before, after)
        return total


def log_mean(log_values: NDArray[np.float64]) -> LogWeights:
    """Log of the mean of exp over axis 0, (n,); -inf where all are."""
    top = log_values.max(axis=0)
    base = np.where(np.isfinite(top), top, 0.0)
    total: LogWeights = base + arrays.log(arrays.exp(log_values - base).sum(axis=0))
    return total - math.log(len(log_values))
