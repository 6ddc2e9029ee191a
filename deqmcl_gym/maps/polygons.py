"""Checks of polygons, their edges with free space to the left, and cells outlined as polygons."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from deqmcl_gym.maps.map import Box
from deqmcl_gym.numerics import Bools, Floats, Indices
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.validation import InputError, array, digits, shown


@compiled
def _pairs_within(edges: Floats, by_x: Indices, within: float) -> Indices:
    """Return all pairs of edges (S, 4), sorted by the smaller x, this near or crossing, (k, 2)."""
    found, count = np.empty((64, 2), np.intp), 0
    for k in range(by_x.size):
        i = by_x[k]
        x0, y0, x1, y1 = edges[i]
        right, low, high = max(x0, x1) + within, min(y0, y1) - within, max(y0, y1) + within
        for other in range(k + 1, by_x.size):
            j = by_x[other]
            u0, v0, u1, v1 = edges[j]
            if min(u0, u1) > right:
                break
            if min(v0, v1) > high or max(v0, v1) < low:
                continue
            if _apart(edges[i], edges[j], within):
                continue
            if count == len(found):
                found = np.vstack((found, found))
            found[count, 0], found[count, 1] = i, j
            count += 1
    return found[:count].copy()


@compiled
def _apart(a: Floats, b: Floats, within: float) -> bool:
    """Whether two edges neither cross nor come as near as ``within``."""
    first, second = _side(a, b[0], b[1]), _side(a, b[2], b[3])
    third, fourth = _side(b, a[0], a[1]), _side(b, a[2], a[3])
    if first * second < 0.0 and third * fourth < 0.0:
        return False
    a_b = min(_square(a, b[0], b[1]), _square(a, b[2], b[3]))
    b_a = min(_square(b, a[0], a[1]), _square(b, a[2], a[3]))
    return within == 0.0 or min(a_b, b_a) > within * within


@compiled
def _side(edge: Floats, x: float, y: float) -> float:
    """Side of an edge's line on which a point lies: -1, 0 or 1."""
    left = (edge[2] - edge[0]) * (y - edge[1]) - (edge[3] - edge[1]) * (x - edge[0])
    side: float = np.sign(left)  # a product of two areas may underflow
    return side


@compiled
def _square(edge: Floats, x: float, y: float) -> float:
    """Squared distance between a point and an edge."""
    dx, dy = edge[2] - edge[0], edge[3] - edge[1]
    px, py = x - edge[0], y - edge[1]
    share = min(max((px * dx + py * dy) / (dx * dx + dy * dy), 0.0), 1.0)
    px, py = px - share * dx, py - share * dy
    square: float = px * px + py * py
    return square


@compiled
def finds_free_space(walls: Floats, levels: Floats, least: float) -> bool:
    """Whether the walls wind once around a stretch of a level wider than ``least``.

    Walls are (x₀, y₀, x₁, y₁), free space to their left, (S, 4), levels heights at which none
    begins, ends or crosses another one.
    """
    at, turns = np.empty(len(walls)), np.empty(len(walls), np.intp)
    for level in levels:
        count = 0
        for x0, y0, x1, y1 in walls:
            if (y0 <= level) != (y1 <= level):
                at[count] = x0 + (level - y0) / (y1 - y0) * (x1 - x0)
                turns[count] = 1 if y1 < y0 else -1
                count += 1
        order = np.argsort(at[:count])
        winding = 0
        for k in range(count - 1):
            winding += turns[order[k]]
            if winding == 1 and at[order[k + 1]] - at[order[k]] > least:
                return True
    return False


Polygon = Sequence[tuple[float, float]]

_ROUNDING = 1e-12  # error of heights, as a share of the floor plan's


