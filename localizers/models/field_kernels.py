"""The compiled inner loops of the likelihood field: distances to walls on a grid, and look-ups."""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, exp64, log64, sin64
from deqmcl_gym.numerics.types import Bools, Floats, Singles


@compiled
def _lower_envelope(
    heights: Floats, centres: NDArray[np.int64], edges: Floats, out: Floats
) -> None:
    """out[q] = min_p (q - p)² + heights[p], by the lower envelope of the parabolas."""
    n = heights.size
    last = -1
    for q in range(n):
        if not heights[q] < np.inf:
            continue
        edge = -np.inf
        while last >= 0:
            p = centres[last]
            edge = ((heights[q] + q * q) - (heights[p] + p * p)) / (2.0 * (q - p))
            if edge > edges[last]:
                break
            last -= 1
        last += 1
        centres[last] = q
        edges[last] = edge if last > 0 else -np.inf
    if last < 0:
        out[:] = np.inf
        return
    k = 0
    for q in range(n):
        while k < last and edges[k + 1] < q:
            k += 1
        out[q] = (q - centres[k]) * (q - centres[k]) + heights[centres[k]]


@compiled
def distances(walls: Bools, cell: float, out: Singles) -> None:
    """Fill in each cell's distance to the nearest wall cell, centre to centre, (Y, X) px.

    The exact Euclidean distance transform of Felzenszwalb & Huttenlocher (2012).
    """
    rows, columns = walls.shape
    longest = max(rows, columns)
    squares = np.empty((rows, columns))
    centres, edges = np.empty(longest, np.int64), np.empty(longest)
    column, line = np.empty(rows), np.empty(rows)
    for x in range(columns):
        for y in range(rows):
            column[y] = 0.0 if walls[y, x] else np.inf
        _lower_envelope(column, centres, edges, line)
        for y in range(rows):
            squares[y, x] = line[y]
    row = np.empty(columns)
    for y in range(rows):
        _lower_envelope(squares[y], centres, edges, row)
        for x in range(columns):
            out[y, x] = cell * np.sqrt(row[x])


@compiled
def field_log_likelihood(
    states: Singles,
    ranges: Floats,
    bearings: Floats,
    field: Singles,
    low_x: float,
    low_y: float,
    cell: float,
    farthest: float,
    sigma: float,
    peak: float,
    floor: float,
    out: Floats,
) -> None:
    """Fill in Σ_b log(peak exp(-½ (d_b / σ)²) + floor), d_b: from the beam's end to a wall.

    Args:
        states: rows x px, y px, θ rad, (3, n).
        ranges, bearings: of the usable beams, (B,) px, rad.
        field: distances at the cells' centres, (Y, X) px.
        low_x, low_y: centre of the first cell, px.
        cell: px.
        farthest: largest distance, px; beyond the field, its edge's plus the way to it.
        out: (n,).
    """
    rows, columns = field.shape
    for i in range(states.shape[1]):
        total = 0.0
        for b in range(ranges.size):
            angle = np.float64(states[2, i]) + bearings[b]
            x = states[0, i] + ranges[b] * cos64(angle)
            y = states[1, i] + ranges[b] * sin64(angle)
            right, up = (x - low_x) / cell, (y - low_y) / cell
            column = min(max(right, 0.0), columns - 1.0)
            row = min(max(up, 0.0), rows - 1.0)
            beside = cell * np.sqrt(
                max(abs(right - column) - 0.5, 0.0) ** 2 + max(abs(up - row) - 0.5, 0.0) ** 2
            )
            distance = min(field[int(row + 0.5), int(column + 0.5)] + beside, farthest)
            z = distance / sigma
            total += log64(peak * exp64(-0.5 * z * z) + floor)
        out[i] = total
