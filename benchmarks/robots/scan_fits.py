"""How scans from poses on a map fit it, by beam; cells over a map, and the rays that pass them."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np

from deqmcl_gym.maps import GridMap, Lidar, Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Bools, Floats, Indices, Ints, Reals

CLEAR = 0.2  # m by which a reading differs from all that the map says from poses nearby
_SIGMAS = 3.0  # of the lidar's noise, if that is more
_NEARBY = (0.1, np.radians(2.0))  # m, rad: how far off a pose of a robot that is localized may be
_CELL = 0.1  # m, or a cell of the map if that is larger
APART = 0.5  # m between poses that count as different ones


class Fit(NamedTuple):
    """How each beam of scans fits a map, seen from poses, (n, B) each.

    A beam that grazes a wall, or passes its corner, reads something else from 0.1 m beside: a
    reading contradicts the map if it clearly differs from what is read from all poses nearby.
    """

    expected: Reals  # ∞ where only unknown cells or nothing is met
    returned: Bools  # reflected within range
    short: Bools  # that, and clearly less than from every pose nearby
    long: Bools  # that, and clearly more

    @classmethod
    def of(cls, floor_plan: Map, lidar: Lidar, poses: Reals, ranges: Reals) -> "Fit":
        """Return how scans (n, B) from poses (n, 3) fit a map, as of ``known_part``.

        Readings without a number are no returns.
        """
        length = metre(floor_plan.unit)
        near, turn = _NEARBY[0] * length, _NEARBY[1]
        steps = np.vstack([np.zeros(3), *(sign * np.diag((near, near, turn)) for sign in (-1, 1))])
        around = (steps[:, None] + poses).reshape(-1, 3)
        seen = lidar.ranges(floor_plan, around.T).reshape(len(steps), len(poses), -1)
        clear = max(CLEAR * length, _SIGMAS * lidar.sigma)
        returned = np.isfinite(ranges) & (ranges < lidar.max_range)
        short = returned & (ranges < seen.min(axis=0) - clear)
        return cls(seen[0], returned, short, returned & (ranges > seen.max(axis=0) + clear))

    @property
    def fits(self) -> Bools:
        """Which beams are returned, and neither short nor long."""
        return self.returned & ~self.short & ~self.long

    @property
    def explained(self) -> Floats:
        """Share of the returns of each scan that fit, (n,); NaN without a return."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.fits.sum(axis=1) / self.returned.sum(axis=1))


def known_part(floor_plan: Map) -> Map:
    """Return a map whose unknown cells stop no beam and are no free space either."""
    if isinstance(floor_plan, GridMap):
        return replace(floor_plan, unknown="transparent")
    return floor_plan


@dataclass(frozen=True)
class Lattice:
    """Square cells along x and y over a map, counted row by row from its lower left corner."""

    x: float
    y: float
    cell: float  # its edge
    shape: tuple[int, int]  # rows, columns

    @classmethod
    def over(cls, floor_plan: Map) -> "Lattice":
        """Return cells of 0.1 m, or of the map's resolution if that is coarser."""
        cell = _CELL * metre(floor_plan.unit)
        if isinstance(floor_plan, GridMap):
            cell = max(cell, floor_plan.resolution)
        x0, y0, x1, y1 = floor_plan.bounds
        rows, columns = (int(np.ceil(side / cell)) + 1 for side in (y1 - y0, x1 - x0))
        return cls(x0, y0, cell, (rows, columns))

    @property
    def size(self) -> int:
        """Number of cells."""
        return self.shape[0] * self.shape[1]

    def cells(self, x: Floats, y: Floats) -> Indices:
        """Return the cell of each point, -1 outside."""
        with np.errstate(invalid="ignore"):
            column, row = np.floor((x - self.x) / self.cell), np.floor((y - self.y) / self.cell)
            inside = (row >= 0) & (row < self.shape[0]) & (column >= 0) & (column < self.shape[1])
        return np.where(inside, row * self.shape[1] + column, -1).astype(np.intp)

    def centres(self, cells: Indices) -> Floats:
        """Return the centres of cells, (n, 2)."""
        row, column = np.divmod(cells, self.shape[1])
        middle = self.cell * (np.column_stack([column, row]) + 0.5)
        return np.column_stack([self.x, self.y]) + middle

    def groups(self, marked: Bools) -> Ints:
        """Number groups of marked cells, at most one cell apart, from 1 on; 0: not marked."""
        image = marked.reshape(self.shape).astype(np.uint8)
        wide = cv2.dilate(image, np.ones((3, 3), np.uint8))
        labels = cv2.connectedComponents(wide, connectivity=8)[1]
        return np.where(marked, labels.ravel(), 0).astype(np.int32)


class Rays(NamedTuple):
    """Rays over cells, of a scan from each of n poses: starts and angles in the map, (n, B)."""

    lattice: Lattice
    x: Reals
    y: Reals
    angles: Floats

    @classmethod
    def of(cls, lattice: Lattice, lidar: Lidar, poses: Reals) -> "Rays":
        """Return the rays of a robot's lidar at poses (n, 3)."""
        x, y, angles = np.empty((3, len(poses), lidar.beams))
        for origins, rows in lidar.fans(poses.T):
            x[:, rows], y[:, rows], angles[:, rows] = origins[:, :, None]
        return cls(lattice, x, y, angles + lidar.bearings)

    def points(self, ranges: Reals) -> tuple[Floats, Floats]:
        """Return the point on each ray so far away, (n, B) each; NaN for ∞."""
        far = np.where(np.isfinite(ranges), ranges, np.nan)
        return self.x + far * np.cos(self.angles), self.y + far * np.sin(self.angles)

    def cells(self, ranges: Reals) -> Indices:
        """Return the cell of the point on each ray so far away, (n, B); -1 outside."""
        return self.lattice.cells(*self.points(ranges))

    def passed(self, ranges: Floats) -> Indices:
        """Count the rays that pass each cell before they are so far, sampled at each cell."""
        passed = np.zeros(self.lattice.size, np.intp)
        scan, beam = np.nonzero(ranges > 0)
        x, y = self.x[scan, beam], self.y[scan, beam]
        angle, far = self.angles[scan, beam], ranges[scan, beam]
        ahead = np.column_stack([np.cos(angle), np.sin(angle)]) * self.lattice.cell
        step = 0
        while far.size:
            at = self.lattice.cells(x + step * ahead[:, 0], y + step * ahead[:, 1])
            passed += count(at, self.lattice)
            step += 1
            on = far > step * self.lattice.cell
            x, y, ahead, far = x[on], y[on], ahead[on], far[on]
        return passed


def count(cells: Indices, lattice: Lattice) -> Indices:
    """Count the points in each cell of a lattice, (k,); -1 is none."""
    return np.bincount(cells[cells >= 0], minlength=lattice.size)
