"""The compiled geometry: sines, ray casting, swept discs, point location, over flat float32 arrays.

Loops run over blocks of ``LANES`` items with the wall outside and the lanes inside, without
branches, so that the compiler turns the inner loop into SIMD code. Only +, -, *, / and comparisons
in float32 are used: IEEE 754 fixes their results, so every processor gives the same bits.

Walls arrive as rows (x0, y0, x1, y1), oriented so that free space lies to their left.
"""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.floorplan.compiling import compiled

Floats = NDArray[np.float32]
LANES = 64

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
# Walls are cast this much longer at both ends, so that no ray slips between two at their corner.
_OVERLAP = np.float32(5e-4)

# sin and cos on [-π/4, π/4] after reduction by multiples of π/2 (Cody & Waite 1980; minimax
# coefficients as in Moshier's Cephes library, single precision).
_TWO_OVER_PI = np.float32(2 / np.pi)
_ROUNDER = np.float32(12582912.0)  # 1.5 * 2**23: adding it rounds to the nearest integer
_PIO2_HIGH = np.float32(1.5703125)
_PIO2_MIDDLE = np.float32(4.837512969970703125e-4)
_PIO2_LOW = np.float32(7.54978995489188216e-8)
_S1, _S2, _S3 = (
    np.float32(-1.6666654611e-1),
    np.float32(8.3321608736e-3),
    np.float32(-1.9515295891e-4),
)
_C1, _C2, _C3 = (
    np.float32(4.166664568298827e-2),
    np.float32(-1.388731625493765e-3),
    np.float32(2.443315711809948e-5),
)
_HALF = np.float32(0.5)


@compiled
def sincos(angles: Floats, sines: Floats, cosines: Floats) -> None:
    """Fill in sin and cos of ``angles`` (rad, |angle| < 1000), to about 1e-7."""
    for i in range(angles.size):
        turns = (angles[i] * _TWO_OVER_PI + _ROUNDER) - _ROUNDER
        r = ((angles[i] - turns * _PIO2_HIGH) - turns * _PIO2_MIDDLE) - turns * _PIO2_LOW
        z = r * r
        sine = ((_S3 * z + _S2) * z + _S1) * z * r + r
        cosine = ((_C3 * z + _C2) * z + _C1) * z * z - _HALF * z + _ONE
        quadrant = np.int32(turns) & np.int32(3)
        odd = (quadrant & np.int32(1)) != 0
        s = cosine if odd else sine
        c = sine if odd else cosine
        sines[i] = -s if quadrant >= np.int32(2) else s
        cosines[i] = -c if (quadrant == np.int32(1)) or (quadrant == np.int32(2)) else c


@compiled
def cast(
    x: Floats, y: Floats, sines: Floats, cosines: Floats, beams: Floats, walls: Floats, out: Floats
) -> None:
    """Fill in the distance along each beam to the nearest wall, inf where there is none.

    Args:
        x, y: origins, (n,) px.
        sines, cosines: of the headings, (n,).
        beams: (sin, cos) of the bearings, (2, B).
        walls: (S, 4) px.
        out: (B, n) px.
    """
    px = np.zeros(LANES, np.float32)
    py = np.zeros(LANES, np.float32)
    dx = np.ones(LANES, np.float32)
    dy = np.zeros(LANES, np.float32)
    best = np.empty(LANES, np.float32)
    for beam in range(beams.shape[1]):
        bs, bc = beams[0, beam], beams[1, beam]
        for start in range(0, x.size, LANES):
            count = min(LANES, x.size - start)
            for i in range(count):
                j = start + i
                px[i] = x[j]
                py[i] = y[j]
                dx[i] = cosines[j] * bc - sines[j] * bs
                dy[i] = sines[j] * bc + cosines[j] * bs
            for i in range(LANES):
                best[i] = _INF
            for wall in range(walls.shape[0]):
                ax, ay = walls[wall, 0], walls[wall, 1]
                ex, ey = walls[wall, 2] - ax, walls[wall, 3] - ay
                length = np.float32(np.sqrt(ex * ex + ey * ey))
                ex, ey = ex / length, ey / length
                far = length + _OVERLAP
                for i in range(LANES):
                    rx = ax - px[i]
                    ry = ay - py[i]
                    t = (rx * ey - ry * ex) / (dx[i] * ey - dy[i] * ex)
                    u = (t * dx[i] - rx) * ex + (t * dy[i] - ry) * ey
                    hit = (t >= _ZERO) & (u >= -_OVERLAP) & (u <= far) & (t < best[i])
                    best[i] = t if hit else best[i]
            for i in range(count):
                out[beam, start + i] = best[i]


