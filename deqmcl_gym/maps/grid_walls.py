"""The outline of solid cells: faces joined to straight walls, and walls to polygons."""

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


def polygons_of(faces: Floats, cells: Floats) -> tuple[Floats, list[Floats]]:
    """Return the outline of the largest open region, and those of what stands in it, (k, 2) each.

    Args:
        faces: as ``faces_of`` returns them.
        cells: what its corners are returned as: the points at all corners of cells, (rows + 1,
            columns + 1, 2).

    Where four faces meet, at two solid cells that touch by a corner, an outline turns right, around
    the solid cell: no outline crosses itself.
    """
    rings = _rings(faces)
    areas = np.array([_area(ring) for ring in rings])
    outer = rings[int(areas.argmax())]
    regions = [rings[k] for k in np.flatnonzero(areas > 0)]
    obstacles = []
    for k in np.flatnonzero(areas < 0):
        beside = _beside(rings[k])
        around = [region for region in regions if _contains(region, beside)]
        if min(around, key=_area) is outer:
            obstacles.append(rings[k])
    place = [ring.astype(int) for ring in (outer, *obstacles)]
    first, *others = (cells[ring[:, 1], ring[:, 0]] for ring in place)
    return first, others


def _rings(faces: Floats) -> list[Floats]:
    """Join faces, end to start, to closed outlines."""
    starts: dict[tuple[float, float], list[int]] = {}
    for k, (x, y) in enumerate(faces[:, :2].tolist()):
        starts.setdefault((x, y), []).append(k)
    along, ends = faces[:, 2:] - faces[:, :2], [(x, y) for x, y in faces[:, 2:].tolist()]
    unused, rings = np.ones(len(faces), np.bool_), []
    for first in range(len(faces)):
        ring, k = [], first
        while unused[k]:
            unused[k] = False
            ring.append(k)
            dx, dy = along[k]
            # to the right, if there are two ways on
            k = max(starts[ends[k]], key=lambda o: dy * along[o, 0] - dx * along[o, 1])
        if ring:
            rings.append(faces[ring, :2])
    return rings


def _area(ring: Floats) -> float:
    x, y = ring.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def _beside(ring: Floats) -> Floats:
    """Return the centre of the open cell beside the start of an outline."""
    (x, y), (to_x, to_y) = ring[0], ring[1]
    dx, dy = np.sign(to_x - x), np.sign(to_y - y)
    return np.array([x + (dx - dy) / 2, y + (dy + dx) / 2])


def _contains(ring: Floats, point: Floats) -> bool:
    """Whether an outline goes around the centre of a cell: how many walls are to its right."""
    (x0, y0), (x1, y1) = ring.T, np.roll(ring, -1, axis=0).T
    crossed = (x0 == x1) & (x0 > point[0]) & ((y0 > point[1]) != (y1 > point[1]))
    return int(crossed.sum()) % 2 == 1
