"""The compiled search of shortest ways over free cells, exact whatever order it takes."""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Floats, Indices

Numbers = NDArray[np.int64]
_RING = 16  # buckets: a step costs less than 5 √2 + 1 of them
_DIAGONAL = np.sqrt(2.0)


@compiled
def fill_costs(dear: Floats, numbers: Numbers, cell: float, goal: int, out: Floats) -> None:
    """Fill in the least cost from each free cell to the goal, ∞ without a way.

    Dijkstra's algorithm with buckets of width ``cell`` (Dial, 1969). A step from a to b costs its
    length times the mean of what a and b cost. Sums of floats grow with either term, so the least
    one over all ways is the same in any order of the search.

    Args:
        dear: cost per step of each cell, from ``cell`` to 5 ``cell``, (rows, columns).
        numbers: of free cells, -1 elsewhere, with a ring of -1 around them, (rows, columns).
        cell: edge of a cell.
        goal: number of its cell.
        out: ∞, (n,); filled in.
    """
    rows, columns = numbers.shape
    places = np.empty(out.size, np.int64)
    for row in range(rows):
        for column in range(columns):
            if numbers[row, column] >= 0:
                places[numbers[row, column]] = row * columns + column
    worth, number = dear.ravel(), numbers.ravel()
    away = np.array([1, -1, columns, -columns, columns + 1, -columns - 1, columns - 1, 1 - columns])
    first = np.full(_RING, -1, np.int64)  # entry of each bucket, and of each the next one
    after, held = np.empty(8 * out.size + 1, np.int64), np.empty(8 * out.size + 1, np.int64)
    unused, used, waiting = np.int64(-1), 0, 0
    done = np.zeros(out.size, np.bool_)
    out[goal] = 0.0
    held[0], after[0], first[0], used, waiting = goal, -1, 0, 1, 1
    bucket = 0
    while waiting > 0:
        ring = bucket % _RING
        while first[ring] >= 0:
            entry = first[ring]
            first[ring] = after[entry]
            after[entry], unused = unused, entry
            waiting -= 1
            here = held[entry]
            if done[here]:  # at less cost
                continue
            done[here] = True
            at = places[here]
            for way in range(8):
                there = number[at + away[way]]
                if there < 0:
                    continue
                cost = out[here] + _step(worth[at], worth[at + away[way]], way)
                if cost < out[there]:
                    out[there], done[there] = cost, False
                    if unused >= 0:
                        entry, unused = unused, after[unused]
                    else:
                        entry, used = np.int64(used), used + 1
                    into = int(cost / cell) % _RING
                    held[entry], after[entry], first[into] = there, first[into], entry
                    waiting += 1
        bucket += 1


@compiled
def fill_following(dear: Floats, numbers: Numbers, costs: Floats, out: Indices) -> None:
    """Fill in the next cell of the way from each cell to the goal; -1 at it, or without one.

    Of those that lead there at equal cost it is the nearest to the goal, and of these the last.

    Args:
        dear, numbers: as :func:`fill_costs`.
        costs: as it fills them in.
        out: (n,).
    """
    columns = numbers.shape[1]
    worth, number = dear.ravel(), numbers.ravel()
    away = np.array([1, -1, columns, -columns, columns + 1, -columns - 1, columns - 1, 1 - columns])
    for at in range(number.size):
        here = number[at]
        if here < 0:
            continue
        out[here], least = -1, np.inf
        if costs[here] == np.inf:
            continue
        for way in range(8):
            there = number[at + away[way]]
            if there < 0:
                continue
            if costs[there] + _step(worth[at], worth[at + away[way]], way) != costs[here]:
                continue
            nearer = costs[there] < least or (costs[there] == least and there > out[here])
            if nearer:
                out[here], least = there, costs[there]


@compiled
def _step(here: float, there: float, way: int) -> float:
    """Cost of a step between two cells; the first four ways are along the axes."""
    return (1.0 if way < 4 else _DIAGONAL) * (here + there) / 2
