"""The compiled scores of one weighted cloud of poses.

sin, cos and atan2 are computed from +, -, *, / alone (Cody & Waite reduction; coefficients of
Moshier's Cephes library), because NumPy's and the system's differ between instruction sets, and
what is scored must not.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.floorplan.compiling import compiled

Floats = NDArray[np.float64]
Scalar = Any  # a float64 inside a kernel

_TWO_PI = 2 * math.pi
_ROUNDER = 6755399441055744.0  # 1.5 * 2**52: adding and subtracting it rounds to an integer
_PIO2_1 = 2 * 7.85398125648498535156e-1
_PIO2_2 = 2 * 3.77489470793079817668e-8
_PIO2_3 = 2 * 2.69515142907905952645e-15
_S0, _S1, _S2 = 1.58962301576546568060e-10, -2.50507477628578072866e-8, 2.75573136213857245213e-6
_S3, _S4, _S5 = -1.98412698295895385996e-4, 8.33333333332211858878e-3, -1.66666666666666307295e-1
_C0, _C1, _C2 = -1.13585365213876817300e-11, 2.08757008419747316778e-9, -2.75573141792967388112e-7
_C3, _C4, _C5 = 2.48015872888517045348e-5, -1.38888888888730564116e-3, 4.16666666666665929218e-2
_P0, _P1, _P2 = -8.750608600031904122785e-1, -1.615753718733365076637e1, -7.500855792314704667340e1
_P3, _P4 = -1.228866684490136173410e2, -6.485021904942025371773e1
_Q0, _Q1, _Q2 = 2.485846490142306297962e1, 1.650270098316988542046e2, 4.328810604912902668951e2
_Q3, _Q4 = 4.853903996359136964868e2, 1.945506571482613964425e2
_TAN_3PI8 = 2.41421356237309504880


@compiled
def sine(angle: Scalar, quarters: int) -> Scalar:
    """sin(angle + quarters π/2), to about 2e-16 for |angle| < 10⁶ rad."""
    turns = (angle * (2 / math.pi) + _ROUNDER) - _ROUNDER
    r = ((angle - turns * _PIO2_1) - turns * _PIO2_2) - turns * _PIO2_3
    z = r * r
    odd = r + r * z * (((((_S0 * z + _S1) * z + _S2) * z + _S3) * z + _S4) * z + _S5)
    even = (((((_C0 * z + _C1) * z + _C2) * z + _C3) * z + _C4) * z + _C5) * z * z
    even = even - 0.5 * z + 1.0
    quadrant = np.int64(turns) + quarters
    value = even if (quadrant & 1) != 0 else odd
    return -value if (quadrant & 2) != 0 else value


@compiled
def direction(y: Scalar, x: Scalar) -> Scalar:
    """atan2(y, x) in (-π, π], to about 3e-16; 0 at (0, 0)."""
    if x == 0.0 and y == 0.0:
        return 0.0
    steep = abs(y) / abs(x)  # inf where x = 0
    base = 0.0
    if steep > _TAN_3PI8:
        base, steep = math.pi / 2, -1.0 / steep
    elif steep > 0.66:
        base, steep = math.pi / 4, (steep - 1.0) / (steep + 1.0)
    z = steep * steep
    p = (((_P0 * z + _P1) * z + _P2) * z + _P3) * z + _P4
    q = ((((z + _Q0) * z + _Q1) * z + _Q2) * z + _Q3) * z + _Q4
    angle = base + (steep * (z * p / q) + steep)
    angle = math.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@compiled
def wrapped(angle: Scalar) -> Scalar:
    """The angle less full turns, in [-π, π]."""
    turns = (angle * (1 / _TWO_PI) + _ROUNDER) - _ROUNDER
    return angle - turns * _TWO_PI


@compiled
def sines(angles: Floats, quarters: int, out: Floats) -> None:
    """Fill in sin(angle + quarters π/2), (n,)."""
    for i in range(angles.size):
        out[i] = sine(angles[i], quarters)


@compiled
def directions(y: Floats, x: Floats, out: Floats) -> None:
    """Fill in atan2(y, x), (n,)."""
    for i in range(y.size):
        out[i] = direction(y[i], x[i])


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
        cloud[2, i] = sine(poses[2, i], 1)
        cloud[3, i] = sine(poses[2, i], 0)
    out[:] = 0.0
    for k in range(4):
        for i in range(n):
            out[0, k] += weights[i] * cloud[k, i]
        for i in range(n):
            apart = cloud[k, i] - out[0, k]
            out[1, k] += weights[i] * apart * apart


@compiled
def thinned(weights: Floats, chosen: NDArray[np.intp]) -> None:
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
def energy(poses: Floats, weights: Floats, truth: Floats, chosen: NDArray[np.intp]) -> float:
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
    centre = direction(mean[3], mean[2])
    off = np.empty((3, n))
    for i in range(n):
        off[0, i] = poses[0, i] - mean[0]
        off[1, i] = poses[1, i] - mean[1]
        off[2, i] = wrapped(poses[2, i] - centre)
    p = np.zeros((3, 3))
    for a in range(3):
        for b in range(a + 1):
            for i in range(n):
                p[a, b] += weights[i] * off[a, i] * off[b, i]
        p[a, a] += floor[a]
    # Cholesky, P = G Gᵀ
    g00 = math.sqrt(p[0, 0])
    g10, g20 = p[1, 0] / g00, p[2, 0] / g00
    g11 = math.sqrt(p[1, 1] - g10 * g10)
    g21 = (p[2, 1] - g20 * g10) / g11
    g22 = math.sqrt(max(p[2, 2] - g20 * g20 - g21 * g21, floor[2]))  # max: against rounding
    u0 = (truth[0] - mean[0]) / g00
    u1 = (truth[1] - mean[1] - g10 * u0) / g11
    u2 = (wrapped(truth[2] - centre) - g20 * u0 - g21 * u1) / g22
    distance = u0 * u0 + u1 * u1
    nearer = 0.0
    for i in range(n):
        v0 = off[0, i] / g00
        v1 = (off[1, i] - g10 * v0) / g11
        nearer += weights[i] if v0 * v0 + v1 * v1 < distance else 0.0
    return nearer, distance + u2 * u2
