"""The compiled scores of weighted clouds of poses, many clouds in one pass.

Clouds lie one after the other in memory; a cloud is copied before it is worked on, so that the
compiler knows that its rows are contiguous and overlap nothing: that is worth half the time.
"""

import math
from typing import Any

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import atan2_64, cos64, sin64, wrapped64
from deqmcl_gym.numerics.types import Floats, Ints, Reals

Scalar = Any  # a float64 inside a kernel

# Particles whose mutual distances stand for those of the whole cloud in the energy score.
PAIRED = 128


@compiled
def moments(poses: Reals, weights: Floats, ends: Ints, out: Floats) -> None:
    """Fill in mean and variance of (x, y, cos θ, sin θ), Σ w and how many w < 0, (k, 10).

    Args:
        poses: rows x, y, θ of all clouds, (3, N).
        weights: (N,).
        ends: where each cloud ends, (k,).
    """
    start = 0
    for k in range(ends.size):
        end = ends[k]
        x, y = poses[0, start:end].astype(np.float64), poses[1, start:end].astype(np.float64)
        _moments(x, y, poses[2, start:end].astype(np.float64), weights[start:end].copy(), out[k])
        start = end


@compiled
def _moments(x: Floats, y: Floats, heading: Floats, weights: Floats, out: Floats) -> None:
    n = weights.size
    c, s = np.empty(n), np.empty(n)
    for i in range(n):
        c[i] = cos64(heading[i])
        s[i] = sin64(heading[i])
    mx, my, mc, ms, total = 0.0, 0.0, 0.0, 0.0, 0.0  # side by side: none waits for another
    for i in range(n):
        mx += weights[i] * x[i]
        my += weights[i] * y[i]
        mc += weights[i] * c[i]
        ms += weights[i] * s[i]
        total += weights[i]
    vx, vy, vc, vs = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        vx += weights[i] * (x[i] - mx) * (x[i] - mx)
        vy += weights[i] * (y[i] - my) * (y[i] - my)
        vc += weights[i] * (c[i] - mc) * (c[i] - mc)
        vs += weights[i] * (s[i] - ms) * (s[i] - ms)
    below = 0
    for i in range(n):
        below += weights[i] < 0.0
    out[0], out[1], out[2], out[3] = mx, my, mc, ms
    out[4], out[5], out[6], out[7] = vx, vy, vc, vs
    out[8], out[9] = total, below
    if n == 1:
        out[4:8] = math.nan


@compiled
def calibration(
    poses: Reals,
    weights: Floats,
    ends: Ints,
    means: Floats,
    truth: Floats,
    floor: Floats,
    out: Floats,
) -> None:
    """Fill in energy score, rank of the truth and NEES; see ``clouds.calibration``, (k, 3).

    Args:
        poses, weights, ends: as ``moments``.
        means: of (x, y, cos θ, sin θ), (k, 4).
        truth: (k, 3).
        floor: added to the variances of x, y, θ, (3,).
    """
    start = 0
    for k in range(ends.size):
        end = ends[k]
        x, y = poses[0, start:end].astype(np.float64), poses[1, start:end].astype(np.float64)
        own = weights[start:end].copy()
        out[k, 0] = _near(x, y, own, truth[k])
        if own.size == 1:
            out[k, 1], out[k, 2] = math.nan, math.nan
        else:
            out[k, 0] -= _apart(x, y, own)
            heading = poses[2, start:end].astype(np.float64)
            out[k, 1], out[k, 2] = _rank_and_nees(x, y, heading, own, means[k], truth[k], floor)
        start = end


@compiled
def _near(x: Floats, y: Floats, weights: Floats, truth: Floats) -> Scalar:
    """Σ w |x_i - truth|, in (x, y)."""
    near, far = 0.0, np.empty(weights.size)
    for i in range(weights.size):
        dx, dy = x[i] - truth[0], y[i] - truth[1]
        far[i] = weights[i] * math.sqrt(dx * dx + dy * dy)
    for i in range(weights.size):
        near += far[i]
    return near


@compiled
def _apart(x: Floats, y: Floats, weights: Floats) -> Scalar:
    """½ the mean distance of pairs of particles at the cumulative weights (j + ½) / PAIRED."""
    n = weights.size
    some_x, some_y, spread = np.empty(PAIRED), np.empty(PAIRED), np.zeros(PAIRED)
    total = 0.0
    for i in range(n):
        total += weights[i]
    reached, particle = weights[0], 0
    for j in range(PAIRED):
        goal = (j + 0.5) / PAIRED * total
        while reached <= goal and particle < weights.size - 1:
            particle += 1
            reached += weights[particle]
        some_x[j], some_y[j] = x[particle], y[particle]
    for j in range(1, PAIRED):  # one sum per k, so that the inner loop is SIMD code
        for k in range(j):
            dx, dy = some_x[j] - some_x[k], some_y[j] - some_y[k]
            spread[k] += math.sqrt(dx * dx + dy * dy)
    apart = 0.0
    for k in range(PAIRED):
        apart += spread[k]
    return apart / (PAIRED * (PAIRED - 1))


@compiled
def _rank_and_nees(
    x: Floats,
    y: Floats,
    heading: Floats,
    weights: Floats,
    mean: Floats,
    truth: Floats,
    floor: Floats,
) -> tuple[Scalar, Scalar]:
    """Weight nearer to the mean than the truth is, and dᵀ P⁻¹ d of (x, y, θ)."""
    n = weights.size
    mx, my, centre = mean[0], mean[1], atan2_64(mean[3], mean[2])
    turned = np.empty(n)
    for i in range(n):
        turned[i] = wrapped64(heading[i] - centre)
    pxx, pyy, ptt = floor[0], floor[1], floor[2]
    pxy, pxt, pyt = 0.0, 0.0, 0.0
    for i in range(n):
        dx, dy, dt = x[i] - mx, y[i] - my, turned[i]
        wx, wy, wt = weights[i] * dx, weights[i] * dy, weights[i] * dt
        pxx += wx * dx
        pyy += wy * dy
        ptt += wt * dt
        pxy += wx * dy
        pxt += wx * dt
        pyt += wy * dt
    # Cholesky, P = G Gᵀ
    g00 = math.sqrt(pxx)
    g10, g20 = pxy / g00, pxt / g00
    g11 = math.sqrt(pyy - g10 * g10)
    g21 = (pyt - g20 * g10) / g11
    g22 = math.sqrt(max(ptt - g20 * g20 - g21 * g21, floor[2]))  # max: against rounding
    u0 = (truth[0] - mx) / g00
    u1 = (truth[1] - my - g10 * u0) / g11
    u2 = (wrapped64(truth[2] - centre) - g20 * u0 - g21 * u1) / g22
    distance = u0 * u0 + u1 * u1
    nearer = 0.0
    h00, h10, h11 = 1.0 / g00, -g10 / (g00 * g11), 1.0 / g11  # G⁻¹
    for i in range(n):
        v0 = h00 * (x[i] - mx)
        v1 = h10 * (x[i] - mx) + h11 * (y[i] - my)
        turned[i] = weights[i] if v0 * v0 + v1 * v1 < distance else 0.0
    for i in range(n):
        nearer += turned[i]
    return nearer, distance + u2 * u2
