"""The outline of solid cells: faces joined to straight walls, and walls to rings."""

from typing import Any

import numpy as np

from deqmcl_gym.numerics.types import Bools, Floats, Indices


def faces_of(solid: Bools) -> Floats:
    """Return the faces between open and solid cells, those in a line joined to one.

    The edge of the map is solid.

    Args:
        solid: which cells are, (rows, columns).

    Returns:
        (x₀, y₀, x₁, y₁) in cells from the lower left corner, the open side to their left, (S, 4).
    """
    open_ = np.pad(~solid, 1).astype(np.int8)
    level, upright = np.diff(open_, axis=0)[:, 1:-1], -np.diff(open_, axis=1)[1:-1].T
    row, x0, x1 = _runs(level)  # to the right where open cells are above, else to the left
    column, y0, y1 = _runs(upright)  # up where open cells are to the left, else down
    faces = np.vstack(
        [np.column_stack([x0, row, x1, row]), np.column_stack([column, y0, column, y1])]
    )
    return faces.astype(np.float64)


def _runs(lines: Any) -> tuple[Indices, Indices, Indices]:
    """Return line, start and end of all runs of +1, and of those of -1, from their ends, (n,)."""
    padded = np.pad(lines, ((0, 0), (1, 1)))
    line, place = np.nonzero(np.diff(padded, axis=1))
    before, after = padded[line, place], padded[line, place + 1]
    starts, ends, forth = after != 0, before != 0, after[after != 0] > 0
    first, last = place[starts], place[ends]
    return line[starts], np.where(forth, first, last), np.where(forth, last, first)
