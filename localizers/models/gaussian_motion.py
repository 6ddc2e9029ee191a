"""p(x_t | x_{t-1}, u_t) with a density: Gaussians with the spread of another motion model."""

from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np

from deqmcl_gym.logs.motion import composed
from deqmcl_gym.numerics import Floats, Singles, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, exp64, sin64, wrapped64
from localizers.api import Motion
from localizers.models.motion import increments
from localizers.models.nav2_motion import moved

_DRAWS = 10_000  # of the other model, for its spread
_SLIPS, _FARTHER = 0.1, 5.0  # share of steps that may be so many times as far off ahead


@final
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
    told, start = np.array(action), np.zeros((3, _DRAWS), np.float32)
    mean = moved(start[:, :1], told).astype(np.float64)
    off = motion.motion.sample(start, told, np.random.default_rng(0)) - mean
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
