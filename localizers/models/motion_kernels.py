"""The compiled inner loops of odometry: normal numbers, and poses driven by them."""

import numpy as np

from deqmcl_gym.maps.kernels import drive as drive_poses
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import sincos32
from deqmcl_gym.numerics.exponential_kernels import log32
from deqmcl_gym.numerics.types import Floats, Singles

_HALF, _MINUS_TWO = np.float32(0.5), np.float32(-2.0)
_TURN, _PER_UNIFORM = np.float32(2 * np.pi), np.float32(2.0**-24)


@compiled
def normal_pairs(
    uniforms: Floats,
    first_mean: float,
    first_sd: float,
    mean: float,
    sd: float,
    first: Singles,
    second: Singles,
) -> None:
    """Fill in pairs of independent normal numbers, each made of one uniform number.

    Box & Muller 1958: √(-2 log u) (cos 2πv, sin 2πv), u of the first 24 bits of the uniform number,
    v of its other 29. The largest is 5.9 standard deviations.

    Args:
        uniforms: multiples of 2⁻⁵³ in [0, 1), (n,).
        first_mean, first_sd, mean, sd: of the first of each pair, and of the second.
        first, second: the numbers to fill in, (n,).
    """
    n = uniforms.size
    radius, angle = np.empty(n, np.float32), np.empty(n, np.float32)
    for i in range(n):
        scaled = uniforms[i] * 16777216.0
        whole = np.int32(scaled)
        radius[i] = np.float32(whole)
        angle[i] = np.float32(scaled - whole)
    for i in range(n):
        radius[i] = np.sqrt(_MINUS_TWO * log32((radius[i] + _HALF) * _PER_UNIFORM))
    for i in range(n):
        angle[i] = angle[i] * _TURN
    sincos32(angle, second, first)
    shift, scale = np.float32(first_mean), np.float32(first_sd)
    for i in range(n):
        first[i] = shift + scale * (radius[i] * first[i])
    shift, scale = np.float32(mean), np.float32(sd)
    for i in range(n):
        second[i] = shift + scale * (radius[i] * second[i])


@compiled
def along(forward: float, left: float) -> tuple[float, float, float]:
    """Return (d, u, v) with (forward, left) = d (u, v), u² + v² = 1 and u ≥ 0: d < 0 is backwards.

    (forward, 1, 0) exactly where left is 0.
    """
    if left == 0.0:
        return forward, 1.0, 0.0
    distance = np.copysign(np.sqrt(forward * forward + left * left), forward)
    return distance, forward / distance, left / distance


@compiled
def _noisy_move(
    uniforms: Floats, increment: Floats, drive: float, turn: float, drift: float, out: Singles
) -> None:
    distance, u, v = along(increment[0], increment[1])
    angle = increment[2]
    sd_angle = turn * abs(angle) + drift * abs(distance)
    normal_pairs(uniforms, distance, drive * abs(distance), angle, sd_angle, out[0], out[2])
    if v == 0.0:
        out[1] = 0.0
        return
    ahead, aside = np.float32(u), np.float32(v)
    for i in range(uniforms.size):
        out[1, i] = out[0, i] * aside
        out[0, i] = out[0, i] * ahead


@compiled
def noisy_moves(
    uniforms: Floats, actions: Floats, drive: float, turn: float, drift: float, out: Singles
) -> None:
    """Fill in each increment with its noise; the rest as ``OdometryMotion``.

    Args:
        uniforms: as for ``normal_pairs``, (F, n).
        actions: increments (forward, left, turn), (F, 3).
        drive, turn, drift: of the noise.
        out: (F, 3, n).
    """
    for step in range(actions.shape[0]):
        _noisy_move(uniforms[step], actions[step], drive, turn, drift, out[step])


@compiled
def odometry(
    poses: Singles,
    uniforms: Floats,
    action: Floats,
    drive: float,
    turn: float,
    drift: float,
    out: Singles,
) -> None:
    """Fill in one successor of each pose (3, n); the rest as ``noisy_moves``, for one increment."""
    moves = np.empty((3, uniforms.size), np.float32)
    _noisy_move(uniforms, action, drive, turn, drift, moves)
    drive_poses(poses, moves, out)
