"""The compiled inner loops of Nav2's scan models."""

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, sin64
from deqmcl_gym.numerics.exponential_kernels import exp64, log64
from deqmcl_gym.numerics.types import Floats, Singles


@compiled
def table_at_ends(
    origins: Singles,
    ranges: Floats,
    bearings: Floats,
    table: Singles,
    frame: tuple[float, float, float, float, float],
    out: Singles,
) -> None:
    """Fill in the table's value at the cell that each beam ends in; inf off the table.

    Args:
        origins: of the beams, rows x, y, θ, (3, n).
        ranges, bearings: (B,).
        table: of square cells, (rows, columns), the lowest row first.
        frame: lower left corner (x, y) of the first cell, cos and sin of the table's yaw, and a
            cell's edge.
        out: (B, n).
    """
    x0, y0, cos_yaw, sin_yaw, cell = frame
    rows, columns = table.shape
    n = origins.shape[1]
    flat = table.reshape(-1)
    cosine, sine = np.empty(n), np.empty(n)
    right, up = np.empty(n), np.empty(n)
    for i in range(n):
        heading = np.float64(origins[2, i])
        cosine[i], sine[i] = cos64(heading), sin64(heading)
    for beam in range(ranges.size):
        ahead, aside = ranges[beam] * cos64(bearings[beam]), ranges[beam] * sin64(bearings[beam])
        for i in range(n):
            u = origins[0, i] + (cosine[i] * ahead - sine[i] * aside) - x0
            v = origins[1, i] + (sine[i] * ahead + cosine[i] * aside) - y0
            right[i] = np.floor((cos_yaw * u + sin_yaw * v) / cell)
            up[i] = np.floor((cos_yaw * v - sin_yaw * u) / cell)
        for i in range(n):
            inside = (right[i] >= 0) & (right[i] < columns) & (up[i] >= 0) & (up[i] < rows)
            at = int(up[i]) * columns + int(right[i]) if inside else 0
            out[beam, i] = flat[at] if inside else np.float32(np.inf)


@compiled
def sum_of_cubes(
    squares: Singles, cut: float, scale: float, hit: float, rand: float, out: Floats
) -> None:
    """Fill in log(1 + Σ_b q³), q = hit exp(scale min(d², cut)) + rand, of squares d² (B, n)."""
    out[:] = 1.0
    for beam in range(squares.shape[0]):
        for i in range(out.size):
            square = np.float64(squares[beam, i])
            q = hit * exp64(scale * (square if square < cut else cut)) + rand
            out[i] += q * q * q
    for i in range(out.size):
        out[i] = log64(out[i])


@compiled
def log_product(
    squares: Singles, cut: float, scale: float, hit: float, rand: float, out: Floats
) -> None:
    """Fill in Σ_b log q; the rest as ``sum_of_cubes``."""
    out[:] = 0.0
    for beam in range(squares.shape[0]):
        for i in range(out.size):
            square = np.float64(squares[beam, i])
            q = hit * exp64(scale * (square if square < cut else cut)) + rand
            out[i] += log64(q) if q > 0.0 else -np.inf


@compiled
def beams_cubed(
    ranges: Floats,
    expected: Singles,
    metres: float,
    shares: tuple[float, float, float, float],
    model: tuple[float, float, float],
    out: Floats,
) -> None:
    """Fill in log(1 + Σ_b q³), q: the four parts of a beam; see ``BeamCubes``.

    Args:
        ranges: m, (B,).
        expected: by the map, in its unit, NaN outside, which counts as 0, (B, n).
        metres: in a unit of the map.
        shares: z_hit, z_short, z_max, z_rand.
        model: max_range, m; σ, m; λ, 1/m.
        out: (n,).
    """
    z_hit, z_short, z_max, z_rand = shares
    max_range, sigma, decay = model
    scale = -0.5 / (sigma * sigma)
    out[:] = 1.0
    for beam in range(ranges.size):
        told = ranges[beam]
        short = z_short * decay * exp64(-decay * told)
        anyway = z_max if told == max_range else 0.0
        anyway += z_rand / max_range if told < max_range else 0.0
        for i in range(out.size):
            seen = metres * expected[beam, i]
            seen = min(seen, max_range) if seen > 0.0 else 0.0  # also if it is NaN
            z = told - seen
            q = z_hit * exp64(scale * (z * z)) + anyway + (short if z < 0.0 else 0.0)
            out[i] += q * q * q
    for i in range(out.size):
        out[i] = log64(out[i])
