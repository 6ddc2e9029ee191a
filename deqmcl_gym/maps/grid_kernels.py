"""The compiled geometry of cells: rays, points, distances and discs among solid squares.

Positions are in cells: square (i, j) of a table is [i, i + 1] × [j, j + 1]. All but ``distances``
use one table, the *reach* of each cell: the number of cells, along an axis or a diagonal, to the
nearest solid one; 0 is solid. The table has a ring of solid cells around the map, so that no ray
leaves it, and all cells nearer than the reach of an open one are open too. A ``frame`` has x and y
of the lower left corner of the map's first cell, cosine and sine of its yaw, and the edge of a
cell. All else is as in ``drive_kernels``, but that poses and points may be float64.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.maps.drive_kernels import POSE_BLOCK, directed, put
from deqmcl_gym.maps.ray_kernels import FARTHEST_CELL, Reach, cast_among, inverse
from deqmcl_gym.numerics import Bools, Floats, Ints, Scalar, Singles
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos32, sin32

Counts = NDArray[np.int16]  # of cells
_ZERO, _NAN = np.float32(0.0), np.float32(np.nan)


@compiled
def fill_runs(reach: Reach, up: Counts, down: Counts) -> None:
    """Fill in the number of cells up and down to the next one of the other kind, solid or open.

    The ring is of neither kind.
    """
    rows, columns = reach.shape
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            same = row > 1 and (reach[row, column] == 0) == (reach[row - 1, column] == 0)
            down[row, column] = down[row - 1, column] + 1 if same else 1
    for row in range(rows - 2, 0, -1):
        for column in range(1, columns - 1):
            same = row < rows - 2 and (reach[row, column] == 0) == (reach[row + 1, column] == 0)
            up[row, column] = up[row + 1, column] + 1 if same else 1


@compiled
def locate(points: Any, frame: tuple[float, ...], us: Any, vs: Any) -> None:
    """Convert points (2+, n) to cells of the table, in float64; us and vs may be float32."""
    x0, y0, cosine, sine, cell = frame
    for i in range(us.size):
        x, y = np.float64(points[0, i]) - x0, np.float64(points[1, i]) - y0
        us[i] = (x * cosine + y * sine) / cell + 1.0
        vs[i] = (y * cosine - x * sine) / cell + 1.0


@compiled
def on_map(u: Scalar, v: Scalar, reach: Reach) -> Scalar:
    """Whether a point in cells of the table is on the map."""
    rows, columns = reach.shape
    return (u >= 1) & (u < columns - 1) & (v >= 1) & (v < rows - 1)  # all false for NaN


@compiled
def cast_cells(
    poses: Any,
    bearings: Singles,
    reach: Reach,
    frame: tuple[float, ...],
    yaw: float,
    endless: bool,
    out: Singles,
) -> None:
    """Fill in the distance along each beam to the nearest face between an open and a solid cell.

    The map's edge is a face, too, or ∞ far away if it is ``endless``; NaN for a pose that is not on
    the map. Bearings are (B,) rad, the yaw is the map's, ``out`` is (B, n).
    """
    n = poses.shape[1]
    u, v, headings = np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32)
    locate(poses, frame, u, v)
    for i in range(n):
        headings[i] = np.float32(poses[2, i] - yaw)
    cast_among(u, v, headings, bearings, reach, endless, np.float32(frame[4]), out)
    for beam in range(out.shape[0]):
        for i in range(n):
            if out[beam, i] == _ZERO:
                angle = headings[i] + bearings[beam]
                t = _from_within(u[i], v[i], cos32(angle), sin32(angle), reach)
                out[beam, i] = t * np.float32(frame[4])


@compiled
def _from_within(x: Scalar, y: Scalar, dx: Scalar, dy: Scalar, reach: Reach) -> Scalar:
    """Distance of a ray from solid cells to open ones or to the edge; 0 from open ones."""
    rows, columns = reach.shape
    if not on_map(x, y, reach):
        return _NAN
    per_dx, per_dy = inverse(dx), inverse(dy)
    right, up = (1 if per_dx > _ZERO else -1), (1 if per_dy > _ZERO else -1)
    column, row, t = int(x), int(y), _ZERO
    while reach[row, column] == 0 and 0 < column < columns - 1 and 0 < row < rows - 1:
        to_x = (np.float32(column + (right > 0)) - x) * per_dx
        to_y = (np.float32(row + (up > 0)) - y) * per_dy
        if to_x < to_y:
            column, t = column + right, to_x
        else:
            row, t = row + up, to_y
    return t


@compiled
def distances(
    points: Any, reach: Reach, up: Counts, down: Counts, frame: tuple[float, ...], out: Singles
) -> None:
    """Fill in the distance of points (2+, n) to the nearest face between open and solid cells.

    Columns are searched to both sides, until none can be nearer. Outside the map, it is the
    distance to its edge.
    """
    n, cell = out.size, frame[4]
    u, v = np.empty(n), np.empty(n)
    locate(points, frame, u, v)
    rows, columns = reach.shape
    for i in range(n):
        if on_map(u[i], v[i], reach):
            out[i] = cell * np.sqrt(_nearest(u[i], v[i], reach, up, down))
        else:
            beside = max(1.0 - u[i], u[i] - (columns - 1.0), 0.0)
            above = max(1.0 - v[i], v[i] - (rows - 1.0), 0.0)
            out[i] = cell * np.sqrt(beside * beside + above * above)


@compiled
def _nearest(u: float, v: float, reach: Reach, up: Counts, down: Counts) -> float:
    """Return the squared distance of a point on the map to the nearest face, in cells."""
    row, middle = int(v), int(u)
    columns, solid, above = reach.shape[1], reach[row, middle] == 0, v - row
    best = np.inf
    for way in (-1, 1):
        column = middle
        while True:
            beside = 0.0 if column == middle else max(column - u, u - (column + 1.0))
            if beside * beside >= best:
                break
            if column in (0, columns - 1) or (reach[row, column] == 0) != solid:
                best = beside * beside
                break
            gap = min(up[row, column] - above, down[row, column] - 1.0 + above)
            best = min(best, beside * beside + gap * gap)
            column += way
    return best


_ROUNDING = 1e-9  # cells, far above errors of float64
_DIAGONAL = np.sqrt(2.0) + 1e-4  # of a cell, and more


@compiled
def feasible_in_cells(
    starts: Any, ends: Any, reach: Reach, frame: Any, radius: float, out: Bools
) -> None:
    """Fill in whether a disc swept along each path meets no solid cell and stays on the map."""
    n = out.size
    here, there = np.empty((2, n)), np.empty((2, n))
    near, next_near = np.empty(n, np.int16), np.empty(n, np.int16)
    find(starts, reach, frame, here[0], here[1], near)
    find(ends, reach, frame, there[0], there[1], next_near)
    hits = np.zeros(n, np.int32)
    _count(here, near, there, next_near, radius / frame[4], reach, hits)
    out[:] = hits == 0


@compiled
def collisions_along_in_cells(
    poses: Singles, path: Singles, reach: Reach, frame: tuple[float, ...], radius: float, hits: Ints
) -> None:
    """Do as ``drive_kernels.collisions_along``."""
    n, size = poses.shape[1], radius / frame[4]
    hits[:] = 0
    for start in range(0, n, POSE_BLOCK):
        count = min(POSE_BLOCK, n - start)
        rows, points = np.empty((4, count), np.float32), np.empty((2, count), np.float32)
        here, there = np.empty((2, count)), np.empty((2, count))
        near, next_near = np.empty(count, np.int16), np.empty(count, np.int16)
        directed(poses[:, start : start + count].copy(), rows)
        put(rows, path[0], points)
        find(points, reach, frame, here[0], here[1], near)
        for place in path[1:]:
            put(rows, place, points)
            find(points, reach, frame, there[0], there[1], next_near)
            _count(here, near, there, next_near, size, reach, hits[start : start + count])
            here, there, near, next_near = there, here, next_near, near


@compiled
def find(points: Any, reach: Reach, frame: Any, us: Floats, vs: Floats, out: Counts) -> None:
    """Fill in points in cells, and the reach of their cells: that of the ring, 0, off the map."""
    locate(points, frame, us, vs)
    rows, columns = reach.shape
    flat, last_row, last_column = reach.ravel(), rows - 1.0, columns - 1.0
    squares = np.empty(us.size, np.int32)
    for i in range(us.size):
        u, v = us[i], vs[i]
        u = u if u > 0.0 else 0.0  # also if it is NaN
        v = v if v > 0.0 else 0.0
        u = u if u < last_column else last_column
        v = v if v < last_row else last_row
        squares[i] = np.int32(v) * np.int32(columns) + np.int32(u)
    for i in range(us.size):
        out[i] = flat[squares[i]]


@compiled
def _count(
    here: Floats,
    near: Counts,
    there: Floats,
    next_near: Counts,
    size: float,
    reach: Reach,
    hits: Ints,
) -> None:
    """Count the paths that are not clear, for points and the reach found there, (n,)."""
    # bounds as of ``drive_kernels``; a disc hits that reaches over the diagonal to the nearest cell
    n = near.size
    unsure, chosen = np.empty(n, np.bool_), np.empty(n, np.int32)
    for i in range(n):
        du, dv = there[0, i] - here[0, i], there[1, i] - here[1, i]
        spare = np.float64(near[i]) + np.float64(next_near[i]) - 2.0 - 2.0 * size
        clear = (spare > 0.0) & (spare * spare > du * du + dv * dv)
        least = min(near[i], next_near[i])
        hit = (least <= 0) | ((least * _DIAGONAL < size) & (least < FARTHEST_CELL))
        hits[i] += hit
        unsure[i] = not (hit | clear)
    count = 0
    for i in range(n):
        chosen[count] = i
        count += unsure[i]
    for k in range(count):
        i = chosen[k]
        u, v = here[0, i], here[1, i]
        du, dv = there[0, i] - u, there[1, i] - v
        hits[i] += not _clear(u, v, near[i], du, dv, next_near[i], size, reach)


@compiled
def _clear(
    u: float, v: float, before: int, du: float, dv: float, after: int, radius: float, reach: Reach
) -> bool:
    """Whether a disc swept from (u, v) by (du, dv) touches no solid cell and stays on the map."""
    if _touches_beside(u + du, v + dv, after, radius, reach):
        return False
    if _touches_beside(u, v, before, radius, reach):
        return False
    middle_u, middle_v = u + du / 2, v + dv / 2
    row, column = int(middle_v), int(middle_u)
    m, aside, ahead = reach[row, column] - _ROUNDING, abs(du) / 2 + radius, abs(dv) / 2 + radius
    if (
        max(middle_u - column, column + 1.0 - middle_u) + aside < m
        and max(middle_v - row, row + 1.0 - middle_v) + ahead < m
    ):
        return True
    return _swept_clear(u, v, du, dv, radius, reach)


@compiled
def _touches_beside(u: float, v: float, m: int, radius: float, reach: Reach) -> bool:
    """Whether a disc touches the next solid cells along the axes, if they are m cells away."""
    row, column = int(v), int(u)
    return (
        (column + m - u <= radius and reach[row, column + m] == 0)
        or (u - (column + 1.0 - m) <= radius and reach[row, column - m] == 0)
        or (row + m - v <= radius and reach[row + m, column] == 0)
        or (v - (row + 1.0 - m) <= radius and reach[row - m, column] == 0)
    )


@compiled
def _swept_clear(u: float, v: float, du: float, dv: float, radius: float, reach: Reach) -> bool:
    """Whether a disc swept from (u, v) by (du, dv) touches no solid cell; it starts on the map."""
    low, high = min(v, v + dv) - radius, max(v, v + dv) + radius
    left, right = min(u, u + du) - radius, max(u, u + du) + radius
    rows, columns = reach.shape
    if left <= 1.0 or low <= 1.0 or right >= columns - 1.0 or high >= rows - 1.0:
        return False
    length = np.sqrt(du * du + dv * dv)
    across_u = -dv / length * radius if length > 0.0 else 0.0
    across_v = du / length * radius if length > 0.0 else 0.0
    for row in range(int(np.ceil(low)) - 1, int(np.floor(high)) + 1):
        first, last = np.inf, -np.inf
        for end in range(2):  # the discs at both ends
            centre_u, centre_v = u + end * du, v + end * dv
            off = max(row - centre_v, centre_v - (row + 1.0), 0.0)
            if off <= radius:
                half = np.sqrt(radius * radius - off * off)
                first, last = min(first, centre_u - half), max(last, centre_u + half)
        for side in (-1.0, 1.0):  # the lines between them
            side_u, side_v = u + side * across_u, v + side * across_v
            if dv == 0.0:
                if row <= side_v <= row + 1.0:
                    first = min(first, side_u, side_u + du)
                    last = max(last, side_u, side_u + du)
            else:
                bottom, top = (row - side_v) / dv, (row + 1.0 - side_v) / dv
                enter, leave = max(min(bottom, top), 0.0), min(max(bottom, top), 1.0)
                if enter <= leave:
                    from_u, to_u = side_u + enter * du, side_u + leave * du
                    first, last = min(first, from_u, to_u), max(last, from_u, to_u)
        column, end_column = int(np.ceil(first)) - 1, int(np.floor(last))
        while column <= end_column:
            if reach[row, column] == 0:
                return False
            column += int(reach[row, column])  # all cells up to there are open
    return True


@compiled
def first_contact(
    start: tuple[float, float],
    end: tuple[float, float],
    reach: Reach,
    frame: tuple[float, ...],
    radius: float,
) -> float:
    """Share of the way at which a disc that starts clear of solid cells touches one; inf if never.

    Positions are in cells; see ``grid_kernels``. The disc's centre then meets the square grown by
    the radius: a slab along each axis, a circle around each corner.
    """
    points = np.array(((start[0], end[0]), (start[1], end[1])))
    us, vs = np.empty(2), np.empty(2)
    locate(points, frame, us, vs)
    u, v, du, dv, r = us[0], vs[0], us[1] - us[0], vs[1] - vs[0], radius / frame[4]
    rows, columns = reach.shape
    low = max(int(np.ceil(min(v, v + dv) - r)) - 1, 0)
    high = min(int(np.floor(max(v, v + dv) + r)), rows - 1)
    left = max(int(np.ceil(min(u, u + du) - r)) - 1, 0)
    right = min(int(np.floor(max(u, u + du) + r)), columns - 1)
    first = np.inf
    for row in range(low, high + 1):
        for column in range(left, right + 1):
            if reach[row, column] == 0:
                x, y = u - column, v - row  # seen from the square's lower left corner
                first = min(first, _meets_box(x, y, du, dv, -r, 1.0 + r, 0.0, 1.0))
                first = min(first, _meets_box(x, y, du, dv, 0.0, 1.0, -r, 1.0 + r))
                for corner in range(4):
                    cx, cy = x - corner % 2, y - corner // 2
                    first = min(first, enters_circle(cx, cy, du, dv, r))
    return first


@compiled
def _meets_box(
    x: float, y: float, dx: float, dy: float, left: float, right: float, low: float, high: float
) -> float:
    """Share of (dx, dy) at which a point from outside enters a rectangle; inf if never."""
    enter, leave = 0.0, 1.0
    for at, way, least, most in ((x, dx, left, right), (y, dy, low, high)):
        if way == 0.0:
            if not least <= at <= most:
                return np.inf
        else:
            to_least, to_most = (least - at) / way, (most - at) / way
            enter, leave = max(enter, min(to_least, to_most)), min(leave, max(to_least, to_most))
    return enter if enter <= leave else np.inf


@compiled
def enters_circle(x: float, y: float, dx: float, dy: float, radius: float) -> float:
    """Share of (dx, dy) at which a point from outside enters a circle around 0; inf if never."""
    square, nears = dx * dx + dy * dy, -(x * dx + y * dy)
    root = nears * nears - square * (x * x + y * y - radius * radius)
    if not (nears > 0.0 and root >= 0.0):
        return np.inf
    share = max(nears - np.sqrt(root), 0.0) / square
    return share if share <= 1.0 else np.inf
