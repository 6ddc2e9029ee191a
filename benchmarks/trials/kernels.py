"""The compiled scores of one weighted cloud of poses."""

import math
from typing import Any

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import atan2_64, cos64, sin64
from deqmcl_gym.numerics.types import Floats, Indices

Scalar = Any  # a float64 inside a kernel

_TWO_PI = 2 * math.pi
_ROUNDER = 6755399441055744.0  # 1.5 * 2**52: adding and subtracting it rounds to an integer


@compiled
def wrapped(angle: Scalar) -> Scalar:
    """The angle less full turns, in [-π, π]."""
    turns = (angle * (1 / _TWO_PI) + _ROUNDER) - _ROUNDER
    return angle - turns * _TWO_PI


@compiled
def moments(poses: Floats, weights: Floats, out: Floats) -> None:
    """Fill in mean and variance of (x, y, cos θ, sin θ), (2, 4).

    Args:
        poses: rows x, y, θ, (3, n).
        weights: with sum 1, (n,).
    """
    n = weights.size
    cloud = np.empty((4, n))
    for i in range(n):
        cloud[0, i] = poses[0, i]
        cloud[1, i] = poses[1, i]
        cloud[2, i] = cos64(poses[2, i])
        cloud[3, i] = sin64(poses[2, i])
    x, y, c, s = 0.0, 0.0, 0.0, 0.0  # side by side: the processor adds to all of them at once
    for i in range(n):
        x += weights[i] * cloud[0, i]
        y += weights[i] * cloud[1, i]
        c += weights[i] * cloud[2, i]
        s += weights[i] * cloud[3, i]
    vx, vy, vc, vs = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        vx += weights[i] * (cloud[0, i] - x) * (cloud[0, i] - x)
        vy += weights[i] * (cloud[1, i] - y) * (cloud[1, i] - y)
        vc += weights[i] * (cloud[2, i] - c) * (cloud[2, i] - c)
        vs += weights[i] * (cloud[3, i] - s) * (cloud[3, i] - s)
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = x, y, c, s
    out[1, 0], out[1, 1], out[1, 2], out[1, 3] = vx, vy, vc, vs


@compiled
def thinned(weights: Floats, chosen: Indices) -> None:
    """Fill in which particles stand at the cumulative weights (j + ½) / m, j = 0 … m - 1."""
    m = chosen.size
    total = 0.0
    for i in range(weights.size):
        total += weights[i]
    reached, particle = weights[0], 0
    for j in range(m):
        goal = (j + 0.5) / m * total
        while reached <= goal and particle < weights.size - 1:
            particle += 1
            reached += weights[particle]
        chosen[j] = particle


@compiled
def energy(poses: Floats, weights: Floats, truth: Floats, chosen: Indices) -> float:
    """Σ w |x_i - truth| - ½ (mean distance of the pairs j ≠ k of chosen particles), in (x, y)."""
    near = 0.0
    for i in range(weights.size):
        dx, dy = poses[0, i] - truth[0], poses[1, i] - truth[1]
        near += weights[i] * math.sqrt(dx * dx + dy * dy)
    m = chosen.size
    if m < 2:
        return near
    x, y, spread = np.empty(m), np.empty(m), np.zeros(m)
    for j in range(m):
        x[j], y[j] = poses[0, chosen[j]], poses[1, chosen[j]]
    for j in range(1, m):  # one sum per k, so that the inner loop is SIMD code
        for k in range(j):
            dx, dy = x[j] - x[k], y[j] - y[k]
            spread[k] += math.sqrt(dx * dx + dy * dy)
    apart = 0.0
    for k in range(m):
        apart += spread[k]
    return near - apart / (m * (m - 1))


@compiled
def rank_and_nees(
    poses: Floats, weights: Floats, mean: Floats, truth: Floats, floor: Floats
) -> tuple[float, float]:
    """Weight nearer to the mean than the truth is, and dᵀ P⁻¹ d of (x, y, θ).

    Args:
        poses: rows x, y, θ, (3, n).
        weights: with sum 1, (n,).
        mean: of (x, y, cos θ, sin θ), (4,).
        truth: (3,).
        floor: added to the diagonal of P, (3,).
    """
    n = weights.size
    centre = atan2_64(mean[3], mean[2])
    off = np.empty((3, n))
    for i in range(n):
        off[0, i] = poses[0, i] - mean[0]
        off[1, i] = poses[1, i] - mean[1]
        off[2, i] = wrapped(poses[2, i] - centre)
    pxx, pyy, ptt = floor[0], floor[1], floor[2]
    pxy, pxt, pyt = 0.0, 0.0, 0.0
    for i in range(n):
        wx, wy, wt = weights[i] * off[0, i], weights[i] * off[1, i], weights[i] * off[2, i]
        pxx += wx * off[0, i]
        pyy += wy * off[1, i]
        ptt += wt * off[2, i]
        pxy += wx * off[1, i]
        pxt += wx * off[2, i]
        pyt += wy * off[2, i]
    # Cholesky, P = G Gᵀ
    g00 = math.sqrt(pxx)
    g10, g20 = pxy / g00, pxt / g00
    g11 = math.sqrt(pyy - g10 * g10)
    g21 = (pyt - g20 * g10) / g11
    g22 = math.sqrt(max(ptt - g20 * g20 - g21 * g21, floor[2]))  # max: against rounding
    u0 = (truth[0] - mean[0]) / g00
    u1 = (truth[1] - mean[1] - g10 * u0) / g11
    u2 = (wrapped(truth[2] - centre) - g20 * u0 - g21 * u1) / g22
    distance = u0 * u0 + u1 * u1
    nearer = 0.0
    h00, h10, h11 = 1.0 / g00, -g10 / (g00 * g11), 1.0 / g11  # G⁻¹
    for i in range(n):
        v0 = h00 * off[0, i]
        v1 = h10 * off[0, i] + h11 * off[1, i]
        nearer += weights[i] if v0 * v0 + v1 * v1 < distance else 0.0
    return nearer, distance + u2 * u2
