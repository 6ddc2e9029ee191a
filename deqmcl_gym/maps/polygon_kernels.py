"""Compiled checks of polygons of many corners, in memory proportional to them; float64."""

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Floats, Indices


@compiled
def close_pairs(edges: Floats, by_x: Indices, within: float) -> Indices:
    """Return all pairs of edges nearer to each other than ``within``, or crossing, (k, 2).

    A sweep along x: an edge is compared with those that begin before it ends.

    Args:
        edges: (x₀, y₀, x₁, y₁), (S, 4).
        by_x: their indices, sorted by the smaller x.
        within: a distance, 0 or more.
    """
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

    Args:
        walls: (x₀, y₀, x₁, y₁), free space to their left, (S, 4).
        levels: heights at which no wall begins, ends or crosses another one.
        least: a width.
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
