"""Places at which a map is wrong, by scans from poses on it: seen through, or hit in free space.

Residuals of a robot that knows where it is concentrate on places of the map and repeat from other
poses; those of a lost one are everywhere. So a place counts only where beams from several poses
contradict the map, and more of them than agree with it. Unknown cells say nothing.
"""

import warnings
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from benchmarks.trials.map_signals import (
    APART,
    CLEAR,
    Expected,
    Fit,
    Lattice,
    Rays,
    count,
    known_part,
)
from deqmcl_gym.maps import GridMap, Lidar, Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics.types import Bools, Floats, Indices, Reals

HIT, THROUGH = "hit in free space", "seen through"
LEAST_POSES = 3
_LEAST_SHARE = 0.5  # of the beams that reach a cell, those that contradict the map
_LEAST_BEAMS, _LEAST_CELLS = 2, 2
_EXPLAINED = 0.75  # of the returns of a scan and most scans around it: the robot is not lost
_AROUND = 10  # scans before and after


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
        return (self.against[kind] >= _LEAST_BEAMS) & (self.share(kind) >= _LEAST_SHARE)


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
            return np.asarray(np.nanmedian(windows, axis=1) >= _EXPLAINED)

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
        off_walls = _occupied_part(self.floor_plan).distance(
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
            {kind: count(cells[which], lattice) for kind, (cells, which) in seen.items()},
            {
                HIT: rays.passed(np.where(returned, ranges - clear, 0.0)),
                THROUGH: count(walls[ended], lattice),
            },
            {
                kind: np.unique(
                    np.column_stack([cells[which], np.broadcast_to(pose, which.shape)[which]]),
                    axis=0,
                )
                for kind, (cells, which) in seen.items()
            },
        )


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


def _occupied_part(floor_plan: Map) -> Map:
    """Return a map whose unknown cells are free: all solid ones are known to be."""
    return replace(floor_plan, unknown="free") if isinstance(floor_plan, GridMap) else floor_plan
