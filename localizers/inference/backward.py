"""Whole paths of p(x_{0:T} | u_{1:T}, o_{0:T}, m): a particle filter forward, then draws backward.

Godsill, Doucet & West 2004, "Monte Carlo smoothing for nonlinear time series": x_T is drawn by
weight from the last cloud, then x_t from its own, with probability ∝ w_t p(x_{t+1} | x_t, u_{t+1}).
A path is not tied to the ancestors of its end, of which after some steps all particles share one.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from deqmcl_gym.numerics import Floats, Indices
from deqmcl_gym.numerics.compiling import compiled
from localizers.api import Motion
from localizers.inference.particles import (
    Initial,
    States,
    Weights,
    normalized_with_log_sum,
    pointed_at,
)
from localizers.models.scan import Scan, ScanModel

SPREAD = 10  # times the particles, while a cloud is wide


class Transition(Motion, Protocol):
    """p(x_t | x_{t-1}, u_t), to draw from and in numbers."""

    def density(self, before: States, after: States, action: Floats) -> Floats:
        """Density of each of m states after each of n, (m, n)."""


Filtered = list[tuple[States, Weights]]  # what a filter believes after each scan o_0 … o_T


def forward(
    prior: Initial,
    motion: Motion,
    scan_model: ScanModel,
    scans: Sequence[Scan],
    actions: Floats,
    particles: int,
    rng: np.random.Generator,
    *,
    wide: float = np.inf,
    dtype: Any = np.float32,
) -> tuple[Filtered, float]:
    """Filter T + 1 scans and the actions between them, (T, k); return clouds and log p(o_{0:T}).

    A cloud with a standard deviation of x or y above ``wide`` has ten times the particles.
    """
    most, clouds, evidence = SPREAD * particles, Filtered(), 0.0
    pointers = np.arange(most) / most
    states = prior.sample(most, rng).T.astype(dtype)
    for t, scan in enumerate(scans):
        if states[:2].std(axis=1).max() <= wide:
            states = states[:, rng.integers(SPREAD) :: SPREAD]
        states = np.ascontiguousarray(states)
        if t > 0:
            states = motion.sample(states, actions[t - 1], rng)
        weights, log_sum = normalized_with_log_sum(scan_model.log_likelihood(states, scan))
        if not log_sum > -np.inf:  # no particle explains it
            weights[:] = 1 / weights.size
        evidence += log_sum - np.log(weights.size)
        clouds.append((states, weights))
        states = states.take(pointed_at(weights, pointers + rng.random() / most), axis=1)
    return clouds, evidence


def backward(
    clouds: Filtered, motion: Transition, actions: Floats, count: int, rng: np.random.Generator
) -> States:
    """Draw so many whole paths, (T + 1, d, count)."""
    paths = list[States]()
    pick = np.empty(count, np.intp)
    for t, (states, weights) in reversed(list(enumerate(clouds))):
        densities = np.ones((count, weights.size))
        if paths:
            densities = motion.density(states, paths[-1], actions[t])
        _fill_picks(weights, densities, rng.random(count), pick)
        paths.append(states.take(pick, axis=1))
    return np.stack(paths[::-1])


@compiled
def _fill_picks(weights: Floats, densities: Floats, uniforms: Floats, out: Indices) -> None:
    """Fill in a particle for each row of densities (m, n), drawn with probability ∝ w p."""
    n = weights.size
    cumulative = np.empty(n)
    for j in range(out.size):
        total = 0.0
        for i in range(n):
            total += weights[i] * densities[j, i]
            cumulative[i] = total
        out[j] = min(np.searchsorted(cumulative, uniforms[j] * total, side="right"), n - 1)
