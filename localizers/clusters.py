"""The best cluster of a belief: what it would answer if it had to name one place."""

from dataclasses import dataclass

import numpy as np

from deqmcl_gym.maps.units import pixel
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Reals
from localizers.api import mean_pose

CELL = 50.0  # px: 1 m
SECTORS = 12  # of 30°


@dataclass(frozen=True)
class Cluster:
    """Some points of a belief.

    Attributes:
        mean: their pose (x, y, θ).
        share: of the belief's weight.
    """

    mean: tuple[float, float, float]
    share: float


def best_cluster(poses: Reals, weights: Floats, *, unit: str) -> Cluster:
    """Return the points in the heaviest cell, 1 m × 1 m × 30°, and in the 26 around it.

    The same rule for every method, as a mean of two places is neither. Of cells of one weight the
    first by x, y, heading counts.

    Args:
        poses: (n, 3).
        weights: (n,), of sum 1.
        unit: of lengths; a metre is 50 px.
    """
    at = np.asarray(poses, dtype=np.float64)
    cells = np.floor(at[:, :2] / (CELL * pixel(unit))).astype(np.int64)
    turned = (arrays.wrapped(at[:, 2]) + np.pi) * (SECTORS / (2 * np.pi))
    sectors = np.floor(turned).astype(np.int64) % SECTORS
    column, row = (cells - cells.min(axis=0)).T
    number = (column * (row.max() + 1) + row) * SECTORS + sectors  # one integer sorts quickly
    _, first, cell = np.unique(number, return_index=True, return_inverse=True)
    heaviest = first[np.bincount(cell, weights).argmax()]
    apart = (sectors - sectors[heaviest] + 1) % SECTORS
    near = (np.abs(cells - cells[heaviest]) <= 1).all(axis=1) & (apart <= 2)
    share = float(weights[near].sum())
    return Cluster(mean_pose(at[near], weights[near] / share), share)
