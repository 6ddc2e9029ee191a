"""The compiled inner loop of the likelihood field."""

from typing import Any

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, sin64
from deqmcl_gym.numerics.exponential_kernels import exp64, logs64
from deqmcl_gym.numerics.types import Floats, Singles
from localizers.models.beam_kernels import fold

Scalar = Any  # a float64 inside a kernel
_POSES = 512  # looked at in one go


@compiled
def field_log_likelihood(
    states: Singles,
    ranges: Floats,
    bearings: Floats,
    field: Singles,
    grid: tuple[float, float, float],
    density: tuple[float, float, float, float],
    out: Floats,
) -> None:
    """Fill in Σ_b log(peak exp(-½ (d_b / σ)²) + floor), d_b: from the beam's end to a wall.

    Beyond the field, d is its edge's and the way to it.

    Args:
        states: rows x, y, θ, (3, n).
        ranges, bearings: of the usable beams, (B,).
        field: distances at the cells' centres, (Y, X).
        grid: centre (x, y) of the first cell, and a cell's edge.
        density: σ, peak, floor, and the largest d told apart.
        out: (n,).
    """
    low_x, low_y, cell = grid
    sigma, peak, floor, farthest = density
    together = fold(floor, peak + floor)
    product, right, up = np.empty(_POSES), np.empty(_POSES), np.empty(_POSES)
    sine, cosine = np.empty(_POSES), np.empty(_POSES)
    at, flat = np.empty(_POSES, np.int32), field.reshape(-1)
    last_row, last_column = field.shape[0] - 1.0, field.shape[1] - 1.0
    columns = np.int32(field.shape[1])
    for start in range(0, out.size, _POSES):
        end = min(start + _POSES, out.size)
        total = out[start:end]
        x, y, heading = states[0, start:end], states[1, start:end], states[2, start:end]
        total[:] = 0.0
        for i in range(total.size):
            cosine[i] = cos64(np.float64(heading[i]))
        for i in range(total.size):
            sine[i] = sin64(np.float64(heading[i]))
        for first in range(0, ranges.size, together):
            product[:] = 1.0
            for beam in range(first, min(first + together, ranges.size)):
                range_, bc, bs = ranges[beam], cos64(bearings[beam]), sin64(bearings[beam])
                for i in range(total.size):
                    right[i] = (x[i] + range_ * (cosine[i] * bc - sine[i] * bs) - low_x) / cell
                    up[i] = (y[i] + range_ * (sine[i] * bc + cosine[i] * bs) - low_y) / cell
                for i in range(total.size):
                    column, row = _within(right[i], last_column), _within(up[i], last_row)
                    at[i] = np.int32(row + 0.5) * columns + np.int32(column + 0.5)
                    beside = _beyond(right[i] - column) ** 2 + _beyond(up[i] - row) ** 2
                    right[i] = cell * np.sqrt(beside)
                for i in range(total.size):
                    up[i] = flat[at[i]]
                for i in range(total.size):
                    distance = up[i] + right[i]
                    z = (distance if distance < farthest else farthest) / sigma
                    product[i] *= peak * exp64(-0.5 * z * z) + floor
            logs64(product[: total.size], right[: total.size])
            for i in range(total.size):
                total[i] += right[i]


@compiled
def _within(index: Scalar, last: Scalar) -> Scalar:
    """Return the nearest index that the field has."""
    low: Scalar = index if index > 0.0 else 0.0
    return low if low < last else last


@compiled
def _beyond(apart: Scalar) -> Scalar:
    """Return how much further than half a cell that is."""
    over: Scalar = abs(apart) - 0.5
    return over if over > 0.0 else 0.0
