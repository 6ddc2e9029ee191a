"""The compiled loops over functions on a grid of poses: one step backwards, interpolation.

A function is a float32 array (H, ny, nx): one plane per heading, x innermost, so that a motion is
the same shift for a whole plane.
"""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import log64
from deqmcl_gym.numerics.types import Bools, Floats, Singles

Ints = NDArray[np.int64]
_ZERO = np.float32(0.0)
_BLOCK = 512  # nodes
_TOGETHER = 8  # headings that are added at a time


@compiled
def stepped_back(
    h: Singles,
    width: int,
    pad: int,
    drives: tuple[Ints, Singles, Singles, Bools],
    charge: np.float32,
    turns: tuple[int, Singles],
    least: np.float32,
    box: tuple[int, int],
    wanted: Bools,
    out: Singles,
) -> None:
    """Fill in max(Σ_k w_k d(θ + first + k, ·), least), d(x) = Σ_q p_q g(x, x + s_q) h(x + s_q).

    h is linear between nodes and constant outside. Planes are extended by ``pad`` nodes on all
    sides, their rows one behind the other: so a shift is one offset for a whole plane, and the
    loop over its nodes one long one. It is cut into blocks whose planes stay in the cache.

    Args:
        h: (H, (ny + 2 pad) · width).
        width: nx + 2 pad.
        pad: nodes, more than any shift.
        drives: the shifts s_q, whole cells and the rest in [0, 1) along x and y, (Q, H, 2) each;
            p_q, (Q,); whether x to x + s_q collides, (Q, H, ny · width), from the first node on.
        charge: g of a step that does.
        turns: headings from the old to the first new one, counted round the circle; w, (K,).
        least: see ``LookaheadGrid``.
        box: the first row that is asked for, and the one after the last.
        wanted: which headings are, (H,).
        out: as h; right where it is asked for, and finite.
    """
    cells, parts, shares, collides = drives
    first, weights = turns
    headings = len(h)
    node = pad * width + pad  # the first one that is no extension
    padded = np.zeros(_TOGETHER * (1 + (weights.size - 1) // _TOGETHER), np.float32)
    padded[: weights.size] = weights  # a weight of 0 changes no bit of a sum
    rows = (first + np.arange(headings + padded.size)) % headings
    passed = np.zeros(headings, np.bool_)
    for heading in range(headings):
        for k in range(weights.size):
            passed[rows[heading + k]] |= wanted[heading]
    driven, turned = np.zeros((headings, _BLOCK), np.float32), np.empty(_BLOCK, np.float32)
    last = min(box[1] * width, h.shape[1] - 2 * node)
    for start in range(box[0] * width, last, _BLOCK):
        end = min(start + _BLOCK, last)
        for heading in range(headings):
            if not passed[heading]:
                continue
            total = driven[heading]
            total[:] = _ZERO
            for q in range(shares.size):
                shift = cells[q, heading, 1] * width + cells[q, heading, 0]
                ahead = h[heading, node + shift + start :]
                blocked = collides[q, heading, start:end]
                _drive(ahead, width, parts[q, heading], blocked, shares[q], charge, total)
        for heading in range(headings):
            if not wanted[heading]:
                continue
            turned[:] = _ZERO
            for k in range(0, padded.size, _TOGETHER):
                _turn(driven, rows[heading + k :], padded[k:], turned)
            _raise(turned, least, out[heading, node + start : node + end])
    for heading in range(headings):
        if wanted[heading]:
            _extend(out[heading].reshape(-1, width), pad, box)


@compiled
def _drive(
    ahead: Singles,
    width: int,
    part: Singles,
    blocked: Bools,
    share: np.float32,
    charge: np.float32,
    total: Singles,
) -> None:
    """Add p g(x, x + s) h(x + s) for a row of nodes x; ``ahead`` starts left below x + s."""
    fx, fy = part[0], part[1]
    a, b = ahead, ahead[width:]
    charged = share * charge
    for i in range(blocked.size):
        below = a[i] + fx * (a[i + 1] - a[i])
        above = b[i] + fx * (b[i + 1] - b[i])
        g = charged if blocked[i] else share
        total[i] += g * (below + fy * (above - below))


@compiled
def _turn(driven: Singles, rows: Ints, weights: Singles, total: Singles) -> None:
    """Add w_k d(θ_k, ·) of the next ``_TOGETHER`` headings to a row of nodes."""
    a, b, c, d = driven[rows[0]], driven[rows[1]], driven[rows[2]], driven[rows[3]]
    e, f, g, h = driven[rows[4]], driven[rows[5]], driven[rows[6]], driven[rows[7]]
    p, q, r, s = weights[0], weights[1], weights[2], weights[3]
    t, u, v, w = weights[4], weights[5], weights[6], weights[7]
    for i in range(total.size):
        half = (((total[i] + p * a[i]) + q * b[i]) + r * c[i]) + s * d[i]
        total[i] = (((half + t * e[i]) + u * f[i]) + v * g[i]) + w * h[i]


@compiled
def _raise(values: Singles, least: np.float32, out: Singles) -> None:
    """Fill in the values, or ``least`` where they are below it."""
    for i in range(out.size):
        out[i] = values[i] if values[i] > least else least


@compiled
def _extend(plane: Singles, pad: int, box: tuple[int, int]) -> None:
    """Repeat the border of some rows of the plane inside ``pad`` nodes over those."""
    ny, nx = plane.shape[0] - 2 * pad, plane.shape[1] - 2 * pad
    for y in range(pad + box[0], pad + box[1]):
        for x in range(pad):
            plane[y, x] = plane[y, pad]
            plane[y, pad + nx + x] = plane[y, pad + nx - 1]
    for y in range(pad):
        if box[0] == 0:
            plane[y] = plane[pad]
        if box[1] == ny:
            plane[pad + ny + y] = plane[pad + ny - 1]


@compiled
def log_interpolated(
    h: Singles,
    poses: Singles,
    origin: tuple[float, float, float],
    shape: tuple[int, int],
    corner: tuple[int, int],
    out: Floats,
) -> None:
    """Fill in log h at each pose, h linear between nodes in x, y and θ and constant outside.

    Args:
        h: of some columns and rows of nodes, (H, ·, ·), heading 0 first.
        poses: rows x, y, θ rad, (3, n).
        origin: x and y of the grid's first node, and the way between two.
        shape: numbers of nodes (ny, nx) of the whole grid.
        corner: column and row of the first node of h.
        out: (n,).
    """
    x0, y0, cell = origin
    ny, nx = shape
    headings = h.shape[0]
    for i in range(out.size):
        x = min(max((poses[0, i] - x0) / cell, 0.0), nx - 1.0)
        y = min(max((poses[1, i] - y0) / cell, 0.0), ny - 1.0)
        turns = poses[2, i] / (2.0 * np.pi)
        heading = (turns - np.floor(turns)) * headings
        column, row, first = min(int(x), nx - 2), min(int(y), ny - 2), int(heading)
        fx, fy, part = x - column, y - row, heading - first
        left, low = column - corner[0], row - corner[1]
        value = 0.0
        for plane, share in ((first, 1.0 - part), (first + 1, part)):
            p = h[plane % headings]
            below = p[low, left] * (1.0 - fx) + p[low, left + 1] * fx
            above = p[low + 1, left] * (1.0 - fx) + p[low + 1, left + 1] * fx
            value += share * (below * (1.0 - fy) + above * fy)
        out[i] = log64(value)
