"""Rays that stride through open cells.

Positions are in cells: square (i, j) of a table is [i, i + 1] × [j, j + 1]. The *reach* of a cell
says how many cells away, along an axis or a diagonal, the nearest one is that is not open; its own
is 0 then. The cells along the edge of a table are never open, so that nothing walks off it. From a
cell of reach m a ray strides to the edge of the square of 2 m - 1 open cells around it. Its cells
are kept in whole numbers, so that no rounding error leads past one.
"""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics import Bools, Single, Singles
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import sincos32

Reach = NDArray[np.uint8]
FARTHEST_CELL = 255  # cells told apart by the reach

_RAYS = 1024  # traced side by side: what they need fits the second cache
_STRIDES = 4  # between two looks at which of them have arrived
_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
_INF, _TINY = np.float32(np.inf), np.float32(1e-12)


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
    x, y = np.empty(_RAYS, np.float32), np.empty(_RAYS, np.float32)
    dx, dy = np.empty(_RAYS, np.float32), np.empty(_RAYS, np.float32)
    found = np.empty(_RAYS, np.float32)
    beam, pose = 0, 0  # of the next ray: all poses of a beam, then those of the next one
    while beam < beams and n > 0:
        first_beam, first_pose, lane = beam, pose, 0
        while lane < _RAYS and beam < beams:
            stretch = min(n - pose, _RAYS - lane)
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
        _trace(x[:lane], y[:lane], dx[:lane], dy[:lane], reach, endless, found)
        beam, pose = first_beam, first_pose
        for k in range(lane):
            out[beam, pose] = found[k] * side if on[pose] else np.float32(np.nan)
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
        per_dx[i] = _ONE / (dx[i] if abs(dx[i]) > _TINY else _TINY)
        per_dy[i] = _ONE / (dy[i] if abs(dy[i]) > _TINY else _TINY)
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
        kept = 0
        for i in range(left):
            stays = reached[i] > _ZERO
            if endless and not stays:
                across = (column[i] == _ZERO) | (column[i] == last_column)
                t[i] = _INF if across | (row[i] == _ZERO) | (row[i] == last_row) else t[i]
            out[who[i]] = t[i]
            x[kept], y[kept], dx[kept], dy[kept] = x[i], y[i], dx[i], dy[i]
            per_dx[kept], per_dy[kept] = per_dx[i], per_dy[i]
            right[kept], up[kept] = right[i], up[i]
            column[kept], row[kept], t[kept], who[kept] = column[i], row[i], t[i], who[i]
            kept += stays
        left = kept


@compiled
def _near(index: Single, middle: Single, reach: Single) -> Single:
    """Return the index, or the nearest to it that is no farther from the middle than that."""
    low: Single = middle - reach
    high: Single = middle + reach
    least = index if index > low else low
    return least if least < high else high
