"""Which walls stand in which square of a grid: for rays among many walls."""

import math
from typing import NamedTuple

import numpy as np

from deqmcl_gym.numerics.types import Bools, Floats, Ints, Singles


class Cells(NamedTuple):
    """A grid of square cells over some walls, as ``ray_kernels.cast_through`` takes it.

    Attributes:
        corner: lower left corner of the grid (x, y).
        side: of a cell.
        columns: how many cells there are along x; the index of a cell is row · columns + column.
        first: where each cell's walls begin in ``walls``, and one more for their end, (cells + 1,).
        walls: indices of walls, cell by cell.
    """

    corner: Singles
    side: np.float32
    columns: int
    first: Ints
    walls: Ints


def cells_of(walls: Floats, margin: float) -> Cells:
    """Sort walls (x₀, y₀, x₁, y₁), (S, 4), into about as many square cells.

    A wall closer to a cell than ``margin`` counts as in it.
    """
    x0, y0, x1, y1 = walls.T
    low = np.array([min(x0.min(), x1.min()), min(y0.min(), y1.min())]) - 2 * margin
    width, height = np.array([max(x0.max(), x1.max()), max(y0.max(), y1.max())]) + 2 * margin - low
    side = math.sqrt(width * height / len(walls))
    columns, rows = math.ceil(width / side), math.ceil(height / side)
    ends = walls.reshape(-1, 2, 2)
    first_cell = np.floor((ends.min(axis=1) - margin - low) / side).astype(np.intp)
    last_cell = np.floor((ends.max(axis=1) + margin - low) / side).astype(np.intp)
    touched = []
    for wall, (left, lower), (right, upper) in zip(walls, first_cell, last_cell, strict=True):
        column, row = np.arange(left, right + 1), np.arange(lower, upper + 1)[:, None]
        x, y = low[0] + (column + 0.5) * side, low[1] + (row + 0.5) * side
        touched.append((row * columns + column)[_touches(wall, x, y, side / 2 + margin)])
    cell = np.concatenate(touched)
    by_cell = np.argsort(cell, kind="stable")
    listed = np.repeat(np.arange(len(walls)), [len(cells) for cells in touched])[by_cell]
    first = np.searchsorted(cell[by_cell], np.arange(rows * columns + 1))
    return Cells(
        corner=low.astype(np.float32),
        side=np.float32(side),
        columns=columns,
        first=first.astype(np.int32),
        walls=listed.astype(np.int32),
    )


def _touches(wall: Floats, x: Floats, y: Floats, half: float) -> Bools:
    """Whether a wall meets squares around (x, y): no axis separates them (Ericson 2005, 5.3.3)."""
    x0, y0, x1, y1 = wall
    apart_x = np.abs(x - (x0 + x1) / 2) > half + abs(x1 - x0) / 2
    apart_y = np.abs(y - (y0 + y1) / 2) > half + abs(y1 - y0) / 2
    across = (x - x0) * (y1 - y0) - (y - y0) * (x1 - x0)
    apart_along = np.abs(across) > half * (abs(x1 - x0) + abs(y1 - y0))
    touching: Bools = ~(apart_x | apart_y | apart_along)
    return touching
