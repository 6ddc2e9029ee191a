"""Walls of a map of cells: faces joined to straight walls, and walls to closed outlines."""

from typing import Any

import numpy as np

from deqmcl_gym.maps.polygons import close_pairs, crossings, edges_of, folds_back, signed_area
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Bools, Floats, Indices


@compiled
def largest_region(solid: Bools) -> Bools:
    """Return the cells of the largest open region, connected by faces; the first if equal.

    Args:
        solid: which cells are, (rows, columns).
    """
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


@compiled
def keep_more(corners: Floats, tolerance: float, forced: Bools, kept: Bools) -> None:
    """Keep corners of a closed outline until the others can be left out (Douglas & Peucker 1973).

    A corner is left out if it is within ``tolerance`` of the edge that replaces it.

    Args:
        corners: (k, 2).
        tolerance: a length.
        forced: whether to split the edge from each corner once, whatever the distance, (k,).
        kept: which corners are kept, the first among them, (k,); updated.
    """
    ends = np.append(np.flatnonzero(kept), len(corners))
    stretches = [(ends[i], ends[i + 1], forced[ends[i]]) for i in range(len(ends) - 1)]
    while stretches:
        first, last, part = stretches.pop()
        x0, y0 = corners[first]
        x1, y1 = corners[last % len(corners)]
        dx, dy = x1 - x0, y1 - y0
        square, farthest, worst = dx * dx + dy * dy, 0.0, first
        for i in range(first + 1, last):
            x, y = corners[i, 0] - x0, corners[i, 1] - y0
            share = min(max((x * dx + y * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
            x, y = x - share * dx, y - share * dy
            if x * x + y * y > farthest:
                farthest, worst = x * x + y * y, i
        if worst > first and (part or farthest > tolerance * tolerance):
            kept[worst] = True
            stretches.append((first, worst, False))
            stretches.append((worst, last, False))


def faces_of(solid: Bools) -> Floats:
    """Return the faces between open and solid cells, joined where they are in a line.

    The edge of the map is solid.

    Args:
        solid: which cells are, (rows, columns).

    Returns:
        (x₀, y₀, x₁, y₁) in cells from the lower left corner, the open side to the left, (S, 4).
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
    """Return the outline of the largest open region, then those of the obstacles in it.

    The cells of a region are connected by faces; other regions count as solid. Where four faces
    meet, at two solid cells that touch at a corner, an outline turns right, around the solid cell.
    As the region is connected without that corner, no outline passes through a point twice.

    Args:
        solid: as ``faces_of``.

    Returns:
        Corners in cells from the lower left one, (k, 2) each.
    """
    rings = _rings(faces_of(~largest_region(solid)))
    return sorted(
        rings, key=lambda ring: -signed_area(ring.astype(np.float64))
    )  # all but the first are negative


def thinned(outlines: list[Indices], tolerance: float, apart: float) -> list[Indices]:
    """Leave out corners of outlines, so that no point moves by more than ``tolerance``.

    Corners are kept where an outline would vanish, touch itself or cross another one.

    Args:
        outlines: as ``outlines_of`` returns them.
        tolerance: in cells.
        apart: least distance between edges of an outline that share no corner, in cells.
    """
    kept = [np.arange(len(outline)) == 0 for outline in outlines]
    amiss, before = [np.ones(len(outline), np.bool_) for outline in outlines], 0
    while (count := sum(map(np.count_nonzero, kept))) > before:
        before = count
        for outline, some, bad in zip(outlines, kept, amiss, strict=True):
            if bad.any():
                keep_more(outline.astype(np.float64), tolerance, bad, some)
        for some, bad, found in zip(kept, amiss, _amiss(outlines, kept, apart), strict=True):
            bad[:] = False
            bad[some] = found
    return [outline[some] for outline, some in zip(outlines, kept, strict=True)]


def _amiss(outlines: list[Indices], kept: list[Bools], apart: float) -> list[Bools]:
    """Which edges between kept corners fold, touch or cross, or belong to fewer than three."""
    polygons = [o[some].astype(np.float64) for o, some in zip(outlines, kept, strict=True)]
    sizes = np.array([len(polygon) for polygon in polygons])
    whose = np.repeat(np.arange(sizes.size), sizes)
    ends = np.cumsum(sizes)
    following = np.arange(1, whose.size + 1)
    following[ends - 1] = ends - sizes
    edges = np.vstack([edges_of(polygon) for polygon in polygons])
    folds = folds_back(edges, edges[following], apart)
    amiss = (sizes < 3)[whose] | folds
    amiss[following[folds]] = True
    pairs = close_pairs(edges, apart)
    one, other = whose[pairs].T
    neighbours = (following[pairs] == pairs[:, ::-1]).any(axis=1)
    crossed = np.isfinite(crossings(edges, pairs)).all(axis=1)
    amiss[pairs[np.where(one == other, ~neighbours, crossed)]] = True
    return np.split(amiss, ends[:-1])


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
