"""The parts of a particle filter over any state space, as protocols, and what parts remember.

States are columns, (d, n): row i holds component i of all n particles. On a map they are poses,
d = 3 (x, y, heading); the tests of exactness use a ring of five states.
"""

from collections.abc import Callable
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics.types import Floats, Indices
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

        Args:
            states: of the particles, moved, (d, n).
            log_weights: before the scan, (n,).
            scan: o_t.
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
        """Draw one path from each state, (d, n).

        Returns:
            The states after each step, (d, k) each, of the k paths that are asked for by number
            (none unless ``keep``), and log Π g of each path, (n,). Same draws, and same bits, as
            ``StepByStep``.
        """


class Memory:
    """What a part remembers from step to step.

    A belief carries one of each class: ``ParticleBelief.remembering`` adds it,
    ``ParticleBelief.recall`` returns it.
    """

    def scanned(self, scan: Scan, log_evidence: float) -> Self:
        """Return what is remembered after a scan of evidence log Σ w p(o | x)."""
        return self