def parse_polygon(
    name: str, polygon: Any, shortest: float, farthest: float
) -> tuple[tuple[float, float], ...]:
    """Return the corners of a simple polygon, no coordinate above ``farthest``.

    No edge is shorter than ``shortest``, and no two that share no corner are nearer than that.
    """
    try:
        corners = array(name, list(polygon), (None, 2))
    except TypeError:
        raise InputError(
            f"{name} is {shown(polygon)}, but must be a list of (x, y) corners."
        ) from None
    if len(corners) < 3:
        raise InputError(f"{name} has {len(corners)} corners, but a polygon needs 3 or more.")
    if (far := np.flatnonzero(np.abs(corners).max(axis=1) > farthest)).size:
        raise InputError(
            f"{name} has the corner {_point(corners[far[0]])}, but coordinates of more than "
            f"{farthest:g} are too coarse in float64: move the floor plan towards (0, 0)."
        )
    edges = edges_of(corners)
    lengths = np.sqrt(((edges[:, 2:] - edges[:, :2]) ** 2).sum(axis=1))
    if (short := np.flatnonzero(lengths < shortest)).size:
        raise InputError(
            f"{name} has an edge of zero length at {_point(corners[short[0]])}: name each corner "
            "once; the last corner is joined to the first by itself."
        )
    _check_simple(name, edges, shortest)
    return tuple((x, y) for x, y in corners.tolist())


def _check_simple(name: str, edges: Floats, shortest: float) -> None:
    if (folds := np.flatnonzero(folds_back(edges, np.roll(edges, -1, axis=0), shortest))).size:
        corner = (folds[0] + 1) % len(edges)
        raise InputError(
            f"{name} folds back on itself at corner {corner}, {_point(edges[corner, :2])}: leave "
            "that corner out, or give the wall some thickness."
        )
    pairs = close_pairs(edges, shortest)
    apart = pairs[:, 1] - pairs[:, 0]
    strangers = pairs[(apart > 1) & (apart < len(edges) - 1)]  # share no corner
    if strangers.size:
        nearest = strangers[np.lexsort(strangers.T[::-1])[:1]]
        first, second = nearest[0].tolist()
        if np.isfinite(crossings(edges, nearest)).all():
            raise InputError(
                f"{name} crosses itself between edges {first} and {second}: give its corners in "
                "order around it."
            )
        raise InputError(
            f"{name} touches itself: edge {first} from {_point(edges[first, :2])} and edge "
            f"{second} from {_point(edges[second, :2])} are nearer than {shortest:g}; move a "
            "corner, or give two polygons."
        )


def folds_back(edges: Floats, following: Floats, least: float) -> Bools:
    """Whether edges (S, 4) and the edges that follow them overlap, (S,)."""
    along, after = edges[:, 2:] - edges[:, :2], following[:, 2:] - following[:, :2]
    longer = np.sqrt(np.maximum((along**2).sum(axis=1), (after**2).sum(axis=1)))
    across = np.abs(along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0])
    # how far the far end of the shorter edge is from the longer one
    folds: Bools = ((along * after).sum(axis=1) < 0.0) & (across < least * longer)
    return folds


def close_pairs(edges: Floats, within: float) -> Indices:
    """Return the pairs (i, j), i < j, of edges (S, 4) less than ``within`` apart, (k, 2)."""
    by_x = np.argsort(np.minimum(edges[:, 0], edges[:, 2]), kind="stable")
    return np.sort(_pairs_within(edges, by_x, within), axis=1)


