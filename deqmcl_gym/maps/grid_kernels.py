"""The compiled geometry of cells: rays, points and distances among solid squares.

Positions are in cells: square (i, j) of a table is [i, i + 1] × [j, j + 1]. All but ``distances``
use one table, the *reach* of each cell: the number of cells, along an axis or a diagonal, to the
nearest solid one; 0 is solid. The table has a ring of solid cells around the map, so that no ray
leaves it, and all cells nearer than the reach of an open one are open too.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.maps.stride_kernels import Reach, cast_among, no_walls
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos32, sin32
from deqmcl_gym.numerics.types import Bools, Floats, Singles

Runs = NDArray[np.int16]
Scalar = Any  # a float32 or float64 inside a kernel
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_TINY = np.float32(1e-12)
_NAN = np.float32(np.nan)


class Frame(NamedTuple):
    """The transform from the map's unit to cells of its table.

    Attributes:
        x, y: of the lower left corner of the map's first cell.
        cosine, sine: of the map's yaw.
        cell: edge of a cell.
    """

    x: float
    y: float
    cosine: float
    sine: float
    cell: float


@compiled
def fill_runs(reach: Reach, up: Runs, down: Runs) -> None:
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
def open_at(us: Floats, vs: Floats, reach: Reach, out: Bools) -> None:
    """Fill in whether points in cells lie in open ones."""
    for i in range(out.size):
        out[i] = on_map(us[i], vs[i], reach) and reach[int(vs[i]), int(us[i])] > 0


@compiled
def cast(
    poses: Any,
    bearings: Singles,
    reach: Reach,
    frame: tuple[float, ...],
    yaw: float,
    endless: bool,
    out: Singles,
) -> None:
    """Fill in the distance along each beam to the nearest face between an open and a solid cell.

    The map's edge is a face, too, or ∞ far away; NaN for a pose that is not on the map.

    Args:
        poses: rows x, y, θ, (3, n), float32 or float64.
        bearings: (B,) rad.
        reach: of the map's cells, those solid that stop beams.
        frame: a :class:`Frame`, as a plain tuple: numba takes it faster.
        yaw: of the map.
        endless: whether beams go on beyond the map's edge.
        out: (B, n).
    """
    n = poses.shape[1]
    u, v, headings = np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32)
    locate(poses, frame, u, v)
    for i in range(n):
        headings[i] = np.float32(poses[2, i] - yaw)
    cast_among(u, v, headings, bearings, no_walls(reach, endless), np.float32(frame[4]), out)
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
    per_dx = _ONE / (dx if abs(dx) > _TINY else _TINY)
    per_dy = _ONE / (dy if abs(dy) > _TINY else _TINY)
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
    points: Any, reach: Reach, up: Runs, down: Runs, frame: tuple[float, ...], out: Singles
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
def _nearest(u: float, v: float, reach: Reach, up: Runs, down: Runs) -> float:
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
