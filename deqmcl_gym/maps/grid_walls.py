"""The outline of solid cells: faces joined to straight walls, and walls to rings."""

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
    around = np.pad(~solid, 1).astype(np.int8)
    # above a face the open side, below it the solid one: it runs to the right; to the left of it: up
    level, upright = np.diff(around, axis=0)[:, 1:-1], np.diff(around, axis=1)[1:-1]
    row, start, end, forth = _runs(level)
    x0, x1 = np.where(forth, start, end), np.where(forth, end, start)
    columns = [np.column_stack([x0, row, x1, row])]
    column, start, end, forth = _runs(-upright.T)
    y0, y1 = np.where(forth, start, end), np.where(forth, end, start)
    columns.append(np.column_stack([column, y0, column, y1]))
    return np.vstack(columns).astype(np.float64)


def _runs(lines: np.ndarray) -> tuple[Indices, Indices, Indices, Bools]:
    """Return line, start, end and sign of all runs of +1 and of -1 in some lines, (n,) each."""
    padded = np.pad(lines, ((0, 0), (1, 1)))
    line, place = np.nonzero(np.diff(padded, axis=1))
    before, after = padded[line, place], padded[line, place + 1]
    starts, ends = after != 0, before != 0
    return line[starts], place[starts], place[ends], after[starts] > 0


def rings_of(faces: Floats) -> list[Floats]:
    """Join faces to closed rings of corners, (k, 2) each, the open side to the left.

    Where four faces meet, at two solid cells that touch by a corner, the ring turns right, around
    the open cell: solid cells that touch by a corner hang together, and no ring touches itself.
    """
    raise NotImplementedError