def crossings(edges: Floats, pairs: Indices) -> Floats:
    """Return the points where pairs (k, 2) of edges (S, 4) cross, NaN where not inside, (k, 2)."""
    a, b = edges[pairs[:, 0]], edges[pairs[:, 1]]
    u, v = a[:, 2:] - a[:, :2], b[:, 2:] - b[:, :2]
    to_b = b[:, :2] - a[:, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        parallel = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        s = (to_b[:, 0] * v[:, 1] - to_b[:, 1] * v[:, 0]) / parallel
        t = (to_b[:, 0] * u[:, 1] - to_b[:, 1] * u[:, 0]) / parallel
        inside = (s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)
        found: Floats = np.where(inside[:, None], a[:, :2] + s[:, None] * u, np.nan)
    return found


def has_free_space(walls: Floats, least: float) -> bool:
    """Whether the walls (S, 4) wind once around a place wider than ``least``.

    Between two heights at which walls begin, end or cross, free space is a set of trapezia, and the
    line half-way up meets each of them.
    """
    points = crossings(walls, close_pairs(walls, 0.0))
    heights = np.unique(np.concatenate([walls[:, 1], points[np.isfinite(points[:, 1]), 1]]))
    depths = np.diff(heights)
    levels = heights[:-1] + depths / 2
    by_depth = np.argsort(-depths, kind="stable")  # the deepest first, without rounding errors
    real = by_depth[depths[by_depth] > _ROUNDING * (heights[-1] - heights[0])]
    return finds_free_space(walls, levels[real], least)


def oriented_edges(polygon: Polygon, *, solid: bool) -> Floats:
    """Return the edges (S, 4), counterclockwise, or clockwise if the polygon is ``solid``."""
    corners = np.array(polygon)
    clockwise = signed_area(corners) < 0
    return edges_of(corners if clockwise == solid else corners[::-1])


def as_box(polygon: Polygon) -> Box | None:
    """Return (x_low, y_low, x_high, y_high) if the polygon is an axis-aligned rectangle."""
    if len(polygon) != 4:
        return None
    (x0, y0), (x1, y1) = np.min(polygon, axis=0).tolist(), np.max(polygon, axis=0).tolist()
    corners = {(x, y) for x in (x0, x1) for y in (y0, y1)}
    return (x0, y0, x1, y1) if set(polygon) == corners else None


def signed_area(points: Floats) -> float:
    """½ Σ (x_i y_{i+1} - x_{i+1} y_i), positive if counterclockwise."""
    x, y = (points - points[0]).T  # relative to a corner: no cancellation far from (0, 0)
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2


def edges_of(corners: Floats) -> Floats:
    """Return the edges (S, 4) of a polygon, (S, 2)."""
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def _point(corner: Floats) -> str:
    x, y = corner[:2].tolist()
    return f"({digits(x)}, {digits(y)})"


@compiled
def largest_region(solid: Bools) -> Bools:
    """Return the cells of the largest open region, connected by faces; the first if equal."""
    rows, columns = solid.shape
    region = np.zeros((rows, columns), np.int32)  # numbers from 1 on
    waiting = np.empty(solid.size, np.int32)
    largest, most, number = 0, 0, 0
    for start in range(solid.size):
        if solid.flat[start] or region.flat[start]:
            continue
        number += 1
        region.flat[start], waiting[0], found, done = number, start, 1, 0
        while done < found:
            row, column = divmod(waiting[done], columns)
            done += 1
            for up, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                i, j = row + up, column + right
                if 0 <= i < rows and 0 <= j < columns and not solid[i, j] and not region[i, j]:
                    region[i, j], waiting[found] = number, i * columns + j
                    found += 1
        if found > most:
            largest, most = number, found
    inside: Bools = region == largest
    return inside


def faces_of(solid: Bools) -> Floats:
    """Return the faces between open and solid cells, joined where they are in a line, (S, 4).

    The edge of the map is solid. (x₀, y₀, x₁, y₁) are in cells from the lower left corner, the open
    side to the left.
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


def outlines_of(solid: Bools) -> list[Indices]:
    """Return the outline of the largest open region, then those of its obstacles, (k, 2) each.

    The cells of a region are connected by faces; other regions count as solid. Where four faces
    meet, at two solid cells that touch at a corner, an outline turns right, around the solid cell.
    As the region is connected without that corner, no outline passes through a point twice. Corners
    are in cells from the lower left one.
    """
    rings = _rings(faces_of(~largest_region(solid)))
    return sorted(
        rings, key=lambda ring: -signed_area(ring.astype(np.float64))
    )  # all but the first are negative


def _rings(faces: Floats) -> list[Indices]:
    """Join faces, end to start, to closed outlines."""
    along = (faces[:, 2:] - faces[:, :2]).tolist()
    leaving: dict[tuple[float, ...], list[int]] = {}
    for k, start in enumerate(map(tuple, faces[:, :2].tolist())):
        leaving.setdefault(start, []).append(k)

    def after(k: int, end: tuple[float, ...]) -> int:
        dx, dy = along[k]  # to the right, if there are two ways on
        return max(leaving[end], key=lambda o: dy * along[o][0] - dx * along[o][1])

    following = [after(k, end) for k, end in enumerate(map(tuple, faces[:, 2:].tolist()))]
    unused, rings = [True] * len(faces), []
    for first in range(len(faces)):
        ring, k = [], first
        while unused[k]:
            unused[k] = False
            ring.append(k)
            k = following[k]
        if ring:
            rings.append(faces[ring, :2].astype(np.intp))
    return rings