@compiled
def windings(x: Floats, y: Floats, walls: Floats, out: NDArray[np.int32]) -> None:
    """Fill in how often the walls wind counterclockwise around each point, (n,)."""
    for i in range(x.size):
        out[i] = 0
    for wall in range(walls.shape[0]):
        ax, ay, bx, by = walls[wall, 0], walls[wall, 1], walls[wall, 2], walls[wall, 3]
        for i in range(x.size):
            left = (bx - ax) * (y[i] - ay) - (x[i] - ax) * (by - ay)
            up = (ay <= y[i]) & (by > y[i]) & (left > _ZERO)
            down = (ay > y[i]) & (by <= y[i]) & (left < _ZERO)
            out[i] += np.int32(up) - np.int32(down)


@compiled
def sweep(starts: Floats, ends: Floats, walls: Floats, out: Floats) -> None:
    """Fill in the squared distance between each path and the nearest wall; 0 if they cross.

    Args:
        starts, ends: rows x and y of the paths' end points, (2, n) px.
        walls: (S, 4) px.
        out: (n,) px².
    """
    n = starts.shape[1]
    ax = np.zeros(LANES, np.float32)
    ay = np.zeros(LANES, np.float32)
    dx = np.zeros(LANES, np.float32)
    dy = np.zeros(LANES, np.float32)
    inverse = np.zeros(LANES, np.float32)
    best = np.empty(LANES, np.float32)
    for start in range(0, n, LANES):
        count = min(LANES, n - start)
        for i in range(count):
            j = start + i
            ax[i] = starts[0, j]
            ay[i] = starts[1, j]
            dx[i] = ends[0, j] - starts[0, j]
            dy[i] = ends[1, j] - starts[1, j]
            square = dx[i] * dx[i] + dy[i] * dy[i]
            inverse[i] = _ONE / square if square > _ZERO else _ZERO
        for i in range(LANES):
            best[i] = _INF
        for wall in range(walls.shape[0]):
            wx, wy = walls[wall, 0], walls[wall, 1]
            ex, ey = walls[wall, 2] - wx, walls[wall, 3] - wy
            wall_inverse = _ONE / (ex * ex + ey * ey)
            for i in range(LANES):
                px, py = ax[i] - wx, ay[i] - wy  # path start, end; wall end: seen from wall start
                qx, qy = px + dx[i], py + dy[i]
                # path ends to the wall
                u = min(max((px * ex + py * ey) * wall_inverse, _ZERO), _ONE)
                near = (px - u * ex) * (px - u * ex) + (py - u * ey) * (py - u * ey)
                u = min(max((qx * ex + qy * ey) * wall_inverse, _ZERO), _ONE)
                near = min(near, (qx - u * ex) * (qx - u * ex) + (qy - u * ey) * (qy - u * ey))
                # wall ends to the path
                u = min(max(-(px * dx[i] + py * dy[i]) * inverse[i], _ZERO), _ONE)
                hx, hy = px + u * dx[i], py + u * dy[i]
                near = min(near, hx * hx + hy * hy)
                hx, hy = px - ex, py - ey
                u = min(max(-(hx * dx[i] + hy * dy[i]) * inverse[i], _ZERO), _ONE)
                hx, hy = hx + u * dx[i], hy + u * dy[i]
                near = min(near, hx * hx + hy * hy)
                # both cross each other's line
                side_p, side_q = ex * py - ey * px, ex * qy - ey * qx
                side_a = dx[i] * (-py) - dy[i] * (-px)
                side_b = dx[i] * (ey - py) - dy[i] * (ex - px)
                crossing = (side_p * side_q < _ZERO) & (side_a * side_b < _ZERO)
                near = _ZERO if crossing else near
                best[i] = min(best[i], near)
        for i in range(count):
            out[start + i] = best[i]
