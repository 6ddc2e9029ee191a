"""Where a map is wrong, by scans from poses on it: cells seen through, and cells hit in free space.

Residuals of a robot that knows where it is concentrate on places of the map and repeat from other
poses; those of a lost one are everywhere. So a place counts only where beams from several poses
contradict the map, and more of them than agree with it. Unknown cells say nothing.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from deqmcl_gym.maps import GridMap, Lidar, Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics.types import Bools, Floats, Indices, Ints, Reals

HIT, THROUGH = "hit in free space", "seen through"
CLEAR = 0.2  # m by which a reading differs from all that the map says from poses nearby
_SIGMAS = 3.0  # of the lidar's noise, if that is more
_NEARBY = (0.1, np.radians(2.0))  # m, rad: how far off a pose of a robot that is localized may be
_CELL = 0.1  # m, or a cell of the map if that is larger
APART = 0.5  # m between poses that count as different ones
LEAST_POSES = 3
LEAST_SHARE = 0.5  # of the beams that reach a cell, those that contradict the map
_LEAST_BEAMS, _LEAST_CELLS = 2, 2
EXPLAINED = 0.75  # of the returns of a scan and most scans around it: the robot is not lost
_AROUND = 10  # scans before and after


@dataclass(frozen=True)
class Fit:
    """How each beam of scans fits a map, seen from poses, (n, B) each.

    Attributes:
        expected: range by the map; ∞ where only unknown cells or nothing is met.
        returned: whether the beam was reflected within range.
        short, long: it was, and reads clearly less or more than from every pose nearby.
    """

    expected: Reals
    returned: Bools
    short: Bools
    long: Bools

    @property
    def explained(self) -> Floats:
        """Share of the returns of each scan that are neither short nor long, (n,); NaN of none."""
        return self._share(~(self.short | self.long))

    @property
    def shares(self) -> tuple[Floats, Floats]:
        """Share of the returns of each scan that are short, and that are long, (n,) each."""
        return self._share(self.short), self._share(self.long)

    def _share(self, which: Bools) -> Floats:
        with np.errstate(invalid="ignore"):
            found = (which & self.returned).sum(axis=1) / self.returned.sum(axis=1)
        return np.asarray(found)


def known_part(floor_plan: Map) -> Map:
    """Return a map whose unknown cells stop no beam and are no free space either."""
    if isinstance(floor_plan, GridMap):
        return replace(floor_plan, unknown="transparent")
    return floor_plan


def occupied_part(floor_plan: Map) -> Map:
    """Return a map whose unknown cells are free: all solid ones are known to be."""
    return replace(floor_plan, unknown="free") if isinstance(floor_plan, GridMap) else floor_plan


class Expected(NamedTuple):
    """What a map says that a robot sees from poses, and from poses near them, (n, B) each.

    A beam that grazes a wall, or passes its corner, reads something else from 0.1 m beside.

    Attributes:
        here: the ranges from the poses; ∞ where only unknown cells or nothing is met.
        least, most: from all poses nearby.
        clear: by how much a reading must be outside to contradict the map.
        farthest: ranges from here on are no returns.
    """

    here: Reals
    least: Reals
    most: Reals
    clear: float
    farthest: float

    @classmethod
    def of(cls, floor_plan: Map, lidar: Lidar, poses: Reals) -> "Expected":
        """Return what is expected at poses (n, 3) on a map, as of ``known_part``."""
        length = metre(floor_plan.unit)
        near, turn = _NEARBY[0] * length, _NEARBY[1]
        steps = np.vstack([np.zeros(3), *(sign * np.diag((near, near, turn)) for sign in (-1, 1))])
        around = (steps[:, None] + poses).reshape(-1, 3)  # one call: a step of a trial has one pose
        seen = cast(floor_plan, lidar, around).reshape(len(steps), len(poses), -1)
        clear = max(CLEAR * length, _SIGMAS * lidar.sigma)
        return cls(seen[0], seen.min(axis=0), seen.max(axis=0), clear, lidar.max_range)

    def fit(self, ranges: Reals) -> Fit:
        """Return how scans, (n, B) or one, (B,), fit; readings without a number are no returns."""
        returned = np.broadcast_to(np.isfinite(ranges) & (ranges < self.farthest), self.here.shape)
        short = returned & (ranges < self.least - self.clear)
        return Fit(self.here, returned, short, returned & (ranges > self.most + self.clear))


def cast(floor_plan: Map, lidar: Lidar, poses: Reals) -> Reals:
    """Return the ranges of a robot's lidar by a map, (n, B)."""
    return lidar.ranges(floor_plan, poses.T)


