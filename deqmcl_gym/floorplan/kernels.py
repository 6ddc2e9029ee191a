"""The compiled geometry: driving, ray casting, swept discs, point location; flat float32 arrays.

Loops run over blocks of ``LANES`` items with the wall outside and the lanes inside, without
branches, so that the compiler turns the inner loop into SIMD code. The arithmetic is IEEE 754's
(see ``deqmcl_gym.numerics``): every processor gives the same bits.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos32, sin32

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]
Single = Any  # a float32
LANES = 64
BLOCK = 512
_RAYS = 256  # of one beam cast in one go: what one of them needs fits the fastest cache

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_TINY = np.float32(1e-12)
_NAN = np.float32(np.nan)
_TURN = np.float32(2 * np.pi)
_PER_TURN = np.float32(1 / (2 * np.pi))
_ROUNDER = np.float32(12582912.0)  # 1.5 * 2**23: adding and subtracting it rounds


@compiled
def drive(poses: Floats, distances: Floats, turns: Floats, out: Floats) -> None:
    """θ' = θ + turn, wrapped to [-π, π]; (x', y') = (x, y) + distance (cos θ', sin θ').

    Args:
        poses: rows x px, y px, θ rad, (3, n).
        distances, turns: (n,) px, rad.
        out: (3, n).
    """
    x, y, heading = poses[0], poses[1], poses[2]
    new_x, new_y, new_heading = out[0], out[1], out[2]
    for i in range(x.size):
        angle = heading[i] + turns[i]
        angle -= _TURN * ((angle * _PER_TURN + _ROUNDER) - _ROUNDER)
        new_heading[i] = angle
    for i in range(x.size):
        new_x[i] = x[i] + distances[i] * cos32(new_heading[i])
    for i in range(x.size):
        new_y[i] = y[i] + distances[i] * sin32(new_heading[i])


@compiled
def _blind(poses: Floats, outer: Floats, out: Floats) -> None:
    """Overwrite by NaN the ranges (B, n) of poses outside the outer wall (S, 4)."""
    windings = np.empty(poses.shape[1], np.int32)
    wind(poses, outer, windings)
    for i in range(windings.size):
        if windings[i] != 1:
            for beam in range(out.shape[0]):
                out[beam, i] = _NAN


# Single rays, from (x, y) along (dx, dy); per_dx = 1 / dx. Each returns the shorter of ``best`` and
# the distance to one obstacle, so that a loop over lanes stays free of branches.


@compiled
def _leave(
    low_x: Single,
    low_y: Single,
    high_x: Single,
    high_y: Single,
    x: Single,
    y: Single,
    per_dx: Single,
    per_dy: Single,
    best: Single,
) -> Single:
    """Where a ray leaves the rectangle that it starts in."""
    leave_x = ((high_x if per_dx > _ZERO else low_x) - x) * per_dx
    leave_y = ((high_y if per_dy > _ZERO else low_y) - y) * per_dy
    t = leave_x if leave_x < leave_y else leave_y
    return t if (t >= _ZERO) & (t < best) else best


@compiled
def _enter(
    low_x: Single,
    low_y: Single,
    high_x: Single,
    high_y: Single,
    x: Single,
    y: Single,
    per_dx: Single,
    per_dy: Single,
    best: Single,
) -> Single:
    """Where a ray enters a rectangle, or leaves it: the slab method of Kay & Kajiya (1986)."""
    right, up = per_dx > _ZERO, per_dy > _ZERO
    enter_x = ((low_x if right else high_x) - x) * per_dx
    leave_x = ((high_x if right else low_x) - x) * per_dx
    enter_y = ((low_y if up else high_y) - y) * per_dy
    leave_y = ((high_y if up else low_y) - y) * per_dy
    enter = enter_x if enter_x > enter_y else enter_y
    leave = leave_x if leave_x < leave_y else leave_y
    t = enter if enter >= _ZERO else leave
    return t if (t >= _ZERO) & (leave >= enter) & (t < best) else best


@compiled
def _cross(
    at: Single,
    low: Single,
    high: Single,
    across: Single,
    along: Single,
    per: Single,
    slope: Single,
    best: Single,
) -> Single:
    """Where a ray crosses a wall that is parallel to an axis."""
    t = (at - across) * per
    u = along + t * slope
    return t if (t >= _ZERO) & (u >= low) & (u <= high) & (t < best) else best


@compiled
def _meet(
    ax: Single,
    ay: Single,
    ex: Single,
    ey: Single,
    low: Single,
    high: Single,
    x: Single,
    y: Single,
    dx: Single,
    dy: Single,
    best: Single,
) -> Single:
    """Where a ray meets a wall of any direction (ex, ey)."""
    rx, ry = ax - x, ay - y
    t = (rx * ey - ry * ex) / (dx * ey - dy * ex)
    u = (t * dx - rx) * ex + (t * dy - ry) * ey
    return t if (t >= _ZERO) & (u >= low) & (u <= high) & (t < best) else best


@compiled
def cast(
    poses: Floats,
    bearings: Floats,
    outer: Floats,
    rooms: Floats,
    boxes: Floats,
    upright: Floats,
    level: Floats,
    oblique: Floats,
    out: Floats,
) -> None:
    """Fill in the distance along each beam to the nearest wall; NaN outside the outer wall.

    Args:
        poses: rows x px, y px, θ rad, (3, n).
        bearings: of the beams against the heading, (B,) rad.
        outer: the outer wall (x₀, y₀, x₁, y₁), free space to its left, (S, 4) px.
        rooms: axis-aligned rectangles (x_low, y_low, x_high, y_high) that poses are in, (S₋, 4) px;
            from outside, they are not seen aright.
        boxes: others, seen from outside and from inside, (S₀, 4) px; four walls each.
        upright: other walls x = c as (c, y_low, y_high), (S₁, 3) px.
        level: other walls y = c as (c, x_low, x_high), (S₂, 3) px.
        oblique: all others as (x₀, y₀, unit x, unit y, low, high), (S₃, 6): start, direction, and
            the stretch of it that is wall.
        out: (B, n) px.
    """
    sine, cosine = np.empty(_RAYS, np.float32), np.empty(_RAYS, np.float32)
    dx, dy = np.empty(_RAYS, np.float32), np.empty(_RAYS, np.float32)
    per_dx, per_dy = np.empty(_RAYS, np.float32), np.empty(_RAYS, np.float32)
    beam_sine = np.empty(bearings.size, np.float32)
    beam_cosine = np.empty(bearings.size, np.float32)
    for beam in range(bearings.size):
        beam_sine[beam], beam_cosine[beam] = sin32(bearings[beam]), cos32(bearings[beam])
    n = poses.shape[1]
    for start in range(0, n, _RAYS):
        count = min(_RAYS, n - start)
        end = start + count
        px, py, headings = poses[0, start:end], poses[1, start:end], poses[2, start:end]
        for i in range(count):
            sine[i] = sin32(headings[i])
        for i in range(count):
            cosine[i] = cos32(headings[i])
        for beam in range(bearings.size):
            bs, bc = beam_sine[beam], beam_cosine[beam]
            best = out[beam, start:end]
            for i in range(count):
                dx[i] = cosine[i] * bc - sine[i] * bs
            for i in range(count):
                dy[i] = sine[i] * bc + cosine[i] * bs
            for i in range(count):  # a beam along an axis keeps a slope: no 0 · inf below
                per_dx[i] = _ONE / (dx[i] if abs(dx[i]) > _TINY else _TINY)
            for i in range(count):
                per_dy[i] = _ONE / (dy[i] if abs(dy[i]) > _TINY else _TINY)
            for i in range(count):
                best[i] = _INF
            for room in range(rooms.shape[0]):
                low_x, low_y, high_x, high_y = rooms[room]
                for i in range(count):
                    best[i] = _leave(
                        low_x, low_y, high_x, high_y, px[i], py[i], per_dx[i], per_dy[i], best[i]
                    )
            for box in range(boxes.shape[0]):
                low_x, low_y, high_x, high_y = boxes[box]
                for i in range(count):
                    best[i] = _enter(
                        low_x, low_y, high_x, high_y, px[i], py[i], per_dx[i], per_dy[i], best[i]
                    )
            for wall in range(upright.shape[0]):
                at, low, high = upright[wall]
                for i in range(count):
                    best[i] = _cross(at, low, high, px[i], py[i], per_dx[i], dy[i], best[i])
            for wall in range(level.shape[0]):
                at, low, high = level[wall]
                for i in range(count):
                    best[i] = _cross(at, low, high, py[i], px[i], per_dy[i], dx[i], best[i])
            for wall in range(oblique.shape[0]):
                ax, ay, ex, ey, low, high = oblique[wall]
                for i in range(count):
                    best[i] = _meet(ax, ay, ex, ey, low, high, px[i], py[i], dx[i], dy[i], best[i])
    _blind(poses, outer, out)


@compiled
def look(
    poses: Floats,
    bearings: Floats,
    outer: Floats,
    rooms: Floats,
    boxes: Floats,
    upright: Floats,
    level: Floats,
    oblique: Floats,
    out: Floats,
) -> None:
    """Do the same as ``cast``, with the lanes over the beams: for a handful of poses."""
    beams = bearings.size
    dx, dy = np.empty(beams, np.float32), np.empty(beams, np.float32)
    per_dx, per_dy = np.empty(beams, np.float32), np.empty(beams, np.float32)
    best = np.empty(beams, np.float32)
    for pose in range(poses.shape[1]):
        px, py = poses[0, pose], poses[1, pose]
        sine, cosine = sin32(poses[2, pose]), cos32(poses[2, pose])
        for i in range(beams):
            bs, bc = sin32(bearings[i]), cos32(bearings[i])
            dx[i] = cosine * bc - sine * bs
            dy[i] = sine * bc + cosine * bs
        for i in range(beams):
            per_dx[i] = _ONE / (dx[i] if abs(dx[i]) > _TINY else _TINY)
            per_dy[i] = _ONE / (dy[i] if abs(dy[i]) > _TINY else _TINY)
            best[i] = _INF
        for room in range(rooms.shape[0]):
            low_x, low_y, high_x, high_y = rooms[room]
            for i in range(beams):
                best[i] = _leave(
                    low_x, low_y, high_x, high_y, px, py, per_dx[i], per_dy[i], best[i]
                )
        for box in range(boxes.shape[0]):
            low_x, low_y, high_x, high_y = boxes[box]
            for i in range(beams):
                best[i] = _enter(
                    low_x, low_y, high_x, high_y, px, py, per_dx[i], per_dy[i], best[i]
                )
        for wall in range(upright.shape[0]):
            at, low, high = upright[wall]
            for i in range(beams):
                best[i] = _cross(at, low, high, px, py, per_dx[i], dy[i], best[i])
        for wall in range(level.shape[0]):
            at, low, high = level[wall]
            for i in range(beams):
                best[i] = _cross(at, low, high, py, px, per_dy[i], dx[i], best[i])
        for wall in range(oblique.shape[0]):
            ax, ay, ex, ey, low, high = oblique[wall]
            for i in range(beams):
                best[i] = _meet(ax, ay, ex, ey, low, high, px, py, dx[i], dy[i], best[i])
        for i in range(beams):
            out[i, pose] = best[i]
    _blind(poses, outer, out)


@compiled
def cast_through(
    poses: Floats,
    bearings: Floats,
    outer: Floats,
    walls: Floats,
    corner: Floats,
    side: np.float32,
    columns: int,
    first: Ints,
    members: Ints,
    out: Floats,
) -> None:
    """Fill in the distance along each beam to the nearest wall, walking from cell to cell.

    Amanatides & Woo 1987. A ray at a time: its cost is that of the cells it crosses, not of all
    walls. NaN outside the outer wall.

    Args:
        poses: rows x px, y px, θ rad, (3, n).
        bearings: of the beams against the heading, (B,) rad.
        outer: as for ``cast``.
        walls: (x₀, y₀, unit x, unit y, low, high), (S, 6), as ``oblique`` of ``cast``.
        corner, side, columns, first, members: ``deqmcl_gym.floorplan.cells.Cells``.
        out: (B, n) px.
    """
    rows = (first.size - 1) // columns
    per_side = _ONE / side
    for i in range(poses.shape[1]):
        px, py = poses[0, i] - corner[0], poses[1, i] - corner[1]
        column_i, row_i = int(np.floor(px * per_side)), int(np.floor(py * per_side))
        within = (column_i >= 0) & (column_i < columns) & (row_i >= 0) & (row_i < rows)
        for beam in range(bearings.size):
            angle = poses[2, i] + bearings[beam]
            dx, dy = cos32(angle), sin32(angle)
            per_dx = _ONE / (dx if abs(dx) > _TINY else _TINY)
            per_dy = _ONE / (dy if abs(dy) > _TINY else _TINY)
            column, row, best = column_i, row_i, _INF
            walking = within
            while walking:
                cell = row * columns + column
                for k in range(first[cell], first[cell + 1]):
                    ax, ay, ex, ey, low, high = walls[members[k]]
                    best = _meet(ax, ay, ex, ey, low, high, poses[0, i], poses[1, i], dx, dy, best)
                ahead_x = np.float32(column + (1 if per_dx > _ZERO else 0)) * side
                ahead_y = np.float32(row + (1 if per_dy > _ZERO else 0)) * side
                to_x, to_y = (ahead_x - px) * per_dx, (ahead_y - py) * per_dy
                if to_x < to_y:
                    column += 1 if per_dx > _ZERO else -1
                else:
                    row += 1 if per_dy > _ZERO else -1
                walking = (best > min(to_x, to_y)) & (column >= 0) & (column < columns)
                walking = walking & (row >= 0) & (row < rows)
            out[beam, i] = best
    _blind(poses, outer, out)


@compiled
def wind(poses: Floats, walls: Floats, out: Ints) -> None:
    """Fill in how often the walls wind counterclockwise around each point.

    Args:
        poses: rows x px and y px (further rows are ignored), (2+, n).
        walls: (x₀, y₀, x₁, y₁), (S, 4) px.
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
def sweep(starts: Floats, ends: Floats, walls: Floats, out: Floats) -> None:
    """Fill in the squared distance between each path and the nearest wall; 0 if they cross.

    Args:
        starts, ends: rows x px and y px of the paths' ends (further rows are ignored), (2+, n).
        walls: (x₀, y₀, x₁, y₁), (S, 4) px.
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
def _look_up(
    points: Floats, corner: Floats, per_side: Single, bounds: Floats, squares: Ints, out: Floats
) -> None:
    """Fill in the bound of the square (and its index) that each point is in; see ``Clearance``."""
    rows, columns = bounds.shape
    x, y, left, low = points[0], points[1], corner[0], corner[1]
    last_column, last_row = np.float32(columns - 1), np.float32(rows - 1)
    for i in range(out.size):
        column, row = (x[i] - left) * per_side, (y[i] - low) * per_side
        column = column if column > _ZERO else _ZERO  # also if it is NaN
        row = row if row > _ZERO else _ZERO
        column = column if column < last_column else last_column
        row = row if row < last_row else last_row
        squares[i] = np.int32(row) * np.int32(columns) + np.int32(column)
    flat = bounds.ravel()
    for i in range(out.size):
        out[i] = flat[squares[i]]


@compiled
def feasible(
    starts: Floats,
    ends: Floats,
    walls: Floats,
    radius: np.float32,
    corner: Floats,
    per_side: np.float32,
    bounds: Floats,
    out: NDArray[np.bool_],
) -> None:
    """Fill in whether a disc swept along each path stays clear of walls and ends in free space.

    Free space is what the walls wind around once. No point of a path of length d between places a
    and b away from all walls is nearer to them than (a + b - d) / 2: only where the bounds leave
    it open are the walls looked at.

    Args:
        starts, ends, walls: as ``sweep``.
        radius: px.
        corner, per_side, bounds: ``deqmcl_gym.floorplan.clearance.Clearance``.
        out: (n,).
    """
    n = starts.shape[1]
    from_x, from_y, to_x, to_y = starts[0], starts[1], ends[0], ends[1]
    before, after = np.empty(n, np.float32), np.empty(n, np.float32)
    unsure = np.empty(n, np.int32)
    _look_up(starts, corner, per_side, bounds, unsure, before)
    _look_up(ends, corner, per_side, bounds, unsure, after)
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
    poses: Floats,
    moves: Floats,
    walls: Floats,
    radius: np.float32,
    corner: Floats,
    per_side: np.float32,
    bounds: Floats,
    collisions: Ints,
    out: Floats,
) -> None:
    """Drive poses through several moves; fill in where they come to and which steps collide.

    A block of poses at a time goes all the way, so that it stays in the processor's cache.

    Args:
        poses: rows x px, y px, θ rad, (3, n).
        moves: distances and turns, (F, 2, n) px, rad; as ``drive``.
        walls, radius, corner, per_side, bounds: as ``feasible``.
        collisions: how many steps of each collide, (n,).
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
            drive(before, moves[step, 0, start:end], moves[step, 1, start:end], after)
            feasible(before, after, walls, radius, corner, per_side, bounds, clear)
            for i in range(end - start):
                hits[i] += not clear[i]
            if len(out) > 1 or step == len(moves) - 1:
                out[step if len(out) > 1 else 0, :, start:end] = after
            before, after = after, before
