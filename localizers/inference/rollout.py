"""Futures drawn from given states by planned actions, and how feasible they are."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats
from localizers.inference.belief import ParticleBelief
from localizers.inference.parts import Actions, Feasibility, LogWeights, Motion, States, Walk


@dataclass(frozen=True)
class Unconstrained:
    """g = 1: the map does not restrict where the robot can go."""

    def log_g(self, before: States, after: States) -> LogWeights:
        """Zero for each step, (n,)."""
        return np.zeros(after.shape[1])


@dataclass(frozen=True)
class Rollout:
    """x'_s ~ p(· | x'_{s-1}, u_s) step by step, with Σ log g(x'_{s-1}, x'_s).

    A feasibility that can process all steps of a motion in one pass has a method ``walk(motion)``,
    which returns a ``Walk``, or None for a motion it does not support.
    """

    motion: Motion
    feasibility: Feasibility

    def futures(
        self, anchor: States, actions: Actions, copies: int, rng: np.random.Generator
    ) -> tuple[list[States], Floats]:
        """Draw ``copies`` = K futures from each state of ``anchor``, (d, n).

        Returns:
            The states of each step, (d, K, n), and log Π g of each future, (K, n).
        """
        d, n = anchor.shape
        paths, log_g = self._walk(np.tile(anchor, (1, copies)), actions, rng, keep=True)
        return [states.reshape(d, copies, n) for states in paths], log_g.reshape(copies, n)

    def log_g(
        self, anchor: States, actions: Actions, copies: int, rng: np.random.Generator
    ) -> Floats:
        """Log Π g of the same futures, (K, n), without their states."""
        _, log_g = self._walk(np.tile(anchor, (1, copies)), actions, rng, keep=False)
        return log_g.reshape(copies, anchor.shape[1])

    def queued_log_g(self, belief: ParticleBelief, shared: int = 0) -> LogWeights:
        """Log Π g of each particle's own future from ``shared`` steps ahead on, (n,)."""
        return self.log_g_of(belief.queue.since(shared))

    def log_g_of(self, path: Sequence[States]) -> LogWeights:
        """Log Π g of a path of states, (d, n) each, (n,)."""
        total = np.zeros(path[0].shape[1])
        for before, after in pairwise(path):
            total += self.feasibility.log_g(before, after)
        return total

    @cached_property
    def _walk(self) -> Walk:
        offer = getattr(self.feasibility, "walk", None)
        walk: Walk | None = offer(self.motion) if offer is not None else None
        return StepByStep(self.motion, self.feasibility) if walk is None else walk


@dataclass(frozen=True)
class StepByStep:
    """The ``Walk`` of any motion and any feasibility."""

    motion: Motion
    feasibility: Feasibility

    def __call__(
        self, states: States, actions: Actions, rng: np.random.Generator, *, keep: bool
    ) -> tuple[list[States], LogWeights]:
        """Draw and charge one step after the other."""
        log_g = np.zeros(states.shape[1])
        path = []
        for action in actions:
            before, states = states, self.motion.sample(states, action, rng)
            log_g += self.feasibility.log_g(before, states)
            if keep:
                path.append(states)
        return path, log_g


def log_mean(log_values: Floats) -> LogWeights:
    """Log of the mean of exp over axis 0, (n,); -inf where all are."""
    top = log_values.max(axis=0)
    base = np.where(np.isfinite(top), top, 0.0)
    total: LogWeights = base + arrays.log(arrays.exp(log_values - base).sum(axis=0))
    return total - math.log(len(log_values))
