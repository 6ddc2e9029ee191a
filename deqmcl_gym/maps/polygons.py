"""What a wall must be: a simple polygon, oriented so that free space lies to its left."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from deqmcl_gym.maps.map import Box
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, array

Polygon = Sequence[tuple[float, float]]
_BLOCK = 512  # edges held against others at a time


def parse_polygon(name: str, polygon: Any, shortest: float) -> tuple[tuple[float, float], ...]:
    """Return the corners of a simple polygon with edges of length ``shortest`` or more.

    Raises:
        InputError: fewer than three corners, NaN, an edge of zero length, or edges that cross.
    """
    try:
        corners = array(name, list(polygon), (None, 2))
    except TypeError:
        raise InputError(f"{name} is {polygon!r}, but must be a list of (x, y) corners.") from None
    if len(corners) < 3:
        raise InputError(f"{name} has {len(corners)} corners, but a wall needs 3 or more.")
    edges = _edges(corners)
    lengths = np.hypot(edges[:, 2] - edges[:, 0], edges[:, 3] - edges[:, 1])
    if (short := np.flatnonzero(lengths < shortest)).size:
        x, y = corners[short[0]]
        raise InputError(
            f"{name} has an edge of zero length at ({x:g}, {y:g}): name each corner once; "
            "the last corner is joined to the first by itself."
        )
    if (crossing := _first_crossing(edges)) is not None:
        raise InputError(
            f"{name} crosses itself between edges {crossing[0]} and {crossing[1]}: "
            "give its corners in order around it."
        )
    return tuple((float(x), float(y)) for x, y in corners)


def oriented_edges(polygon: Polygon, *, solid: bool) -> Floats:
    """Return the edges (S, 4), counterclockwise, or clockwise around something ``solid``."""
    corners = np.array(polygon)
    clockwise = signed_area(corners) < 0
    return _edges(corners if clockwise == solid else corners[::-1])


def as_box(polygon: Polygon) -> Box | None:
    """Return (x_low, y_low, x_high, y_high) if the polygon is an axis-aligned rectangle."""
    (x0, y0), (x1, y1) = np.min(polygon, axis=0).tolist(), np.max(polygon, axis=0).tolist()
    corners = {(x, y) for x in (x0, x1) for y in (y0, y1)}
    return (x0, y0, x1, y1) if len(polygon) == 4 and set(polygon) == corners else None


def signed_area(points: Floats) -> float:
    """½ Σ (x_i y_{i+1} - x_{i+1} y_i), positive if counterclockwise."""
    x, y = points.T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2


def _edges(corners: Floats) -> Floats:
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def _first_crossing(edges: Floats) -> tuple[int, int] | None:
    """Return the numbers of two edges that cross; each is held against those beside it alone."""
    x = np.sort(edges[:, [0, 2]], axis=1)
    order = np.argsort(x[:, 0], kind="stable")
    found: list[tuple[int, int]] = []
    for start in range(0, len(edges), _BLOCK):
        block = order[start : start + _BLOCK]
        beside = order[start:][x[order[start:], 0] <= x[block, 1].max()]
        apart = _sides(edges[block], edges[beside])
        straddles = _sides(edges[beside], edges[block]).T
        first, second = np.nonzero((apart < 0) & (straddles < 0))
        pairs = np.sort(np.column_stack([block[first], beside[second]]), axis=1)
        found += [(i, j) for i, j in pairs.tolist()]
    return min(found, default=None)


def _sides(lines: Floats, edges: Floats) -> Floats:
    """Whether edge j (column) straddles the line of edge i (row): below 0 if it does."""
    start, along = lines[:, None, :2], lines[:, None, 2:] - lines[:, None, :2]

    def side(points: Floats) -> Floats:
        offset = points[None] - start
        return np.sign(along[..., 0] * offset[..., 1] - along[..., 1] * offset[..., 0])

    apart: Floats = side(edges[:, :2]) * side(edges[:, 2:])
    return apart
