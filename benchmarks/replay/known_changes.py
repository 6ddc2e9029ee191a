"""How well places tell where a map is wrong, if it is known where it was changed on purpose."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.trials.residuals import (
    HIT,
    LEAST_POSES,
    THROUGH,
    Lattice,
    Place,
    Scans,
    cast,
    known_part,
    occupied_part,
    places_of,
)
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Bools, Floats, Reals

_WIDE = np.ones((7, 7), np.uint8)  # 0.3 m on all sides


@dataclass(frozen=True)
class Recovered:
    """How well places tell changes of a map that are known.

    Attributes:
        changes: groups of cells at which the maps differ.
        in_view: of them, those that exact scans of the true map, from the same poses, contradict
            from as many poses as a place needs.
        found: of these, those with a place of their kind within 0.3 m.
        places: all places.
        right: of them, those within 0.3 m of a change of their kind.
        before: of the others, those within 0.3 m of a place of the true map, by the same scans.
    """

    changes: int
    in_view: int
    found: int
    places: int
    right: int
    before: int


def recovered(scans: Scans, places: Sequence[Place], true: Map) -> Recovered:
    """Return how well the places found tell where the map differs from the true one.

    Args:
        scans: compared with the map that is wrong.
        places: found by them.
        true: the map as it is there.
    """
    given, lattice = scans.known, scans.evidence.lattice
    poses = scans.poses[scans.used]
    exact = replace(scans, poses=poses, ranges=_seen(scans, true, poses)).evidence
    before = places_of(replace(scans, floor_plan=true).evidence)
    changed = {
        HIT: lattice.any_of(lambda points: given.free(points) & _is_wall(true, points)),
        THROUGH: lattice.any_of(lambda points: _is_wall(given, points) & ~_is_wall(true, points)),
    }
    totals = np.zeros(6, np.intp)
    for kind, marked in changed.items():
        labels = lattice.groups(marked)
        around = cv2.dilate(labels.reshape(lattice.shape).astype(np.float32), _WIDE).ravel()
        cell, pose = exact.seen[kind].T
        pairs = np.unique(np.column_stack([around[cell], pose])[cell >= 0], axis=0)
        poses_of = np.bincount(pairs[:, 0].astype(np.intp), minlength=labels.max() + 1)
        visible = set(np.flatnonzero(poses_of >= LEAST_POSES).tolist()) - {0}
        ours = [place.at for place in places if place.kind == kind]
        theirs = [lattice.centres(place.at) for place in before if place.kind == kind]
        earlier = cv2.dilate(_marked(lattice, theirs), _WIDE).ravel() > 0
        met = [set(around[at].astype(int)) - {0} for at in ours]
        others = [at for at, changes in zip(ours, met, strict=True) if not changes]
        found = visible & set().union(*met)
        totals += (
            *(np.unique(labels[labels > 0]).size, len(visible), len(found)),
            *(len(ours), len(ours) - len(others), sum(bool(earlier[at].any()) for at in others)),
        )
    return Recovered(*totals.tolist())


def _marked(lattice: Lattice, points: Sequence[Floats]) -> NDArray[np.uint8]:
    cells = np.zeros(lattice.size, np.uint8)
    for some in points:
        cells[lattice.cells(*some.T)] = 1
    return cells.reshape(lattice.shape)


def _is_wall(floor_plan: Map, points: Floats) -> Bools:
    """Whether points are known to be no free space, (n,)."""
    return ~occupied_part(floor_plan).free(points)


def _seen(scans: Scans, true: Map, poses: Reals) -> Reals:
    """Return exact scans of the true map, of the beams that had a return."""
    exact = cast(known_part(true), scans.lidar, poses)
    return np.where(scans.fit.returned[scans.used], exact, np.inf)
