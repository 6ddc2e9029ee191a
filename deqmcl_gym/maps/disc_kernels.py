"""Compiled discs among solid squares: one sweep, and whole roll-outs.

Positions are in cells, and all use only the *reach* of cells; see ``grid_kernels``.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.maps.grid_kernels import Runs, locate, on_map
from deqmcl_gym.maps.kernels import BLOCK, drive
from deqmcl_gym.maps.laid_kernels import directed, put
from deqmcl_gym.maps.stride_kernels import Reach
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Bools, Floats, Ints, Singles

Reached = NDArray[np.int16]
_ROUNDING = 1e-9  # cells, far above errors of float64


class Terrain(NamedTuple):
    """A grid for kernels that drive robots.

    Attributes:
        reach: of each cell; empty if there is no grid.
        up, down: as ``grid_kernels.fill_runs`` fills them in.
        frame: a ``grid_kernels.Frame``, as a plain tuple.
    """

    reach: Reach
    up: Runs
    down: Runs
    frame: tuple[float, ...]


_NO_RUNS = np.empty((0, 0), np.int16)
NO_CELLS = tuple(Terrain(np.empty((0, 0), np.uint8), _NO_RUNS, _NO_RUNS, (0.0, 0.0, 1.0, 0.0, 1.0)))


@compiled
def feasible(starts: Any, ends: Any, reach: Reach, frame: Any, radius: float, out: Bools) -> None:
    """Fill in whether a disc swept along each path meets no solid cell and stays on the map.

    Args:
        starts, ends: rows x and y (further rows are ignored), (2+, n), float32 or float64.
        reach, frame: as ``grid_kernels.cast``.
        radius: of the disc.
        out: (n,).
    """
    n = out.size
    u, v, to_u, to_v = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    before, after = np.empty(n, np.int16), np.empty(n, np.int16)
    _find(starts, reach, frame, u, v, before)
    _find(ends, reach, frame, to_u, to_v, after)
    for i in range(n):
        du, dv = to_u[i] - u[i], to_v[i] - v[i]
        out[i] = _clear(u[i], v[i], before[i], du, dv, after[i], radius / frame[4], reach)


@compiled
def roll_out(
    poses: Singles,
    moves: Singles,
    reach: Reach,
    frame: tuple[float, ...],
    radius: float,
    collisions: Ints,
    out: Singles,
) -> None:
    """Drive poses through several moves; fill in the poses reached and the steps that collide.

    Args:
        poses: rows x, y, θ, (3, n).
        moves: increments, (F, 3, n); as ``kernels.drive``.
        reach, frame, radius: as ``feasible``.
        collisions: number of steps of each that collide, (n,).
        out: poses after each move, (F, 3, n), or after the last one only, (1, 3, n).
    """
    n, size = poses.shape[1], radius / frame[4]
    for start in range(0, n, BLOCK):
        end = min(start + BLOCK, n)
        count = end - start
        before, after = poses[:, start:end].copy(), np.empty((3, count), np.float32)
        here, there = np.empty((2, count)), np.empty((2, count))
        near, next_near = np.empty(count, np.int16), np.empty(count, np.int16)
        hits = collisions[start:end]
        hits[:] = 0
        _find(before, reach, frame, here[0], here[1], near)
        for step in range(len(moves)):
            drive(before, moves[step, :, start:end], after)
            _find(after, reach, frame, there[0], there[1], next_near)
            _count(here, near, there, next_near, size, reach, hits)
            if len(out) > 1 or step == len(moves) - 1:
                out[step if len(out) > 1 else 0, :, start:end] = after
            before, after = after, before
            here, there, near, next_near = there, here, next_near, near


@compiled
def collisions(
    poses: Singles,
    path: Singles,
    reach: Reach,
    frame: tuple[float, ...],
    radius: float,
    out: Ints,
) -> None:
    """Fill in the number of steps that collide on a path laid from each pose.

    Args:
        poses: rows x, y, θ, (3, n).
        path: points in the frame of the pose, (k + 1, 2), k ≥ 1.
        reach, frame, radius: as ``feasible``.
        out: (n,).
    """
    n, size = poses.shape[1], radius / frame[4]
    out[:] = 0
    for start in range(0, n, BLOCK):
        count = min(BLOCK, n - start)
        rows, at = np.empty((4, count), np.float32), np.empty((2, count), np.float32)
        here, there = np.empty((2, count)), np.empty((2, count))
        near, next_near = np.empty(count, np.int16), np.empty(count, np.int16)
        directed(poses[:, start : start + count].copy(), rows)
        put(rows, path[0], at)
        _find(at, reach, frame, here[0], here[1], near)
        for step in range(1, len(path)):
            put(rows, path[step], at)
            _find(at, reach, frame, there[0], there[1], next_near)
            _count(here, near, there, next_near, size, reach, out[start : start + count])
            here, there, near, next_near = there, here, next_near, near


@compiled
def _find(points: Any, reach: Reach, frame: Any, us: Floats, vs: Floats, out: Reached) -> None:
    """Fill in points in cells, and the reach of their cells; -1 outside the map."""
    locate(points, frame, us, vs)
    for i in range(us.size):
        out[i] = reach[int(vs[i]), int(us[i])] if on_map(us[i], vs[i], reach) else -1


@compiled
def _count(
    here: Floats,
    near: Reached,
    there: Floats,
    next_near: Reached,
    size: float,
    reach: Reach,
    hits: Ints,
) -> None:
    """Count the paths that are not clear, for points and the reach found there, (n,)."""
    for i in range(near.size):
        u, v = here[0, i], here[1, i]
        du, dv = there[0, i] - u, there[1, i] - v
        hits[i] += not _clear(u, v, near[i], du, dv, next_near[i], size, reach)


@compiled
def _clear(
    u: float, v: float, before: int, du: float, dv: float, after: int, radius: float, reach: Reach
) -> bool:
    """Whether a disc swept from (u, v) by (du, dv) touches no solid cell and stays on the map.

    On a path of length d between places a and b away from all solid cells, no point is nearer to
    them than (a + b - d) / 2. If that does not decide, the nearest cells beside the ends and the
    open square around the middle are tried, then all cells one by one.
    """
    if before <= 0 or after <= 0:
        return False
    spare = np.float64(before) + np.float64(after) - 2.0 - 2.0 * radius
    if spare > 0.0 and spare * spare > du * du + dv * dv:
        return True
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
    """Whether a disc swept from (u, v) by (du, dv) touches no solid cell; it starts on the map.

    Row by row: the cells that it touches in a row are between its left and right ends there.
    """
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
                one, two = (row - side_v) / dv, (row + 1.0 - side_v) / dv
                enter, leave = max(min(one, two), 0.0), min(max(one, two), 1.0)
                if enter <= leave:
                    one, two = side_u + enter * du, side_u + leave * du
                    first, last = min(first, one, two), max(last, one, two)
        column, end_column = int(np.ceil(first)) - 1, int(np.floor(last))
        while column <= end_column:
            if reach[row, column] == 0:
                return False
            column += int(reach[row, column])  # all cells up to there are open
    return True