@dataclass(frozen=True)
class Lattice:
    """Square cells along x and y over a map, counted row by row from the lower left.

    Attributes:
        x, y: the lower left corner.
        cell: edge of a cell.
        shape: rows and columns.
    """

    x: float
    y: float
    cell: float
    shape: tuple[int, int]

    @classmethod
    def over(cls, floor_plan: Map, metres: float = _CELL) -> "Lattice":
        """Return cells of so many m, or of the map's resolution if that is coarser."""
        cell = metres * metre(floor_plan.unit)
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
        return np.column_stack([self.x, self.y]) + self.cell * (
            np.column_stack([column, row]) + 0.5
        )

    def any_of(self, holds: Callable[[Floats], Bools]) -> Bools:
        """Return which cells have one of four points inside at which this holds, (k,)."""
        centres = self.centres(np.arange(self.size))
        quarters = 0.25 * self.cell * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
        return np.asarray(np.any([holds(centres + off) for off in quarters], axis=0))

    def groups(self, marked: Bools) -> Ints:
        """Number groups of marked cells, at most one cell apart, from 1 on; 0: not marked."""
        image = marked.reshape(self.shape).astype(np.uint8)
        wide = cv2.dilate(image, np.ones((3, 3), np.uint8))
        labels = cv2.connectedComponents(wide, connectivity=8)[1]
        return np.where(marked, labels.ravel(), 0).astype(np.int32)


@dataclass(frozen=True)
class Evidence:
    """Beams that agree with a map and that contradict it, by cell.

    Attributes:
        lattice: the cells.
        against: by kind, ``HIT`` and ``THROUGH``: beams that contradict the map at a cell, (k,).
        agreed: by kind, those that agree: passed a free cell, ended at a wall, (k,).
        seen: by kind, the cell and the pose (one of those ``APART``) of each beam against, (j, 2).
    """

    lattice: Lattice
    against: dict[str, Indices]
    agreed: dict[str, Indices]
    seen: dict[str, Indices]

    def share(self, kind: str) -> Floats:
        """Share of the beams at each cell that contradict the map, (k,)."""
        both = self.against[kind] + self.agreed[kind]
        return np.asarray(self.against[kind] / np.maximum(both, 1))

    def wrong(self, kind: str) -> Bools:
        """Whether several beams contradict the map at a cell, and no more agree, (k,)."""
        return (self.against[kind] >= _LEAST_BEAMS) & (self.share(kind) >= LEAST_SHARE)


class Place(NamedTuple):
    """A place at which a map is wrong. Lengths are in the map's unit.

    Attributes:
        kind: ``HIT`` or ``THROUGH``.
        x, y: its centre, the mean of its cells.
        width, height: along x and y.
        cells: how many of the evidence's cells it has.
        beams: that contradict the map there.
        poses: of the robot, at least 0.5 m apart, from which they did.
        share: of the beams that reach these cells, those that contradict the map.
        at: its cells.
    """

    kind: str
    x: float
    y: float
    width: float
    height: float
    cells: int
    beams: int
    poses: int
    share: float
    at: Indices


