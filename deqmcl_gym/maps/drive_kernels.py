"""The compiled geometry of driving: motion, swept discs, paths, clearance; flat float32 arrays.

Loops run over blocks of ``LANES`` items with the wall outside and the lanes inside, without
branches, so that the compiler turns the inner loop into SIMD code. The arithmetic is IEEE 754's
(see ``deqmcl_gym.numerics``): every processor gives the same bits.

In this order: discs along single moves, one path laid from many poses, and a grid of distances to
walls that decides most steps without looking at them.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import sincos32, wrapped32
from deqmcl_gym.numerics.types import Bools, Ints, Singles

Single = Any  # a float32
LANES = 64
BLOCK = 512

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)


class Clearance(NamedTuple):
    """Bounds on the distance of the squares of a grid around a map to the walls.

    Attributes:
        corner: lower left corner of the grid (x, y).
        per_side: squares per length.
        bounds: least distance of any point of a square to a wall, negative outside free space, 0
            where there may be a wall, (rows, columns).
    """

    corner: Singles
    per_side: np.float32
    bounds: Singles


@compiled
def drive(poses: Singles, moves: Singles, out: Singles) -> None:
    """θ' = θ + turn, wrapped to [-π, π]; (x', y') = (x, y) + R(θ') (forward, left).

    Args:
        poses: rows x, y, θ, (3, n).
        moves: increments, rows forward, left, turn, (3, n).
        out: (3, n), not the memory of the poses.
    """
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
def mounted(poses: Singles, ahead: float, aside: float, out: Singles) -> None:
    """Fill in the poses of a sensor, (x, y) + R(θ) (ahead, aside) and θ, of robots at ``poses``.

    Args:
        poses: rows x, y, θ, (3, n).
        ahead, aside: place of the sensor on the robot, ahead and to the left.
        out: (3, n), not the memory of the poses.
    """
    x, y, heading = poses[0], poses[1], poses[2]
    forward, left = np.float32(ahead), np.float32(aside)
    sincos32(heading, out[1], out[0])
    for i in range(x.size):
        cosine, sine = out[0, i], out[1, i]
        out[0, i] = x[i] + (forward * cosine - left * sine)
        out[1, i] = y[i] + (forward * sine + left * cosine)
        out[2, i] = heading[i]


@compiled
def wind(poses: Singles, walls: Singles, out: Ints) -> None:
    """Fill in the winding number of the walls around each point.

    Args:
        poses: rows x and y (further rows are ignored), (2+, n).
        walls: (x₀, y₀, x₁, y₁), (S, 4).
        out: (n,).
    """
    x, y = poses[0], poses[1]
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
def sweep(starts: Singles, ends: Singles, walls: Singles, out: Singles) -> None:
    """Fill in the squared distance between each path and the nearest wall; 0 if they cross.

    Args:
        starts, ends: rows x and y of the paths' ends (further rows are ignored), (2+, n).
        walls: (x₀, y₀, x₁, y₁), (S, 4).
        out: (n,).
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
        from_x, from_y = starts[0, start : start + count], starts[1, start : start + count]
        to_x, to_y = ends[0, start : start + count], ends[1, start : start + count]
        for i in range(count):
            ax[i] = from_x[i]
            ay[i] = from_y[i]
        for i in range(count):
            dx[i] = to_x[i] - from_x[i]
            dy[i] = to_y[i] - from_y[i]
        for i in range(LANES):
            square = dx[i] * dx[i] + dy[i] * dy[i]
            inverse[i] = _ONE / square if square > _ZERO else _ZERO
        for i in range(LANES):
            best[i] = _INF
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
        least = out[start : start + count]
        for i in range(count):
            least[i] = best[i]


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
def feasible(
    starts: Singles,
    ends: Singles,
    walls: Singles,
    radius: np.float32,
    clearance: tuple[Any, ...],
    out: Bools,
) -> None:
    """Fill in whether a disc swept along each path stays clear of walls and ends in free space.

    Free space is what the walls wind around once. On a path of length d between places a and b away
    from all walls, no point is nearer to them than (a + b - d) / 2: only paths for which the bounds
    do not decide are compared with the walls.

    Args:
        starts, ends, walls: as ``sweep``.
        radius: of the disc.
        clearance: a :class:`Clearance`, as a plain tuple: numba takes it faster.
        out: (n,).
    """
    n = starts.shape[1]
    from_x, from_y, to_x, to_y = starts[0], starts[1], ends[0], ends[1]
    before, after = np.empty(n, np.float32), np.empty(n, np.float32)
    unsure = np.empty(n, np.int32)
    grid = Clearance(*clearance)
    look_up(starts, grid, unsure, before)
    look_up(ends, grid, unsure, after)
    for i in range(n):
        dx, dy = to_x[i] - from_x[i], to_y[i] - from_y[i]
        spare = before[i] + after[i] - (radius + radius)
        out[i] = (spare > _ZERO) & (spare * spare > dx * dx + dy * dy)
    count = 0
    for i in range(n):
        unsure[count] = i
        count += not (out[i] | (after[i] < _ZERO))
    if count == 0:
        return
    some_starts, some_ends = np.empty((2, count), np.float32), np.empty((2, count), np.float32)
    for k in range(count):
        i = unsure[k]
        some_starts[0, k], some_starts[1, k] = from_x[i], from_y[i]
        some_ends[0, k], some_ends[1, k] = to_x[i], to_y[i]
    square = np.empty(count, np.float32)
    windings = np.empty(count, np.int32)
    sweep(some_starts, some_ends, walls, square)
    wind(some_ends, walls, windings)
    limit = radius * radius
    for k in range(count):
        out[unsure[k]] = (square[k] > limit) & (windings[k] == 1)


