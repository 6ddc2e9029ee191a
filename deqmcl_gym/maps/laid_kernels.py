"""The compiled geometry of one path laid from many poses: its points, and its collisions."""

from typing import Any

import numpy as np

from deqmcl_gym.maps.kernels import BLOCK, Clearance, look_up, sweep, wind
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import sincos32
from deqmcl_gym.numerics.types import Ints, Singles

_ZERO = np.float32(0.0)


@compiled
def put(rows: Singles, point: Singles, out: Singles) -> None:
    """Fill in (x, y) + R(θ) p, (2+, n), for rows x, y, cos θ, sin θ, (4, n)."""
    px, py = point[0], point[1]
    x, y, cosines, sines = rows[0], rows[1], rows[2], rows[3]
    for i in range(x.size):
        out[0, i] = x[i] + (cosines[i] * px - sines[i] * py)
    for i in range(x.size):
        out[1, i] = y[i] + (sines[i] * px + cosines[i] * py)


@compiled
def directed(poses: Singles, out: Singles) -> None:
    """Fill in rows x, y, cos θ, sin θ, (4, n), of poses (3, n)."""
    out[:2] = poses[:2]
    sincos32(poses[2], out[3], out[2])


@compiled
def laid(poses: Singles, path: Singles, out: Singles) -> None:
    """Fill in the points of a path that begins at each pose.

    Args:
        poses: rows x, y, θ, (3, n).
        path: points in the frame of the pose, (k, 2).
        out: rows x, y of each point, (k, 2, n).
    """
    rows = np.empty((4, poses.shape[1]), np.float32)
    directed(poses, rows)
    for k in range(len(path)):
        put(rows, path[k], out[k])


@compiled
def _look_closely(
    paths: Singles, owners: Ints, walls: Singles, radius: np.float32, hits: Ints
) -> None:
    """Count colliding steps, rows x, y, x', y', (4, k), for their ``owners``, (k,)."""
    starts, ends = paths[:2].copy(), paths[2:].copy()
    square, windings = np.empty(owners.size, np.float32), np.empty(owners.size, np.int32)
    sweep(starts, ends, walls, square)
    wind(ends, walls, windings)
    for k in range(owners.size):
        hits[owners[k]] += not ((square[k] > radius * radius) & (windings[k] == 1))


@compiled
def collisions(
    poses: Singles,
    path: Singles,
    walls: Singles,
    radius: np.float32,
    clearance: tuple[Any, ...],
    out: Ints,
) -> None:
    """Fill in the number of steps that collide on a path laid from each pose; see ``feasible``.

    Steps for which the bounds do not decide are compared with the walls, many at a time.

    Args:
        poses: rows x, y, θ, (3, n).
        path: points in the frame of the pose, (k + 1, 2), k ≥ 1.
        walls, radius, clearance: as ``feasible``.
        out: (n,).
    """
    n, grid = poses.shape[1], Clearance(*clearance)
    squares = np.empty(BLOCK, np.int32)
    open_steps, owners = np.empty((4, 2 * BLOCK), np.float32), np.empty(2 * BLOCK, np.int32)
    unsure, chosen = 0, np.empty(BLOCK, np.int32)
    out[:] = 0
    for start in range(0, n, BLOCK):
        size = min(BLOCK, n - start)
        rows, hits = np.empty((4, size), np.float32), out[start : start + size]
        directed(poses[:, start : start + size].copy(), rows)
        here, there = np.empty((2, size), np.float32), np.empty((2, size), np.float32)
        before, after = np.empty(size, np.float32), np.empty(size, np.float32)
        put(rows, path[0], here)
        look_up(here, grid, squares[:size], before)
        for step in range(len(path) - 1):
            put(rows, path[step + 1], there)
            look_up(there, grid, squares[:size], after)
            dx, dy = path[step + 1, 0] - path[step, 0], path[step + 1, 1] - path[step, 1]
            needed = np.sqrt(dx * dx + dy * dy) + (radius + radius)
            for i in range(size):
                hits[i] += after[i] < _ZERO
            count = 0
            for i in range(size):
                chosen[count] = i
                count += not ((before[i] + after[i] > needed) | (after[i] < _ZERO))
            for k in range(count):
                i = chosen[k]
                open_steps[0, unsure + k], open_steps[1, unsure + k] = here[0, i], here[1, i]
                open_steps[2, unsure + k], open_steps[3, unsure + k] = there[0, i], there[1, i]
                owners[unsure + k] = start + i
            unsure += count
            if unsure >= BLOCK:
                _look_closely(open_steps[:, :unsure], owners[:unsure], walls, radius, out)
                unsure = 0
            here, there, before, after = there, here, after, before
    _look_closely(open_steps[:, :unsure], owners[:unsure], walls, radius, out)
