"""The parts of a particle filter, as protocols over any state space.

States are columns, (d, n): row i holds component i of all n particles. On a map they are poses,
d = 3 (x, y, heading); the tests of exactness use a ring of five states.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics.types import Floats, Indices, Ints

States = NDArray[Any]  # (d, n)
LogWeights = Floats  # (n,)
Weights = Floats  # (n,), with sum 1
Action = Floats  # (k,)
Actions = Floats  # (steps, k)


class Initial(Protocol):
    """p(x_0)."""

    def sample(self, n: int, rng: np.random.Generator) -> NDArray[Any]:
        """Draw n states, (n, d)."""
        ...


class Motion(Protocol):
    """p(x_t | x_{t-1}, a_t)."""

    def sample(self, states: States, action: Action, rng: np.random.Generator) -> States:
        """Draw one successor of each state, (d, n)."""
        ...


class Scan(Protocol):
    """p(o_t | x_t, m)."""

    def log_likelihood(self, states: States, ranges: Floats) -> LogWeights:
        """Log-density of the observation at each state, up to one common constant, (n,)."""
        ...


class Feasibility(Protocol):
    """g(x', x), how feasible the step x' → x is on the map."""

    def log_g(self, before: States, after: States) -> LogWeights:
        """Log g of each step, (n,)."""
        ...


class PlanModel(Protocol):
    """p(π_t | x_t, m) ∝ exp(-β C(x_t, π_t)): how likely a plan is to be shown at a state."""

    @property
    def beta(self) -> float:
        """β ≥ 0; inf rules out states from which a planned step collides."""
        ...

    def collisions(self, states: States, plan: Actions, first: int = 0) -> Ints:
        """Return C of each state, (n,): planned steps that collide, from step ``first`` on."""
        ...


class Walk(Protocol):
    """Several steps of p(x_s | x_{s-1}, u_s), each charged by g."""

    def __call__(
        self, states: States, actions: Actions, rng: np.random.Generator, *, keep: bool
    ) -> tuple[list[States], LogWeights]:
        """Draw one path from each state, (d, n).

        Returns:
            The states after each step, (d, n) each (none unless ``keep``), and
            log Π g of each path, (n,). Same draws, and same bits, as ``StepByStep``.
        """
        ...


class Resampling(Protocol):
    """When to resample, and how; draws one uniform number or row whether or not it triggers."""

    def ancestors(self, weights: Weights, rng: np.random.Generator) -> Indices | None:
        """Return the particles to keep, (n,), or None to keep all with their weights.

        The weights have sum 1, (n,).
        """
        ...
