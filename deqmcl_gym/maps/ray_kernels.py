"""Compiled ray casting among walls and among cells; flat float32 arrays.

Loops run over blocks of poses with the wall outside and the lanes inside, without branches, so that
the compiler turns the inner loop into SIMD code. The arithmetic is IEEE 754's (see
``deqmcl_gym.numerics``): every processor gives the same bits.

A ray starts at (x, y) and goes along (dx, dy); per_dx = 1 / dx.

Among cells, positions are in cells: square (i, j) of a table is [i, i + 1] × [j, j + 1]. The
*reach* of a cell says how many cells away, along an axis or a diagonal, the nearest one is that is
not open; its own is 0 then. The cells along the edge of a table are never open, so that nothing
walks off it. From a cell of reach m a ray strides to the edge of the square of 2 m - 1 open cells
around it. Its cells are kept in whole numbers, so that no rounding error leads past one.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.maps.drive_kernels import wind
from deqmcl_gym.numerics import Bools, Single, Singles
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import sincos32

_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
_TINY, _INF, _NAN = np.float32(1e-12), np.float32(np.inf), np.float32(np.nan)


@compiled
def _less(a: Single, b: Single) -> Single:
    return a if a < b else b


@compiled
def _more(a: Single, b: Single) -> Single:
    return a if a > b else b


@compiled
def inverse(slope: Single) -> Single:
    """1 / slope; a beam along an axis gets a tiny slope, so that 0 · inf cannot occur."""
    return _ONE / (slope if abs(slope) > _TINY else _TINY)


Rectangle = Singles  # (x_low, y_low, x_high, y_high)
_RAYS = 512  # of one beam cast at a time: their data fit the fastest cache


class AllWalls(NamedTuple):
    """All walls, sorted by direction."""

    outer: Singles  # the outer wall (x₀, y₀, x₁, y₁), free space to its left, (S, 4)
    room: Rectangle  # that all poses are in; infinite if the outer wall is not a rectangle
    boxes: Singles  # rectangles seen from outside and from inside, (S₀, 4)
    upright: Singles  # other walls x = c as (c, y_low, y_high), (S₁, 3)
    level: Singles  # other walls y = c as (c, x_low, x_high), (S₂, 3)
    oblique: Singles  # others: start, direction and extent along it, (S₃, 6)


@compiled
def _inside(poses: Singles, outer: Singles, room: Rectangle) -> Bools:
    """Which poses (3, n) have a finite heading and are inside the outer wall or ``room``."""
    x, y, heading = poses[0], poses[1], poses[2]
    left, low, right, high = room
    inside = np.empty(x.size, np.bool_)
    if left == -_INF:
        windings = np.empty(x.size, np.int32)
        wind(poses, outer, windings)
        inside[:] = windings == 1
    else:
        for i in range(inside.size):  # points on walls as in ``wind``
            inside[i] = (x[i] >= left) & (x[i] < right) & (y[i] >= low) & (y[i] < high)
    for i in range(inside.size):
        inside[i] &= abs(heading[i]) < _INF
    return inside


@compiled
def _shorten(
    x: Singles,
    y: Singles,
    dx: Singles,
    dy: Singles,
    per_dx: Singles,
    per_dy: Singles,
    walls: AllWalls,
    best: Singles,
) -> None:
    """Shorten rays, (n,), to the nearest of all walls but ``room``."""
    for other in range(walls.boxes.shape[0]):
        left, low, right, high = walls.boxes[other]
        for i in range(best.size):  # enters it, or leaves it: the slabs of Kay & Kajiya (1986)
            to_left, to_right = (left - x[i]) * per_dx[i], (right - x[i]) * per_dx[i]
            to_low, to_high = (low - y[i]) * per_dy[i], (high - y[i]) * per_dy[i]
            enter = _more(_less(to_left, to_right), _less(to_low, to_high))
            leave = _less(_more(to_left, to_right), _more(to_low, to_high))
            t = enter if enter >= _ZERO else leave
            best[i] = t if (t >= _ZERO) & (leave >= enter) & (t < best[i]) else best[i]
    for wall in range(walls.upright.shape[0]):
        at, low, high = walls.upright[wall]
        for i in range(best.size):
            t = (at - x[i]) * per_dx[i]
            u = y[i] + t * dy[i]
            best[i] = t if (t >= _ZERO) & (u >= low) & (u <= high) & (t < best[i]) else best[i]
    for wall in range(walls.level.shape[0]):
        at, low, high = walls.level[wall]
        for i in range(best.size):
            t = (at - y[i]) * per_dy[i]
            u = x[i] + t * dx[i]
            best[i] = t if (t >= _ZERO) & (u >= low) & (u <= high) & (t < best[i]) else best[i]
    for wall in range(walls.oblique.shape[0]):
        ax, ay, ex, ey, low, high = walls.oblique[wall]
        for i in range(best.size):
            rx, ry = ax - x[i], ay - y[i]
            t = (rx * ey - ry * ex) / (dx[i] * ey - dy[i] * ex)
            u = (t * dx[i] - rx) * ex + (t * dy[i] - ry) * ey
            best[i] = t if (t >= _ZERO) & (u >= low) & (u <= high) & (t < best[i]) else best[i]


@compiled
def cast_all(poses: Singles, bearings: Singles, arrays: tuple[Singles, ...], out: Singles) -> None:
    """Fill in the distance along each beam to the nearest wall, as ``Caster.cast``.

    ``arrays`` are an :class:`AllWalls`, as a plain tuple: numba takes it faster.
    """
    walls = AllWalls(*arrays)
    sine, cosine = np.empty(_RAYS, np.float32), np.empty(_RAYS, np.float32)
    dx, dy = np.empty(_RAYS, np.float32), np.empty(_RAYS, np.float32)
    per_dx, per_dy = np.empty(_RAYS, np.float32), np.empty(_RAYS, np.float32)
    beam_sine = np.empty(bearings.size, np.float32)
    beam_cosine = np.empty(bearings.size, np.float32)
    sincos32(bearings, beam_sine, beam_cosine)
    left, low, right, high = walls.room
    n = poses.shape[1]
    for start in range(0, n, _RAYS):
        count = min(_RAYS, n - start)
        end = start + count
        x, y = poses[0, start:end], poses[1, start:end]
        sincos32(poses[2, start:end], sine, cosine)
        for beam in range(bearings.size):
            bs, bc = beam_sine[beam], beam_cosine[beam]
            best = out[beam, start:end]
            for i in range(count):
                dx[i] = cosine[i] * bc - sine[i] * bs
                dy[i] = sine[i] * bc + cosine[i] * bs
                per_dx[i], per_dy[i] = inverse(dx[i]), inverse(dy[i])
            for i in range(count):  # leaves the room that it starts in
                leave_x = _more((left - x[i]) * per_dx[i], (right - x[i]) * per_dx[i])
                leave_y = _more((low - y[i]) * per_dy[i], (high - y[i]) * per_dy[i])
                best[i] = _less(leave_x, leave_y)
            _shorten(x, y, dx, dy, per_dx, per_dy, walls, best)
    inside = _inside(poses, walls.outer, walls.room)
    for i in range(n):
        if not inside[i]:
            out[:, i] = _NAN


@compiled
def cast_fans(poses: Singles, bearings: Singles, arrays: tuple[Singles, ...], out: Singles) -> None:
    """Do the same as ``cast_all``, with the lanes over the beams, for a handful of poses.

    Directions are symmetric in heading and bearing: the beams are cast as poses with one beam.
    """
    fan, seen = np.empty((3, bearings.size), np.float32), np.empty((1, bearings.size), np.float32)
    fan[2] = bearings
    for i in range(poses.shape[1]):
        fan[0], fan[1] = poses[0, i], poses[1, i]
        cast_all(fan, poses[2, i : i + 1], arrays, seen)
        for beam in range(bearings.size):
            out[beam, i] = seen[0, beam] if abs(poses[2, i]) < _INF else _NAN


Reach = NDArray[np.uint8]
FARTHEST_CELL = 255  # cells told apart by the reach

_LANES = 1024  # rays traced side by side: what they need fits the second cache
_STRIDES = 4  # between two looks at which of them have arrived


@compiled
def fill_reach(solid: Bools, out: Reach) -> None:
    """Fill in how many cells away the nearest solid one is, at most ``FARTHEST_CELL``.

    The chessboard distance in two passes (Rosenfeld & Pfaltz 1968). ``solid`` has a solid ring.
    """
    rows, columns = solid.shape
    for row in range(rows):
        for column in range(columns):
            out[row, column] = 0 if solid[row, column] else FARTHEST_CELL
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            if out[row, column]:
                below = min(out[row - 1, column - 1], out[row - 1, column])
                beside = min(out[row - 1, column + 1], out[row, column - 1])
                out[row, column] = min(below, beside, FARTHEST_CELL - 1) + 1
    for row in range(rows - 2, 0, -1):
        for column in range(columns - 2, 0, -1):
            above = min(out[row + 1, column + 1], out[row + 1, column])
            beside = min(out[row + 1, column - 1], out[row, column + 1])
            nearest = min(above, beside, FARTHEST_CELL - 1) + 1
            out[row, column] = min(out[row, column], nearest)


@compiled
def cast_among(
    u: Singles,
    v: Singles,
    headings: Singles,
    bearings: Singles,
    reach: Reach,
    endless: bool,
    side: Single,
    out: Singles,
) -> None:
    """Fill in how far the beams of poses come, ∞ if for ever; NaN for poses not on the table.

    Rays end where they enter a cell that is not open; at the table's edge, they go on for ever if
    they are ``endless``. u and v are those of the poses, (n,), in cells of this ``side``; bearings
    (B,), out (B, n).
    """
    n, beams = u.size, bearings.size
    rows, columns = np.float32(reach.shape[0]), np.float32(reach.shape[1])
    on = np.empty(n, np.bool_)
    for i in range(n):  # all false for NaN
        on[i] = (u[i] >= _ONE) & (u[i] < columns - _ONE) & (v[i] >= _ONE) & (v[i] < rows - _ONE)
        on[i] &= abs(headings[i]) < _INF
    sine, cosine = np.empty(n, np.float32), np.empty(n, np.float32)
    beam_sine, beam_cosine = np.empty(beams, np.float32), np.empty(beams, np.float32)
    sincos32(headings, sine, cosine)
    sincos32(bearings, beam_sine, beam_cosine)
    x, y = np.empty(_LANES, np.float32), np.empty(_LANES, np.float32)
    dx, dy = np.empty(_LANES, np.float32), np.empty(_LANES, np.float32)
    ranges = np.empty(_LANES, np.float32)
    beam, pose = 0, 0  # of the next ray: all poses of a beam, then those of the next one
    while beam < beams and n > 0:
        first_beam, first_pose, lane = beam, pose, 0
        while lane < _LANES and beam < beams:
            stretch = min(n - pose, _LANES - lane)
            bs, bc = beam_sine[beam], beam_cosine[beam]
            for k in range(stretch):
                x[lane + k] = u[pose + k] if on[pose + k] else _HALF
                y[lane + k] = v[pose + k] if on[pose + k] else _HALF
            for k in range(stretch):
                dx[lane + k] = cosine[pose + k] * bc - sine[pose + k] * bs
                dy[lane + k] = sine[pose + k] * bc + cosine[pose + k] * bs
            lane, pose = lane + stretch, pose + stretch
            if pose == n:
                beam, pose = beam + 1, 0
        _trace(x[:lane], y[:lane], dx[:lane], dy[:lane], reach, endless, ranges)
        beam, pose = first_beam, first_pose
        for k in range(lane):
            out[beam, pose] = ranges[k] * side if on[pose] else _NAN
            pose += 1
            if pose == n:
                beam, pose = beam + 1, 0


@compiled
def _trace(
    from_x: Singles,
    from_y: Singles,
    along_x: Singles,
    along_y: Singles,
    reach: Reach,
    endless: bool,
    out: Singles,
) -> None:
    """Fill in how far rays from points along directions, (n,), come (Amanatides & Woo 1987)."""
    left, flat = from_x.size, reach.reshape(-1)
    columns = np.int32(reach.shape[1])
    last_row, last_column = np.float32(reach.shape[0] - 1), np.float32(columns - 1)
    # copies made here, as then the compiler knows that no two arrays share memory
    x, y, dx, dy = from_x.copy(), from_y.copy(), along_x.copy(), along_y.copy()
    per_dx, per_dy = np.empty(left, np.float32), np.empty(left, np.float32)
    right, up = np.empty(left, np.float32), np.empty(left, np.float32)
    column, row = np.empty(left, np.float32), np.empty(left, np.float32)  # whole numbers
    t, reached = np.empty(left, np.float32), np.empty(left, np.float32)
    cell, who = np.empty(left, np.int32), np.empty(left, np.int32)
    for i in range(left):
        per_dx[i], per_dy[i] = inverse(dx[i]), inverse(dy[i])
        right[i] = _ONE if per_dx[i] > _ZERO else -_ONE
        up[i] = _ONE if per_dy[i] > _ZERO else -_ONE
        column[i], row[i], t[i] = np.floor(x[i]), np.floor(y[i]), _ZERO
        who[i] = i
    while left > 0:
        for _ in range(_STRIDES):
            for i in range(left):
                cell[i] = np.int32(row[i]) * columns + np.int32(column[i])
            for i in range(left):
                reached[i] = np.float32(flat[cell[i]])
            for i in range(left):
                m = reached[i]
                to_x = (column[i] + _HALF + right[i] * (m - _HALF) - x[i]) * per_dx[i]
                to_y = (row[i] + _HALF + up[i] * (m - _HALF) - y[i]) * per_dy[i]
                sideways = to_x < to_y
                way = to_x if sideways else to_y
                new_column = _near(np.floor(x[i] + way * dx[i]), column[i], m - _ONE)
                new_row = _near(np.floor(y[i] + way * dy[i]), row[i], m - _ONE)
                new_column = column[i] + right[i] * m if sideways else new_column
                new_row = new_row if sideways else row[i] + up[i] * m
                t[i] = way if m > _ZERO else t[i]
                column[i] = new_column if m > _ZERO else column[i]
                row[i] = new_row if m > _ZERO else row[i]
        count = 0
        for i in range(left):
            stays = reached[i] > _ZERO
            if endless and not stays:
                across = (column[i] == _ZERO) | (column[i] == last_column)
                t[i] = _INF if across | (row[i] == _ZERO) | (row[i] == last_row) else t[i]
            out[who[i]] = t[i]
            x[count], y[count], dx[count], dy[count] = x[i], y[i], dx[i], dy[i]
            per_dx[count], per_dy[count] = per_dx[i], per_dy[i]
            right[count], up[count] = right[i], up[i]
            column[count], row[count], t[count], who[count] = column[i], row[i], t[i], who[i]
            count += stays
        left = count


@compiled
def _near(index: Single, middle: Single, reach: Single) -> Single:
    """Return the index, or the nearest to it that is no farther from the middle than that."""
    low: Single = middle - reach
    high: Single = middle + reach
    least = index if index > low else low
    return least if least < high else high
