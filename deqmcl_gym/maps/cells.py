"""Which walls stand in which square of a grid: for rays among many walls."""

import math
from typing import NamedTuple

import numpy as np

from deqmcl_gym.maps import stride_kernels
from deqmcl_gym.maps.stride_kernels import Table
from deqmcl_gym.numerics.types import Floats, Singles

_PER_WALL = 4  # cells; the fastest of 2 to 16 among 256 and 1,024 walls


class SortedWalls(NamedTuple):
    """Walls sorted into square cells.

    Attributes:
        corner: lower left corner of the table (x, y).
        side: of a cell.
        table: the cells, with a ring around the walls.
    """

    corner: tuple[float, float]
    side: float
    table: Table


def cells_of(walls: Floats, directed: Singles, margin: float) -> SortedWalls:
    """Sort walls into square cells, a handful for each.

    A wall closer to a cell than ``margin`` counts as in it.

    Args:
        walls: (x₀, y₀, x₁, y₁), (S, 4).
        directed: the same as (x₀, y₀, unit x, unit y, low, high), (S, 6).
        margin: a length.
    """
    x, y = walls[:, [0, 2]], walls[:, [1, 3]]
    width, height = (float(np.ptp(axis)) + 4 * margin for axis in (x, y))
    side = max(math.sqrt(width * height / (_PER_WALL * len(walls))), max(width, height) / 4096)
    columns, rows = math.ceil(width / side) + 2, math.ceil(height / side) + 2
    corner = float(x.min()) - 2 * margin - side, float(y.min()) - 2 * margin - side
    inside = (walls - np.tile(corner, 2)) / side
    first = np.zeros(rows * columns + 1, np.int32)
    stride_kernels.count_walls(inside, margin / side, columns, first)
    np.cumsum(first, out=first)
    listed = np.empty(first[-1], np.int32)
    stride_kernels.list_walls(inside, margin / side, columns, first.copy(), listed)
    taken = np.diff(first).reshape(rows, columns) > 0
    taken[[0, -1]] = taken[:, [0, -1]] = True
    reach = np.empty((rows, columns), np.uint8)
    stride_kernels.fill_reach(taken, reach)
    scaled = directed.astype(np.float64)
    scaled[:, :2] = (scaled[:, :2] - corner) / side
    scaled[:, 4:] /= side
    return SortedWalls(corner, side, Table(reach, first, listed, scaled.astype(np.float32), False))