@compiled
def roll_out(
    poses: Singles,
    moves: Singles,
    walls: Singles,
    radius: np.float32,
    clearance: tuple[Any, ...],
    collisions: Ints,
    out: Singles,
) -> None:
    """Drive poses through several moves; fill in the poses reached and the steps that collide.

    Each block of poses does all moves before the next one, to stay in the processor's cache.

    Args:
        poses: rows x, y, θ, (3, n).
        moves: increments, (F, 3, n); as ``drive``.
        walls, radius, clearance: as ``feasible``.
        collisions: number of steps of each that collide, (n,).
        out: poses after each move, (F, 3, n), or after the last one only, (1, 3, n).
    """
    n = poses.shape[1]
    for start in range(0, n, BLOCK):
        end = min(start + BLOCK, n)
        before, after = poses[:, start:end].copy(), np.empty((3, end - start), np.float32)
        clear = np.empty(end - start, np.bool_)
        hits = collisions[start:end]
        hits[:] = 0
        for step in range(len(moves)):
            drive(before, moves[step, :, start:end], after)
            feasible(before, after, walls, radius, clearance, clear)
            for i in range(end - start):
                hits[i] += not clear[i]
            if len(out) > 1 or step == len(moves) - 1:
                out[step if len(out) > 1 else 0, :, start:end] = after
            before, after = after, before


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
def laid(poses: Singles, path: Singles, out: Singles) -> None:
    """Fill in the points of a path that begins at each pose.

    Args:
        poses: rows x, y, θ, (3, n).
        path: points in the frame of the pose, (k, 2).
        out: rows x, y of each point, (k, 2, n).
    """
    rows = np.empty((4, poses.shape[1]), np.float32)
    directed(poses, rows)
    for k in range(len(path)):
        put(rows, path[k], out[k])


@compiled
def _look_closely(
    paths: Singles, owners: Ints, walls: Singles, radius: np.float32, hits: Ints
) -> None:
    """Count colliding steps, rows x, y, x', y', (4, k), for their ``owners``, (k,)."""
    starts, ends = paths[:2].copy(), paths[2:].copy()
    square, windings = np.empty(owners.size, np.float32), np.empty(owners.size, np.int32)
    sweep(starts, ends, walls, square)
    wind(ends, walls, windings)
    for k in range(owners.size):
        hits[owners[k]] += not ((square[k] > radius * radius) & (windings[k] == 1))


@compiled
def collisions(
    poses: Singles,
    path: Singles,
    walls: Singles,
    radius: np.float32,
    clearance: tuple[Any, ...],
    out: Ints,
) -> None:
    """Fill in the number of steps that collide on a path laid from each pose; see ``feasible``.

    Steps for which the bounds do not decide are compared with the walls, many at a time.

    Args:
        poses: rows x, y, θ, (3, n).
        path: points in the frame of the pose, (k + 1, 2), k ≥ 1.
        walls, radius, clearance: as ``feasible``.
        out: (n,).
    """
    n, grid = poses.shape[1], Clearance(*clearance)
    squares = np.empty(BLOCK, np.int32)
    open_steps, owners = np.empty((4, 2 * BLOCK), np.float32), np.empty(2 * BLOCK, np.int32)
    unsure, chosen = 0, np.empty(BLOCK, np.int32)
    out[:] = 0
    for start in range(0, n, BLOCK):
        size = min(BLOCK, n - start)
        rows, hits = np.empty((4, size), np.float32), out[start : start + size]
        directed(poses[:, start : start + size].copy(), rows)
        here, there = np.empty((2, size), np.float32), np.empty((2, size), np.float32)
        before, after = np.empty(size, np.float32), np.empty(size, np.float32)
        put(rows, path[0], here)
        look_up(here, grid, squares[:size], before)
        for step in range(len(path) - 1):
            put(rows, path[step + 1], there)
            look_up(there, grid, squares[:size], after)
            dx, dy = path[step + 1, 0] - path[step, 0], path[step + 1, 1] - path[step, 1]
            needed = np.sqrt(dx * dx + dy * dy) + (radius + radius)
            for i in range(size):
                hits[i] += after[i] < _ZERO
            count = 0
            for i in range(size):
                chosen[count] = i
                count += not ((before[i] + after[i] > needed) | (after[i] < _ZERO))
            for k in range(count):
                i = chosen[k]
                open_steps[0, unsure + k], open_steps[1, unsure + k] = here[0, i], here[1, i]
                open_steps[2, unsure + k], open_steps[3, unsure + k] = there[0, i], there[1, i]
                owners[unsure + k] = start + i
            unsure += count
            if unsure >= BLOCK:
                _look_closely(open_steps[:, :unsure], owners[:unsure], walls, radius, out)
                unsure = 0
            here, there, before, after = there, here, after, before
    _look_closely(open_steps[:, :unsure], owners[:unsure], walls, radius, out)


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
    sweep(centres, centres, walls, square)
    wind(centres, walls, windings)
    bound = np.maximum(np.sqrt(square) - (side / math.sqrt(2) + margin), 0.0)
    signed = np.where(windings == 1, bound, -bound).astype(np.float32)
    return Clearance(
        corner=np.array(corner, np.float32),
        per_side=np.float32(1 / side),
        bounds=signed.reshape(rows, columns),
    )


def to_nearest(marked: Bools) -> Singles:
    """Distance of each cell's centre to that of the nearest marked cell, in cells; inf if none is.

    Exact up to float32.
    """
    import cv2  # only here: neither maps nor localizers need it to be loaded

    if not marked.any():
        return np.full(marked.shape, np.inf, np.float32)
    elsewhere = np.ascontiguousarray(~marked, np.uint8)
    found = cv2.distanceTransform(elsewhere, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(found, np.float32)
