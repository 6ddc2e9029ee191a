"""The compiled geometry of driving: motion, swept discs, paths, clearance; flat float32 arrays.

Loops run over blocks of ``LANES`` items with the wall outside and the lanes inside, without
branches, so that the compiler turns the inner loop into SIMD code. The arithmetic is IEEE 754's
(see ``deqmcl_gym.numerics``): every processor gives the same bits.

Poses are rows x, y, θ, (3, n), points rows x and y (further ones are ignored), (2+, n), moves rows
forward, left, turn, (3, n), walls (x₀, y₀, x₁, y₁), (S, 4), radii those of the robot's disc.
Kernels fill in their last argument, which must not be the memory of another one.

In this order: discs along single moves, one path laid from many poses, and a grid of distances to
walls that decides most steps without looking at them.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from deqmcl_gym.numerics import Bools, Ints, Reals, Singles
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import sincos32, wrapped32

LANES = 64
POSE_BLOCK = 2048

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)


class Clearance(NamedTuple):
    """Bounds on the distance of the squares of a grid around a map to the walls."""

    corner: Singles  # lower left corner of the grid (x, y)
    per_side: np.float32  # squares per length
    bounds: Singles  # least distance of a square to a wall, < 0 outside, 0 where one may be; 2-d
    slack: np.float32  # by how much a point of a square may be farther from walls than that


@compiled
def drive(poses: Singles, moves: Singles, out: Singles) -> None:
    """θ' = θ + turn, wrapped to [-π, π]; (x', y') = (x, y) + R(θ') (forward, left)."""
    x, y, heading = poses[0], poses[1], poses[2]
    forward, left, turn = moves[0], moves[1], moves[2]
    new_x, new_y, new_heading = out[0], out[1], out[2]
    for i in range(x.size):
        new_heading[i] = wrapped32(heading[i] + turn[i])
    sincos32(new_heading, new_y, new_x)
    for i in range(x.size):
        cosine, sine = new_x[i], new_y[i]
        new_x[i] = x[i] + (forward[i] * cosine - left[i] * sine)
        new_y[i] = y[i] + (forward[i] * sine + left[i] * cosine)


@compiled
def wind(poses: Reals, walls: Reals, out: Ints) -> None:
    """Fill in the winding number of the walls around each point, (n,)."""
    x, y = poses[0], poses[1]
    out[:] = 0
    for wall in range(walls.shape[0]):
        ax, ay, bx, by = walls[wall, 0], walls[wall, 1], walls[wall, 2], walls[wall, 3]
        for i in range(x.size):
            left = (bx - ax) * (y[i] - ay) - (x[i] - ax) * (by - ay)
            up = (ay <= y[i]) & (by > y[i]) & (left > _ZERO)
            down = (ay > y[i]) & (by <= y[i]) & (left < _ZERO)
            out[i] += np.int32(up) - np.int32(down)


@compiled
def square_gaps(starts: Singles, ends: Singles, walls: Singles, out: Singles) -> None:
    """Fill in the squared distance of each path to the nearest wall, (n,); 0 if they cross."""
    n = starts.shape[1]
    ax, ay = np.zeros(LANES, np.float32), np.zeros(LANES, np.float32)
    dx, dy = np.zeros(LANES, np.float32), np.zeros(LANES, np.float32)
    inverse, best = np.zeros(LANES, np.float32), np.empty(LANES, np.float32)
    for start in range(0, n, LANES):
        count = min(LANES, n - start)
        here, there = starts[:, start : start + count], ends[:, start : start + count]
        ax[:count], ay[:count] = here[0], here[1]
        dx[:count], dy[:count] = there[0] - here[0], there[1] - here[1]
        for i in range(LANES):
            square = dx[i] * dx[i] + dy[i] * dy[i]
            inverse[i] = _ONE / square if square > _ZERO else _ZERO
        best[:] = _INF
        for wall in range(walls.shape[0]):
            wx, wy = walls[wall, 0], walls[wall, 1]
            ex, ey = walls[wall, 2] - wx, walls[wall, 3] - wy
            wall_inverse = _ONE / (ex * ex + ey * ey)
            for i in range(LANES):
                px, py = ax[i] - wx, ay[i] - wy  # path start and end, seen from the wall's start
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
        out[start : start + count] = best[:count]


@compiled
def look_up(points: Singles, grid: Clearance, squares: Ints, out: Singles) -> None:
    """Fill in the bound of the square (and its index) that each point is in."""
    rows, columns = grid.bounds.shape
    x, y, left, low = points[0], points[1], grid.corner[0], grid.corner[1]
    per_side = grid.per_side
    last_column, last_row = np.float32(columns - 1), np.float32(rows - 1)
    for i in range(out.size):
        column, row = (x[i] - left) * per_side, (y[i] - low) * per_side
        column = column if column > _ZERO else _ZERO  # also if it is NaN
        row = row if row > _ZERO else _ZERO
        column = column if column < last_column else last_column
        row = row if row < last_row else last_row
        squares[i] = np.int32(row) * np.int32(columns) + np.int32(column)
    flat = grid.bounds.ravel()
    for i in range(out.size):
        out[i] = flat[squares[i]]


@compiled
def put(rows: Singles, point: Singles, out: Singles) -> None:
    """Fill in (x, y) + R(θ) p, (2+, n), for rows x, y, cos θ, sin θ, (4, n)."""
    px, py = point[0], point[1]
    x, y, cosines, sines = rows[0], rows[1], rows[2], rows[3]
    for i in range(x.size):
        out[0, i] = x[i] + (cosines[i] * px - sines[i] * py)
    for i in range(x.size):
        out[1, i] = y[i] + (sines[i] * px + cosines[i] * py)


@compiled
def directed(poses: Singles, out: Singles) -> None:
    """Fill in rows x, y, cos θ, sin θ, (4, n), of poses (3, n)."""
    out[:2] = poses[:2]
    sincos32(poses[2], out[3], out[2])


@compiled
def _undecided(
    here: Singles,
    there: Singles,
    near: Singles,
    next_near: Singles,
    radius: np.float32,
    slack: np.float32,
    hits: Ints,
    chosen: Ints,
) -> int:
    """Count the steps that collide for sure; choose those for which the bounds do not decide."""
    # with ends a and b away from walls and a length d between them, no point of a path is nearer
    # to them than half of a + b - d
    n = near.size
    x, y, to_x, to_y = here[0], here[1], there[0], there[1]
    unsure = np.empty(n, np.bool_)
    for i in range(n):
        dx, dy = to_x[i] - x[i], to_y[i] - y[i]
        spare = near[i] + next_near[i] - (radius + radius)
        clear = (spare > _ZERO) & (spare * spare > dx * dx + dy * dy)
        touched = min(abs(near[i]), abs(next_near[i])) + slack < radius
        hit = touched | (next_near[i] < _ZERO)
        hits[i] += hit
        unsure[i] = not (hit | clear)
    count = 0
    for i in range(n):
        chosen[count] = i
        count += unsure[i]
    return count


@compiled
def _put_off(
    here: Singles, there: Singles, chosen: Ints, first: int, late: Singles, owners: Ints, held: int
) -> None:
    """Fill in rows x, y, x', y' of the chosen steps behind those ``held``, and their owners."""
    for k in range(chosen.size):
        i = chosen[k]
        late[0, held + k], late[1, held + k] = here[0, i], here[1, i]
        late[2, held + k], late[3, held + k] = there[0, i], there[1, i]
        owners[held + k] = first + i


@compiled
def _look_closely(
    late: Singles, owners: Ints, held: int, walls: Singles, radius: np.float32, hits: Ints
) -> None:
    """Count which of the steps ``held``, rows x, y, x', y', collide, for their ``owners``."""
    ends = late[:, :held].copy()
    square, windings = np.empty(held, np.float32), np.empty(held, np.int32)
    square_gaps(ends[:2], ends[2:], walls, square)
    wind(ends[2:], walls, windings)
    for k in range(held):
        hits[owners[k]] += not ((square[k] > radius * radius) & (windings[k] == 1))


@compiled
def feasible(
    starts: Singles,
    ends: Singles,
    walls: Singles,
    radius: np.float32,
    clearance: tuple[Any, ...],
    out: Bools,
) -> None:
    """Fill in whether a disc swept along each path stays clear of walls and ends in free space.

    Free space is what the walls wind around once. Only paths for which the bounds of a
    :class:`Clearance` (as a plain tuple: numba takes it faster) do not decide are compared with the
    walls.
    """
    n, grid = starts.shape[1], Clearance(*clearance)
    near, next_near = np.empty(n, np.float32), np.empty(n, np.float32)
    chosen, hits = np.empty(n, np.int32), np.zeros(n, np.int32)
    look_up(starts, grid, chosen, near)
    look_up(ends, grid, chosen, next_near)
    count = _undecided(starts, ends, near, next_near, radius, grid.slack, hits, chosen)
    if count > 0:
        late, owners = np.empty((4, count), np.float32), np.empty(count, np.int32)
        _put_off(starts, ends, chosen[:count], 0, late, owners, 0)
        _look_closely(late, owners, count, walls, radius, hits)
    out[:] = hits == 0


@compiled
def collisions_along(
    poses: Singles,
    path: Singles,
    walls: Singles,
    radius: np.float32,
    clearance: tuple[Any, ...],
    hits: Ints,
) -> None:
    """Fill in how many steps of a path (F + 1, 2), laid from each pose, collide; as ``feasible``.

    Each block of poses takes all steps before the next one, to stay in the processor's cache. Steps
    for which the bounds do not decide are compared with the walls, many at a time.
    """
    n, grid, slack = poses.shape[1], Clearance(*clearance), clearance[3]
    squares, chosen = np.empty(POSE_BLOCK, np.int32), np.empty(POSE_BLOCK, np.int32)
    late, owners = np.empty((4, 2 * POSE_BLOCK), np.float32), np.empty(2 * POSE_BLOCK, np.int32)
    unsure = 0
    hits[:] = 0
    for start in range(0, n, POSE_BLOCK):
        size = min(POSE_BLOCK, n - start)
        touched, rows = hits[start : start + size], np.empty((4, size), np.float32)
        here, there = np.empty((2, size), np.float32), np.empty((2, size), np.float32)
        near, next_near = np.empty(size, np.float32), np.empty(size, np.float32)
        directed(poses[:, start : start + size].copy(), rows)
        put(rows, path[0], here)
        look_up(here, grid, squares[:size], near)
        for place in path[1:]:
            put(rows, place, there)
            look_up(there, grid, squares[:size], next_near)
            count = _undecided(here, there, near, next_near, radius, slack, touched, chosen)
            _put_off(here, there, chosen[:count], start, late, owners, unsure)
            unsure += count
            if unsure >= POSE_BLOCK:
                _look_closely(late, owners, unsure, walls, radius, hits)
                unsure = 0
            here, there, near, next_near = there, here, next_near, near
    _look_closely(late, owners, unsure, walls, radius, hits)


_SQUARES = 8192  # a few px wide in a room; 32 KiB, which stays in the processor's first cache
# Share of the map's size that is subtracted from every bound. float32 resolves coordinates to 6e-8
# of it, and a distance to a wall takes only a few operations on them.
_MARGIN = 1e-4


def clearance_of(walls: Singles) -> Clearance:
    """Return the clearance of a map with walls (x₀, y₀, x₁, y₁), (S, 4).

    A ring of squares of its grid is outside the map.
    """
    x, y = walls[:, [0, 2]].astype(np.float64), walls[:, [1, 3]].astype(np.float64)
    width, height = float(np.ptp(x)), float(np.ptp(y))
    side = math.sqrt(width * height / _SQUARES)
    margin = _MARGIN * max(float(np.abs(x).max()), float(np.abs(y).max()), width, height)
    # Points beyond the grid count as in the ring: the ring keeps clear of the walls.
    corner = float(x.min()) - side - 2 * margin, float(y.min()) - side - 2 * margin
    columns, rows = (math.ceil((length + 4 * margin) / side) + 2 for length in (width, height))
    centre_x = corner[0] + (np.arange(columns) + 0.5) * side
    centre_y = corner[1] + (np.arange(rows) + 0.5) * side
    centres = np.array([g.ravel() for g in np.meshgrid(centre_x, centre_y)]).astype(np.float32)
    square, windings = np.empty(centres.shape[1], np.float32), np.empty(centres.shape[1], np.int32)
    square_gaps(centres, centres, walls, square)
    wind(centres, walls, windings)
    bound = np.maximum(np.sqrt(square) - (side / math.sqrt(2) + margin), 0.0)
    signed = np.where(windings == 1, bound, -bound).astype(np.float32)
    return Clearance(
        corner=np.array(corner, np.float32),
        per_side=np.float32(1 / side),
        bounds=signed.reshape(rows, columns),
        slack=np.float32(math.sqrt(2) * side + 3 * margin),
    )


def to_nearest(marked: Bools) -> Singles:
    """Exact distance of each cell's centre to the nearest marked one's, in cells; inf: none is."""
    import cv2  # only here: neither maps nor localizers need it to be loaded

    if not marked.any():
        return np.full(marked.shape, np.inf, np.float32)
    elsewhere = np.ascontiguousarray(~marked, np.uint8)
    nearest = cv2.distanceTransform(elsewhere, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(nearest, np.float32)
