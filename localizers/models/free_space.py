"""Poses in free space: evenly spread, or drawn."""

import numpy as np

from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Floats, Singles

_BLOCK = 1024
_COUNTED = 16 * _BLOCK  # points at which free space is measured
# Powers of the inverse of the root of g⁴ = g + 1: the additive recurrence of lowest known
# discrepancy in three dimensions (Roberts 2018).
_STEPS = np.array(
    [0.8191725133961644, 0.6710436067037892, 0.5497004779019702]
)  # written out, as NumPy's powers differ between processors


def even_poses(floor_plan: Map, count: int) -> Singles:
    """Return poses spread evenly over free space and headings, always the same, (3, count)."""
    found: list[Floats] = []
    start = 0
    while sum(map(len, found)) < count:  # a floor plan has free space
        found.append(_free(floor_plan, _even_shares(start, _BLOCK)))
        start += _BLOCK
    return np.ascontiguousarray(np.vstack(found)[:count].T, dtype=np.float32)


def random_poses(
    floor_plan: Map, count: int, rng: np.random.Generator, radius: float = 0.0
) -> Singles:
    """Draw poses uniformly over all headings and where a disc fits, (3, count)."""
    found = [np.empty((0, 3))]
    while sum(map(len, found)) < count:
        found.append(_free(floor_plan, rng.random((max(2 * count, 16), 3)), radius))
    return np.ascontiguousarray(np.vstack(found)[:count].T, dtype=np.float32)


def free_share(floor_plan: Map, radius: float) -> float:
    """Return the share of the map's bounds where a disc fits."""
    return len(_free(floor_plan, _even_shares(0, _COUNTED), radius)) / _COUNTED


def _even_shares(start: int, count: int) -> Floats:
    shares: Floats = (0.5 + np.arange(start, start + count)[:, None] * _STEPS) % 1.0
    return shares


def _free(floor_plan: Map, shares: Floats, radius: float = 0.0) -> Floats:
    """Those of the poses at ``shares`` of the bounds and of a turn where a disc fits, (k, 3)."""
    x0, y0, x1, y1 = floor_plan.bounds
    low, high = np.array([x0, y0, -np.pi]), np.array([x1, y1, np.pi])
    poses: Floats = low + (high - low) * shares
    return poses[floor_plan.free(poses, radius)]
