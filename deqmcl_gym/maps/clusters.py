"""Clusters of weighted poses on a map: where a belief says that the robot is, and where else."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Bools, Floats, Indices, Reals, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import wrapped64

SECTORS = 12  # of 30°
_COUNTED = 2**20  # cells whose weights are counted in one table


def drawn_poses(poses: Reals, weights: Floats, n: int, rng: np.random.Generator) -> Reals:
    """Draw n of the poses (k, 3) in proportion to their weights, whatever their sum, (n, 3)."""
    shares = np.cumsum(weights, dtype=np.float64)
    chosen: Reals = poses[(shares / shares[-1]).searchsorted(rng.random(n), side="right")]
    return chosen


def mean_pose(poses: Reals, weights: Floats) -> tuple[float, float, float]:
    """Weighted mean of poses (n, 3), the heading as the direction of the mean (cos θ, sin θ)."""
    x, y, heading = np.asarray(poses, dtype=np.float64).T
    sine, cosine = (weights * arrays.sin(heading)).sum(), (weights * arrays.cos(heading)).sum()
    direction = float(arrays.arctan2(sine, cosine))
    return float((weights * x).sum()), float((weights * y).sum()), direction


class Near(NamedTuple):
    """Whether a robot is where it is believed to be."""

    distance: float  # largest distance from the true position, m
    angle: float  # largest angle to the true heading, rad

    def holds(self, distance: Floats, angle: Floats) -> Bools:
        """Whether distances, m, and angles are small enough, (n,)."""
        return (distance <= self.distance) & (angle <= self.angle)

    def __call__(self, poses: ArrayLike, truth: ArrayLike, *, unit: str) -> Bools:
        """Whether poses (n, 3) are near true ones, (3,) or (n, 3), on a map of a unit, (n,)."""
        off = np.asarray(poses, np.float64) - np.asarray(truth, np.float64)
        distance = np.hypot(off[:, 0], off[:, 1]) / metre(unit)
        return self.holds(distance, np.abs(arrays.wrapped(off[:, 2])))


@dataclass(frozen=True)
class Cluster:
    """Neighbouring points of a belief."""

    mean: tuple[float, float, float]  # their mean pose (x, y, θ rad)
    share: float  # their share of the belief's weight


def best_cluster(poses: Reals, weights: Floats, *, unit: str) -> Cluster:
    """Return the points in the heaviest cell, 1 m × 1 m × 30°, and in the 26 around it.

    The mean of two distant places is neither, so every method is scored by this rule as well. Of
    equally heavy cells the first in the order of x, y, heading is taken. Poses are (n, 3), weights
    (n,) with sum 1.
    """
    return _best(poses, weights, unit)[0]


def two_clusters(poses: Reals, weights: Floats, *, unit: str) -> tuple[Cluster, Cluster]:
    """Return the best cluster, and the best of the points outside it.

    Without weight outside, the second is the best one again, with a share of 0.
    """
    best, near = _best(poses, weights, unit)
    left = float(weights[~near].sum())
    if left <= 0.0:
        return best, Cluster(best.mean, 0.0)
    second, _ = _best(np.asarray(poses)[~near], weights[~near] / left, unit)
    return best, Cluster(second.mean, left * second.share)


def _best(poses: Reals, weights: Floats, unit: str) -> tuple[Cluster, Bools]:
    """Return the best cluster, and which points it has, (n,)."""
    at = np.ascontiguousarray(np.asarray(poses).T, dtype=np.float64)
    near: Bools = np.empty(at.shape[1], np.bool_)
    places, sector = np.empty((2, near.size)), np.empty(near.size, np.intp)
    cell = np.empty(near.size, np.intp)
    if not count_cells(at, metre(unit), _COUNTED, places, sector, cell):  # a plug-in's may be so
        cells = np.stack([*places, sector])
        cell = np.unique(cells, axis=1, return_inverse=True)[1].reshape(-1)
    choose_cell(places, sector, cell, np.ascontiguousarray(weights, dtype=np.float64), near)
    share = float(weights[near].sum())
    return Cluster(mean_pose(at[:, near].T, weights[near] / share), share), near


@compiled
def count_cells(
    at: Reals, size: float, most: float, places: Floats, sector: Indices, cell: Indices
) -> bool:
    """Fill in column and row, (2, n), sector and number of each point's cell, of edge ``size``.

    False, without the numbers: the points (3, n) are more than ``most`` cells apart.
    """
    for i in range(sector.size):
        places[0, i], places[1, i] = np.floor(at[0, i] / size), np.floor(at[1, i] / size)
        turned = (wrapped64(np.float64(at[2, i])) + np.pi) * (SECTORS / (2 * np.pi))
        sector[i] = np.intp(np.floor(turned)) % SECTORS
    places[0] -= places[0].min()
    places[1] -= places[1].min()
    rows = places[1].max() + 1
    if not (places[0].max() + 1) * rows * SECTORS <= most:
        return False
    for i in range(sector.size):
        cell[i] = np.intp(places[0, i] * rows + places[1, i]) * SECTORS + sector[i]
    return True


@compiled
def choose_cell(
    places: Floats, sector: Indices, cell: Indices, weights: Floats, near: Bools
) -> None:
    """Fill in which points are in the heaviest cell, the first of equals, or next to it."""
    n, heaviest = cell.size, 0
    table = np.zeros(cell.max() + 1)
    for i in range(n):
        table[cell[i]] += weights[i]
    for i in range(1, n):
        more = table[cell[i]] - table[cell[heaviest]]
        if more > 0.0 or (more == 0.0 and cell[i] < cell[heaviest]):
            heaviest = i
    for i in range(n):
        beside = abs(places[0, i] - places[0, heaviest]) <= 1
        beside &= abs(places[1, i] - places[1, heaviest]) <= 1
        near[i] = beside & ((sector[i] - sector[heaviest] + 1) % SECTORS <= 2)
