"""Compiled search for an open region, and thinning of its outlines."""

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Bools, Floats


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
