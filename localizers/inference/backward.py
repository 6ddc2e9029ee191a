"""Whole paths of p(x_{0:T} | u_{1:T}, o_{0:T}, m): a particle filter forward, then draws backward.

Godsill, Doucet & West 2004, "Monte Carlo smoothing for nonlinear time series": x_T is drawn by
weight from the last cloud, then x_t from its own, with probability ∝ w_t p(x_{t+1} | x_t, u_{t+1}).
A path is not tied to the ancestors of its end, of which after some steps all particles share one.
The motion needs a density: ``GaussianMotion`` has the spread of another model.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from deqmcl_gym.logs.motion import composed
from deqmcl_gym.numerics import Floats, Singles, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, exp64, sin64, wrapped64
from localizers.api import Motion, Prior
from localizers.inference.particles import States, Weights, normalized_with_log_sum, pointed_at
from localizers.models.motion import increments
from localizers.models.nav2_motion import moved
from localizers.models.scan import Scan, ScanModel

SPREAD = 10  # times the particles, while a cloud is wide
Filtered = list[tuple[States, Weights]]  # what a filter believes after each scan o_0 … o_T


def forward(
    prior: Prior,
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


_DRAWS = 10_000  # of the other model, for its spread
_SLIPS, _FARTHER = 0.1, 5.0  # share of steps that may be so many times as far off ahead


@dataclass(frozen=True, kw_only=True)
class GaussianMotion:
    """x_t = x_{t-1} ⊕ v, v ~ 0.9 N(u', S) + 0.1 N(u', S'), S = Σ(u) + diag(ℓ², ℓ², α²).

    u' is the increment u, seen from x_{t-1}, Σ(u) the mean square of what ``motion`` draws beyond
    it, ℓ = ``length`` in the map's unit, α = ``angle``. Of Nav2's models themselves the density is
    infinite where the way is 0, as rot1 is arbitrary there, and 0 beside a turn on the spot;
    ``OdometryMotion`` has two noises for three numbers. S' is S with five times the noise ahead:
    wheels slip, and some odometry has no sign.
    """

    motion: Motion
    length: float
    angle: float = 0.01

    def sample(self, states: Singles, action: Floats, rng: np.random.Generator) -> Singles:
        """Draw one successor of each pose (3, n)."""
        mean, root = _moments(self, tuple(increments(action).tolist()))
        z = rng.standard_normal(states.shape)
        z[0, rng.random(states.shape[1]) < _SLIPS] *= _FARTHER
        offsets = [mean[i] + sum(root[i, j] * z[j] for j in range(i + 1)) for i in range(3)]
        after = composed(states.T.astype(np.float64), np.stack(offsets, axis=1))
        return np.ascontiguousarray(after.T, dtype=states.dtype)

    def density(self, before: Singles, after: Singles, action: Floats) -> Floats:
        """Density of each of m poses after each of n, (m, n)."""
        mean, root = _moments(self, tuple(increments(action).tolist()))
        out = np.empty((after.shape[1], before.shape[1]))
        _fill_densities(before, after, mean, root, out)
        return out


@lru_cache(maxsize=100_000)  # steps of a log, for each of its runs, forward and backward
def _moments(motion: GaussianMotion, action: tuple[float, ...]) -> tuple[Floats, Floats]:
    """Return mean (3,) and Cholesky root (3, 3) of an increment, seen from the pose before."""
    increment, start = np.array(action), np.zeros((3, _DRAWS), np.float32)
    mean = moved(start[:, :1], increment).astype(np.float64)
    off = motion.motion.sample(start, increment, np.random.default_rng(0)) - mean
    off[2] = arrays.wrapped(off[2])
    spread = (off[:, None] * off).mean(axis=2)
    slip = np.square([motion.length, motion.length, motion.angle])
    return mean[:, 0], arrays.cholesky(spread + np.diag(slip))


@compiled
def _fill_densities(
    before: Singles, after: Singles, mean: Floats, root: Floats, out: Floats
) -> None:
    """Fill in the density of before⁻¹ ⊕ after, (m, n)."""
    n = before.shape[1]
    sine, cosine, along, rest = np.empty((4, n))
    for i in range(n):
        sine[i], cosine[i] = sin64(np.float64(before[2, i])), cos64(np.float64(before[2, i]))
    usual = (1 - _SLIPS) / ((2 * np.pi) ** 1.5 * root[0, 0] * root[1, 1] * root[2, 2])
    slipped = usual * _SLIPS / (1 - _SLIPS) / _FARTHER
    for j in range(out.shape[0]):
        x, y, heading = np.float64(after[0, j]), np.float64(after[1, j]), np.float64(after[2, j])
        for i in range(n):
            dx, dy = x - before[0, i], y - before[1, i]
            first = (cosine[i] * dx + sine[i] * dy - mean[0]) / root[0, 0]
            second = (cosine[i] * dy - sine[i] * dx - mean[1] - root[1, 0] * first) / root[1, 1]
            turn = wrapped64(heading - before[2, i] - mean[2])
            third = (turn - root[2, 0] * first - root[2, 1] * second) / root[2, 2]
            along[i], rest[i] = -0.5 * first * first, -0.5 * (second * second + third * third)
        for i in range(n):
            far = exp64(along[i] / (_FARTHER * _FARTHER))
            out[j, i] = exp64(rest[i]) * (usual * exp64(along[i]) + slipped * far)


def backward(
    clouds: Filtered, motion: GaussianMotion, actions: Floats, count: int, rng: np.random.Generator
) -> States:
    """Draw so many whole paths, (T + 1, d, count)."""
    paths = list[States]()
    for t, (states, weights) in reversed(list(enumerate(clouds))):
        densities = np.ones((count, weights.size))
        if paths:
            densities = motion.density(states, paths[-1], actions[t])
        cumulative = np.cumsum(weights * densities, axis=1)
        goals = rng.random((count, 1)) * cumulative[:, -1:]
        chosen = (cumulative <= goals).sum(axis=1).clip(max=weights.size - 1)
        paths.append(states.take(chosen, axis=1))
    return np.stack(paths[::-1])