@dataclass(frozen=True)
class Scans:
    """Scans with the poses that they were taken from, and a map to compare them with.

    Attributes:
        floor_plan: the map; its unknown cells are left out of all.
        lidar: that took the scans.
        poses: of the robot, one after the other, (n, 3).
        ranges: (n, B).
    """

    floor_plan: Map
    lidar: Lidar
    poses: Reals
    ranges: Reals

    @cached_property
    def known(self) -> Map:
        """The map that they are compared with."""
        return known_part(self.floor_plan)

    @cached_property
    def fit(self) -> Fit:
        """How each beam fits it."""
        return Expected.of(self.known, self.lidar, self.poses).fit(self.ranges)

    @cached_property
    def used(self) -> Bools:
        """Whether so much is explained around a scan that the robot is not lost, (n,).

        By the median of 21 scans: the robot passes a place where the map is wrong, but stays lost.
        """
        own = self.fit.explained
        padded = np.pad(own, _AROUND, constant_values=np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # no return in any of them
            return np.asarray(np.nanmedian(windows, axis=1) >= EXPLAINED)

    @cached_property
    def evidence(self) -> Evidence:
        """What the scans that are used say of each cell."""
        lattice, used, fit = Lattice.over(self.floor_plan), self.used, self.fit
        rays = Rays.of(lattice, self.lidar, self.poses[used])
        ranges, expected = self.ranges[used].astype(np.float64), fit.expected[used]
        returned, short, long = fit.returned[used], fit.short[used], fit.long[used]
        clear = CLEAR * metre(self.floor_plan.unit)
        pose = _poses_apart(self.poses[used], APART * metre(self.floor_plan.unit))[:, None]
        ends = rays.points(ranges)
        inside = short & self.known.free(np.column_stack([p.ravel() for p in ends])).reshape(
            short.shape
        )
        off_walls = occupied_part(self.floor_plan).distance(
            np.column_stack([p[inside] for p in ends])
        )
        inside[inside] = off_walls > clear
        hits = rays.cells(ranges)
        walls = rays.cells(expected + 0.25 * lattice.cell)  # just inside the wall
        with np.errstate(invalid="ignore"):
            ended = returned & ~short & ~long & (np.abs(ranges - expected) <= clear)
        seen = {HIT: (hits, inside), THROUGH: (walls, long)}
        return Evidence(
            lattice,
            {kind: _count(cells[which], lattice) for kind, (cells, which) in seen.items()},
            {
                HIT: rays.passed(np.where(returned, ranges - clear, 0.0)),
                THROUGH: _count(walls[ended], lattice),
            },
            {
                kind: np.unique(
                    np.column_stack([cells[which], np.broadcast_to(pose, which.shape)[which]]),
                    axis=0,
                )
                for kind, (cells, which) in seen.items()
            },
        )


class Rays(NamedTuple):
    """Rays over cells, of a scan from each of n poses.

    Attributes:
        lattice: the cells.
        x, y: where the rays start, (n, B).
        angles: in the map, (n, B).
    """

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
        found = np.zeros(self.lattice.size, np.intp)
        scan, beam = np.nonzero(ranges > 0)
        x, y = self.x[scan, beam], self.y[scan, beam]
        angle, far = self.angles[scan, beam], ranges[scan, beam]
        ahead = np.column_stack([np.cos(angle), np.sin(angle)]) * self.lattice.cell
        step = 0
        while far.size:
            found += _count(
                self.lattice.cells(x + step * ahead[:, 0], y + step * ahead[:, 1]), self.lattice
            )
            step += 1
            on = far > step * self.lattice.cell
            x, y, ahead, far = x[on], y[on], ahead[on], far[on]
        return found


def _count(cells: Indices, lattice: Lattice) -> Indices:
    return np.bincount(cells[cells >= 0], minlength=lattice.size)


def _poses_apart(poses: Reals, least: float) -> Indices:
    """Number positions (n, 2+): each has the number of the first one that is nearer than this."""
    kept: list[Reals] = []
    numbers = np.empty(len(poses), np.intp)
    for i, place in enumerate(poses[:, :2]):
        off = np.hypot(*(np.array(kept).reshape(-1, 2) - place).T)
        nearest = int(off.argmin()) if kept else 0
        if not kept or off[nearest] >= least:
            nearest = len(kept)
            kept.append(place)
        numbers[i] = nearest
    return numbers


def places_of(evidence: Evidence) -> list[Place]:
    """Return the places at which a map is wrong, those with the most cells first."""
    found = [place for kind in (HIT, THROUGH) for place in _places(evidence, kind)]
    return sorted(found, key=lambda place: -place.cells)


def _places(evidence: Evidence, kind: str) -> list[Place]:
    lattice = evidence.lattice
    labels = lattice.groups(evidence.wrong(kind))
    cell, pose = evidence.seen[kind].T
    cell, pose = cell[cell >= 0], pose[cell >= 0]
    pairs = np.unique(np.column_stack([labels[cell], pose]), axis=0)
    poses = np.bincount(pairs[:, 0], minlength=labels.max() + 1)
    sizes = np.bincount(labels)
    return [
        _place(evidence, kind, np.flatnonzero(labels == label), int(poses[label]))
        for label in range(1, labels.max() + 1)
        if poses[label] >= LEAST_POSES and sizes[label] >= _LEAST_CELLS
    ]


def _place(evidence: Evidence, kind: str, at: Indices, poses: int) -> Place:
    lattice = evidence.lattice
    centres = lattice.centres(at)
    x, y = centres.mean(axis=0).tolist()
    width, height = (np.ptp(centres, axis=0) + lattice.cell).tolist()
    beams, agreed = int(evidence.against[kind][at].sum()), int(evidence.agreed[kind][at].sum())
    return Place(kind, x, y, width, height, at.size, beams, poses, beams / (beams + agreed), at)
