"""The compiled loops over functions on a grid of poses: one step backwards, interpolation.

A function is a float32 array (H, ny, nx): one plane per heading, x innermost, so that a motion is
the same shift for a whole plane.
"""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import log64

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]
_ZERO = np.float32(0.0)


@compiled
def driven_back(
    h: Singles,
    cells: Ints,
    parts: Singles,
    shares: Singles,
    collides: NDArray[np.bool_],
    charge: np.float32,
    out: Singles,
) -> None:
    """Fill in Σ_q p_q g(x, x + s_q) h(x + s_q), h linear between nodes and constant outside.

    Args:
        h: (H, ny, nx).
        cells, parts: the shifts s_q, whole cells and the rest in [0, 1) along x and y, (Q, H, 2).
        shares: p_q, (Q,).
        collides: whether x to x + s_q collides, (Q, H, ny, nx).
        charge: g of a step that does.
        out: (H, ny, nx).
    """
    headings, ny, nx = h.shape
    pad = _largest(cells) + 1
    padded = np.empty((ny + 2 * pad, nx + 2 * pad), np.float32)
    for heading in range(headings):
        _extend(h[heading], pad, padded)
        plane = out[heading]
        for y in range(ny):
            row = plane[y]
            for x in range(nx):
                row[x] = _ZERO
            for q in range(shares.size):
                fx, fy = parts[q, heading, 0], parts[q, heading, 1]
                left, low = pad + cells[q, heading, 0], pad + y + cells[q, heading, 1]
                a, b = padded[low, left : left + nx + 1], padded[low + 1, left : left + nx + 1]
                blocked = collides[q, heading, y]
                clear, charged = shares[q], shares[q] * charge
                for x in range(nx):
                    below = a[x] + fx * (a[x + 1] - a[x])
                    above = b[x] + fx * (b[x + 1] - b[x])
                    g = charged if blocked[x] else clear
                    row[x] += g * (below + fy * (above - below))


@compiled
def _largest(cells: Ints) -> int:
    """Largest absolute value."""
    largest = 0
    for cell in cells.flat:
        largest = max(largest, int(abs(cell)))
    return largest


@compiled
def _extend(plane: Singles, pad: int, out: Singles) -> None:
    """Fill in the plane with its border repeated ``pad`` times around it."""
    ny, nx = plane.shape
    for y in range(out.shape[0]):
        row = plane[min(max(y - pad, 0), ny - 1)]
        for x in range(out.shape[1]):
            out[y, x] = row[min(max(x - pad, 0), nx - 1)]


@compiled
def turned_back(h: Singles, weights: Singles, first: int, least: np.float32, out: Singles) -> None:
    """Fill in max(Σ_k w_k h(θ + first + k, ·), least), headings counted round the circle.

    Args:
        h: (H, ny · nx).
        weights: (K,).
        first: headings from the old to the first new one.
        least: see ``LookaheadGrid``.
        out: (H, ny · nx).
    """
    headings, size = h.shape
    for heading in range(headings):
        plane = out[heading]
        for i in range(size):
            plane[i] = _ZERO
        for k in range(weights.size):
            seen, weight = h[(heading + first + k) % headings], weights[k]
            for i in range(size):
                plane[i] += weight * seen[i]
        for i in range(size):
            plane[i] = max(plane[i], least)


@compiled
def log_interpolated(
    h: Singles, poses: Singles, x0: float, y0: float, cell: float, out: Floats
) -> None:
    """Fill in log h at each pose, h linear between nodes in x, y and θ and constant outside.

    Args:
        h: (H, ny, nx), heading 0 first.
        poses: rows x px, y px, θ rad, (3, n).
        x0, y0: of the first node, px.
        cell: px.
        out: (n,).
    """
    headings, ny, nx = h.shape
    for i in range(out.size):
        x = min(max((poses[0, i] - x0) / cell, 0.0), nx - 1.0)
        y = min(max((poses[1, i] - y0) / cell, 0.0), ny - 1.0)
        turns = poses[2, i] / (2.0 * np.pi)
        heading = (turns - np.floor(turns)) * headings
        left, low, first = min(int(x), nx - 2), min(int(y), ny - 2), int(heading)
        fx, fy, part = x - left, y - low, heading - first
        value = 0.0
        for plane, share in ((first, 1.0 - part), (first + 1, part)):
            p = h[plane % headings]
            below = p[low, left] * (1.0 - fx) + p[low, left + 1] * fx
            above = p[low + 1, left] * (1.0 - fx) + p[low + 1, left + 1] * fx
            value += share * (below * (1.0 - fy) + above * fy)
        out[i] = log64(value)
