"""What is there but not on the map, or on the map but not there: clutter, changed walls, glass.

Each is drawn from a stream of its own, thing by thing, so that a world with more of it has all that
one with less has.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from deqmcl_gym.maps import GridMap, Map
from deqmcl_gym.maps.altered import Piece, altered, comes_near, inner_walls
from deqmcl_gym.maps.map import LENGTH, pixel, scaled
from deqmcl_gym.numerics import Floats, arrays
from deqmcl_gym.validation import (
    InputError,
    array,
    boolean,
    integer,
    keep_plain,
    number,
    one_of,
    part,
    shown,
)

PLACES = ("anywhere", "walls")
KINDS = ("removed", "added", "shifted")
BESIDE = 10.0  # px: room left on both sides of a robot on its way
_APART = 2.0  # px: between the points of a way that are looked at
_TRIES = 1000
_CORNERS = 16  # of a round pillar
_DIRECTIONS = 32  # in which a place is looked around
_AGAIN = 20  # tries to change a wall
_ADDED = (25.0, 150.0)  # px: from a wall to its copy


class Way(NamedTuple):
    """Where a robot will come by, which things keep off."""

    points: Floats  # on it, (n, 2)
    margin: float  # distance that things keep from these

    @classmethod
    def along(cls, corners: Floats, body: float, floor_plan: Map) -> "Way":
        """Return the way of a disc of radius ``body`` along corners (k, 2), with room beside it."""
        px = pixel(floor_plan.unit)
        lengths = np.sqrt((np.diff(corners, axis=0) ** 2).sum(axis=1))
        points = [
            np.linspace(start, end, 1 + math.ceil(length / (_APART * px)))
            for start, end, length in zip(corners, corners[1:], lengths, strict=False)
        ]
        cell = floor_plan.resolution if isinstance(floor_plan, GridMap) else 0.0
        margin = body + (BESIDE + _APART / 2) * px + cell  # a painted cell may stick out
        return cls(np.vstack([corners[:1], *points]), margin)

    def is_blocked_by(self, polygons: Floats | list[Floats]) -> bool:
        """Whether one of some convex polygons (c, 2) is on the way."""
        return any(comes_near(self.points, polygon, self.margin) for polygon in polygons)


NOWHERE = Way(np.empty((0, 2)), 0.0)


@dataclass(frozen=True, kw_only=True)
class Clutter:
    """Boxes and round pillars that are not on the map; ``size`` is their least and greatest side.

    They stand anywhere, or against a wall. They keep off the way planned on the map, 0.2 m (10 px)
    beside the robot, or only off its ends.
    """

    number: int = 10  #: of things
    #: least and greatest side of a box, or diameter of a pillar
    size: tuple[float, float] = field(default=(15.0, 40.0), metadata=LENGTH)
    round: float = 0.5  #: share of pillars
    where: str = "anywhere"  #: "anywhere" or "walls"
    keep_route: bool = True  #: whether the way planned on the map stays free

    def __post_init__(self) -> None:
        keep_plain(self)
        integer("clutter.number", self.number, high=10_000)
        object.__setattr__(self, "size", ordered("clutter.size", self.size, above=True))
        number("clutter.round", self.round, low=0, high=1)
        one_of("place of clutter", self.where, PLACES)
        boolean("clutter.keep_route", self.keep_route)

    def drawn(self, floor_plan: Map, way: Way, rng: np.random.Generator) -> list[Floats]:
        """Draw it: convex polygons, counterclockwise, (c, 2) each."""
        return [self._one(floor_plan, way, rng) for _ in range(self.number)]

    def _one(self, floor_plan: Map, way: Way, rng: np.random.Generator) -> Floats:
        for _ in range(_TRIES):
            thing = self._tried(floor_plan, rng)
            if thing is not None and not way.is_blocked_by([thing]):
                return thing
        raise InputError(
            f"none of {_TRIES:,} places drawn for clutter ({self.where}) is free and off the "
            "robot's way: give another clutter.where, a smaller clutter.number, or a smaller "
            "clutter.size."
        )

    def _tried(self, floor_plan: Map, rng: np.random.Generator) -> Floats | None:
        """Draw a thing; None if it is not at such a place."""
        x0, y0, x1, y1 = floor_plan.bounds
        x, y, long, wide, turn, kind = rng.random(6).tolist()
        centre = np.array((x0 + x * (x1 - x0), y0 + y * (y1 - y0)))
        if not floor_plan.free([centre])[0]:
            return None
        low, high = self.size
        half = low / 2 + (high - low) / 2 * np.array((long, wide))
        is_round, angle = kind < self.round, 2 * math.pi * turn
        if self.where == "walls":
            bearings = 2 * math.pi / _DIRECTIONS * np.arange(_DIRECTIONS)
            seen = floor_plan.ranges([(*centre, 0.0)], bearings)[0].astype(np.float64)
            angle = float(bearings[seen.argmin()])
            centre = centre + (seen.min() - half[0]) * _unit(angle)
            if not floor_plan.free([centre])[0]:
                return None
        ahead, aside = _unit(angle), _unit(angle + math.pi / 2)
        corners: Floats = (
            half[0] * _circle() if is_round else _SQUARE @ (half[:, None] * (ahead, aside))
        )
        return centre + corners


_SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


def _unit(angle: float) -> Floats:
    return np.array((arrays.cos([angle])[0], arrays.sin([angle])[0]))


@cache
def _circle() -> Floats:
    """Return the corners of a round pillar of radius 1: at first use, as a kernel computes them."""
    return np.array([_unit(2 * math.pi * k / _CORNERS) for k in range(_CORNERS)])


@dataclass(frozen=True, kw_only=True)
class ChangedWalls:
    """Inner walls that are not where the map has them: pieces of up to 2 m (100 px).

    A piece is removed, or shifted across, or a wall is added: a copy of the piece 0.5 to 3 m
    (25 to 150 px) beside it or, as often, what closes a door.
    """

    share: float = 0.1  #: of the inner walls' length that is changed, 0 to 0.5
    distance: float = field(default=25.0, metadata=LENGTH)  #: greatest shift
    keep_route: bool = True  #: as for clutter

    def __post_init__(self) -> None:
        keep_plain(self)
        number("changed_walls.share", self.share, low=0, high=0.5)
        number("changed_walls.distance", self.distance, low=0, above=True)
        boolean("changed_walls.keep_route", self.keep_route)

    def check(self, floor_plan: Map) -> None:
        """Refuse a map without inner walls, or with cells that are larger than a shift may be."""
        step = inner_walls(floor_plan).step
        if not step <= self.distance:
            raise InputError(
                f"changed_walls.distance is {self.distance:g}, but walls of cells are shifted by "
                f"whole cells of {step:g} {floor_plan.unit}: give at least that."
            )

    def drawn(
        self, floor_plan: Map, way: Way, rng: np.random.Generator
    ) -> tuple[Floats, list[Floats]]:
        """Draw what is cleared, boxes (k, 4, 2), and filled, counterclockwise (4, 2) each."""
        self.check(floor_plan)
        walls, _, _ = inner_walls(floor_plan)
        cleared, filled, changed = [np.empty((0, 4, 2))], list[Floats](), 0.0
        asked = self.share * sum(piece.length for piece in walls)
        for number_ in rng.permutation(len(walls)).tolist():
            if changed >= asked * (1 - 1e-9):
                break
            for _ in range(_AGAIN):
                tried = self._tried(floor_plan, walls[number_], rng)
                if tried is not None and not way.is_blocked_by(tried[1]):
                    gone, come = tried
                    cleared.append(gone)
                    filled += list(come)
                    changed += walls[number_].length
                    break
        else:
            if changed < asked * (1 - 1e-9):
                raise InputError(
                    f"changed_walls.share is {self.share:g}, but so many walls cannot be changed "
                    "beside the robot's way: give a smaller share."
                )
        return np.vstack(cleared), filled

    def _tried(
        self, floor_plan: Map, piece: Piece, rng: np.random.Generator
    ) -> tuple[Floats, Floats] | None:
        """Draw what is cleared and filled for a piece; None if it would not come to free space."""
        _, doors, step = inner_walls(floor_plan)
        nothing = np.empty((0, 4, 2))
        kind = KINDS[int(rng.integers(len(KINDS)))]
        if kind == "removed":
            return piece.boxes, nothing
        by, is_door = rng.uniform(-1.0, 1.0), bool(rng.random() < 0.5)
        if kind == "added" and is_door and doors:
            return nothing, doors[int(rng.integers(len(doors)))].boxes
        near, far = (length * pixel(floor_plan.unit) for length in _ADDED)
        if kind == "shifted":
            near, far = 0.0, self.distance
        to, front = _shifted(piece, by, near, far, step)
        if not floor_plan.free([front])[0]:
            return None
        return piece.boxes if kind == "shifted" else nothing, to


def _shifted(
    piece: Piece, by: float, near: float, far: float, step: float
) -> tuple[Floats, Floats]:
    """Return a piece shifted by near + |by| (far - near), and the middle of its front there."""
    way = near + abs(by) * (far - near)
    way = max(1, min(round(way / step), math.floor(far / step + 1e-9))) * step
    to = piece.boxes + math.copysign(way, by) * piece.across
    middle = to.mean(axis=(0, 1))
    thick = np.abs((piece.boxes - piece.boxes.mean(axis=(0, 1))) @ piece.across).max()
    return to, middle + math.copysign(thick, by) * piece.across


def map_changed(floor_plan: Map, given: Mapping[str, Any], points: Floats, body: float) -> Map:
    """Return a map whose walls are changed: what a robot is given if its map is out of date.

    Keys are those of ``ChangedWalls`` and ``seed``, 0 by default; ``points`` are where a robot of
    radius ``body`` comes by, (n, 2).
    """
    if not isinstance(given, Mapping):
        raise InputError(f"changed_walls is {shown(given)}, but must be a mapping such as share.")
    keys = {name: value for name, value in given.items() if name != "seed"}
    default = scaled(ChangedWalls(), pixel(floor_plan.unit))
    walls = part("changed_walls", ChangedWalls, keys, default)
    seed = integer("changed_walls.seed", given.get("seed", 0))
    way = Way.along(points, body, floor_plan) if walls.keep_route and len(points) else NOWHERE
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    return altered(floor_plan, *walls.drawn(floor_plan, way, rng))


@dataclass(frozen=True, kw_only=True)
class Glass:
    """Inner walls, as on the map, of which beams do not always return."""

    share: float = 0.2  #: of the inner walls' length that is glass
    lost: float = 0.7  #: share of the beams that meet glass and see what is behind

    def __post_init__(self) -> None:
        keep_plain(self)
        number("glass.share", self.share, low=0, high=1)
        number("glass.lost", self.lost, low=0, high=1)

    def check(self, floor_plan: Map) -> None:
        """Refuse a map without inner walls."""
        inner_walls(floor_plan)

    def drawn(self, floor_plan: Map, rng: np.random.Generator) -> Floats:
        """Draw which walls are glass: boxes, (k, 4, 2)."""
        walls, _, _ = inner_walls(floor_plan)
        order = rng.permutation(len(walls))
        lengths = np.array([walls[k].length for k in order])
        before = np.cumsum(lengths) - lengths
        chosen = order[before < self.share * lengths.sum() * (1 - 1e-9)]
        return np.vstack([np.empty((0, 4, 2)), *(walls[k].boxes for k in chosen)])


def ordered(what: str, given: object, *, above: bool = False) -> tuple[float, float]:
    """Return two numbers of 0 or more, the least first, else refuse them."""
    low, high = array(what, given, (2,)).tolist()  # type: ignore[arg-type] # it checks
    number(f"the first of {what}", low, low=0, above=above)
    number(f"the second of {what}", high, low=low)
    return low, high
