"""What is there but not on the map, or on the map but not there: clutter, changed walls, glass.

Each is drawn from a stream of its own, thing by thing, so that a world with more of it has all that
one with less has. Inner walls are found along the axes of a map of cells: straight strips of wall
with open space beside them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import groupby, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.maps import GridMap, Map, PolygonMap
from deqmcl_gym.maps.grid_file import FREE, OCCUPIED
from deqmcl_gym.maps.grid_map import runs_of
from deqmcl_gym.maps.map import LENGTH, Part, bounded, pixel, scaled
from deqmcl_gym.maps.polygons import edges_of, square_distances
from deqmcl_gym.numerics import Bools, Floats, Indices, arrays
from deqmcl_gym.validation import InputError, array, boolean, integer, number, one_of, part, shown

KINDS = ("removed", "added", "shifted")
BESIDE = 10.0  # px: room left on both sides of a robot on its way
_APART = 2.0  # px: between the points of a way that are looked at
_TRIES = 1000
_CORNERS = 16  # of a round pillar
_DIRECTIONS = 32  # in which a place is looked around
_AGAIN = 20  # tries to change a wall
_ADDED = (25.0, 150.0)  # px: from a wall to its copy
_THICKEST, _SHORTEST, _LONGEST = 100.0, 15.0, 100.0  # px: of a wall; longer ones are cut
_NARROWEST, _WIDEST, _DEEPEST = 20.0, 75.0, 25.0  # px: of a door


class Piece(NamedTuple):
    """A straight piece of an inner wall, or the gap of a door."""

    boxes: Floats  # rectangles that it is made of, counterclockwise corners, (k, 4, 2)
    length: float  # along the wall
    across: Floats  # unit vector across the wall, (2,)


class InnerWalls(NamedTuple):
    """The inner walls of a map."""

    walls: tuple[Piece, ...]  # pieces of up to 2 m of walls up to 2 m thick, longer than thick
    doors: tuple[Piece, ...]  # gaps of 0.4 to 1.5 m in walls
    step: float  # what displacements of walls are multiples of: a cell


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

    def is_blocked_by(self, polygon: Floats) -> bool:
        """Whether a convex polygon (c, 2) is nearer to it than the margin."""
        low, high = polygon.min(axis=0) - self.margin, polygon.max(axis=0) + self.margin
        near = self.points[((self.points > low) & (self.points < high)).all(axis=1)]
        if not len(near):
            return False
        along = np.roll(polygon, -1, axis=0) - polygon
        off = near[:, None] - polygon
        if (along[:, 0] * off[..., 1] >= along[:, 1] * off[..., 0]).all(axis=1).any():
            return True  # inside
        squares = square_distances(edges_of(polygon), near[:, None])
        return bool(squares.min() < self.margin * self.margin)


@dataclass(frozen=True, kw_only=True)
class Clutter(Part, called="clutter.{}"):
    """Boxes and round pillars that are not on the map; ``size`` is their least and greatest side.

    They stand anywhere, or against a wall. They keep off the way planned on the map, 0.2 m (10 px)
    beside the robot, or only off its ends.
    """

    number: int = bounded(10, high=10_000)  #: of things
    #: least and greatest side of a box, or diameter of a pillar
    size: tuple[float, float] = field(default=(15.0, 40.0), metadata=LENGTH)
    round: float = bounded(0.5, low=0, high=1)  #: share of pillars
    where: str = "anywhere"  #: "anywhere" or "walls"
    keep_route: bool = True  #: whether the way planned on the map stays free

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "size", ordered("clutter.size", self.size, above=True))
        one_of("place of clutter", self.where, ("anywhere", "walls"))
        boolean("clutter.keep_route", self.keep_route)

    def drawn(self, floor_plan: Map, way: Way, rng: np.random.Generator) -> list[Floats]:
        """Draw it: convex polygons, counterclockwise, (c, 2) each."""
        things = list[Floats]()
        for _ in range(self.number):
            tried = (self._tried(floor_plan, rng) for _ in range(_TRIES))
            off = (thing for thing in tried if thing is not None and not way.is_blocked_by(thing))
            if (thing := next(off, None)) is None:
                raise InputError(
                    f"none of {_TRIES:,} places drawn for clutter ({self.where}) is free and off "
                    "the robot's way: give another clutter.where, a smaller clutter.number, or a "
                    "smaller clutter.size."
                )
            things.append(thing)
        return things

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
        ring = half[0] * _unit(2 * math.pi * np.arange(_CORNERS) / _CORNERS)
        corners: Floats = ring if is_round else _SQUARE @ (half[:, None] * (ahead, aside))
        return centre + corners


_SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


def _unit(angles: ArrayLike) -> Floats:
    return np.stack([arrays.cos(angles), arrays.sin(angles)], axis=-1)


@dataclass(frozen=True, kw_only=True)
class ChangedWalls(Part, called="changed_walls.{}"):
    """Inner walls that are not where the map has them: pieces of up to 2 m (100 px).

    A piece is removed, or shifted across, or a wall is added: a copy of the piece 0.5 to 3 m
    (25 to 150 px) beside it or, as often, what closes a door.
    """

    #: of the inner walls' length that is changed, 0 to 0.5
    share: float = bounded(0.1, low=0, high=0.5)
    distance: float = bounded(25.0, LENGTH, low=0, above=True)  #: greatest shift
    keep_route: bool = True  #: as for clutter

    def __post_init__(self) -> None:
        super().__post_init__()
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
                if tried is not None and not any(map(way.is_blocked_by, tried[1])):
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
        way = near + abs(by) * (far - near)
        way = max(1, min(round(way / step), math.floor(far / step + 1e-9))) * step
        to = piece.boxes + math.copysign(way, by) * piece.across
        thick = np.abs((piece.boxes - piece.boxes.mean(axis=(0, 1))) @ piece.across).max()
        front = to.mean(axis=(0, 1)) + math.copysign(thick, by) * piece.across
        if not floor_plan.free([front])[0]:
            return None
        return piece.boxes if kind == "shifted" else nothing, to


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
    way = Way.along(points if walls.keep_route else points[:0], body, floor_plan)
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    return altered(floor_plan, *walls.drawn(floor_plan, way, rng))


@dataclass(frozen=True, kw_only=True)
class Glass(Part, called="glass.{}"):
    """Inner walls, as on the map, of which beams do not always return."""

    share: float = bounded(0.2, low=0, high=1)  #: of the inner walls' length that is glass
    #: share of the beams that meet glass and see what is behind
    lost: float = bounded(0.7, low=0, high=1)

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


def altered(floor_plan: Map, cleared: ArrayLike, filled: list[Floats]) -> Map:
    """Return a map with some of its wall cut out, then solids put in.

    On cells, a cell is painted if its centre is inside; a solid smaller than a cell paints one.
    ``cleared`` are boxes of its :func:`inner_walls`, (k, 4, 2), ``filled`` convex polygons,
    counterclockwise, (c, 2) each.
    """
    boxes = np.asarray(cleared, np.float64).reshape(-1, 4, 2)
    if not len(boxes) and not filled:
        return floor_plan
    if isinstance(floor_plan, GridMap):
        return floor_plan.painted((boxes, FREE), (filled, OCCUPIED))
    assert isinstance(floor_plan, PolygonMap)  # the forms of Map
    solids = tuple(tuple(map(tuple, polygon.tolist())) for polygon in filled)
    return PolygonMap(floor_plan.outer, (*floor_plan.obstacles, *solids), floor_plan.unit)


@lru_cache(8)
def inner_walls(floor_plan: Map) -> InnerWalls:
    """Return the inner walls of a map of cells, found along its axes; those of 8 are cached.

    A wall has nothing occupied beside it and is free on one side at least; walls at the map's edge
    are outer ones.
    """
    if not isinstance(floor_plan, GridMap):
        raise InputError(
            f"the map {floor_plan!r:.60} is of polygons, but only walls of cells can be changed or "
            "be glass: give an office or a ROS map, or leave this out."
        )
    px, step = pixel(floor_plan.unit), floor_plan.resolution
    solid, free = floor_plan.occupied, ~floor_plan.solid
    walls, doors = list[Piece](), list[Piece]()
    for upright in (True, False):
        cells = (solid, free) if upright else (solid.T, free.T)
        for pieces, runs in ((walls, _walls(*cells, step, px)), (doors, _doors(*cells, step, px))):
            pieces += [_piece(floor_plan, boxes, upright) for boxes in runs]
    if not walls:
        raise InputError(
            f"the map {floor_plan!r:.60} has no inner wall along its axes of at most "
            f"{_THICKEST * px:g} {floor_plan.unit}, so no wall can be changed or be glass: give a "
            "map with inner walls, or leave this out."
        )
    return InnerWalls(tuple(walls), tuple(doors), step)


def _piece(grid: GridMap, boxes: Floats, upright: bool) -> Piece:
    """Return a piece from its boxes (low u, low v, high u, high v), u across it, (k, 4)."""
    length = float(boxes[:, 3].max() - boxes[:, 1].min())
    if not upright:
        boxes = boxes[:, [1, 0, 3, 2]]
    corners = boxes[:, [[0, 1], [2, 1], [2, 3], [0, 3]]]
    across = np.array([1.0, 0.0] if upright else [0.0, 1.0])
    corners = grid.placed(corners.reshape(-1, 2) / grid.resolution).reshape(-1, 4, 2)
    ends = grid.placed(np.vstack([np.zeros(2), across]))
    return Piece(corners, length, (ends[1] - ends[0]) / grid.resolution)


def _walls(solid: Bools, free: Bools, step: float, px: float) -> list[Floats]:
    """Return the upright walls of cells (rows, columns), each as boxes, (k, 4); see ``_piece``."""
    row, first, last = (runs := _inner_runs(solid)).T
    thin = step * last - step * first <= _THICKEST * px * (1 + 1e-9)
    beside = free[row, first - 1] | free[row, last]
    walls = []
    for chain in _chains(runs[thin & beside], 1):
        boxes = _boxes(chain, step)
        length = boxes[-1, 3] - boxes[0, 1]
        thickness = float(np.median(boxes[:, 2] - boxes[:, 0]))
        if length >= max(_SHORTEST * px, thickness):
            walls += _cut_to_length(boxes, _LONGEST * px, step)
    return walls


def _doors(solid: Bools, free: Bools, step: float, px: float) -> list[Floats]:
    """Return the gaps in level walls, as ``_walls``."""
    row, first, last = (runs := _inner_runs(free)).T
    width = step * last - step * first
    narrow = (width >= _NARROWEST * px) & (width <= _WIDEST * px)
    between = solid[row, first - 1] & solid[row, last]
    chains = (_boxes(chain, step) for chain in _chains(runs[narrow & between], len(free.T)))
    return [boxes for boxes in chains if boxes[-1, 3] - boxes[0, 1] <= _DEEPEST * px]


def _inner_runs(among: Bools) -> Indices:
    """Return runs of True within rows: row, first column, column after the last, (n, 3)."""
    runs = np.column_stack(runs_of(among.astype(np.int8)))
    inner: Indices = runs[(runs[:, 1] > 0) & (runs[:, 2] < among.shape[1])]
    return inner


def _chains(runs: Indices, slack: int) -> list[Indices]:
    """Join runs of following rows whose ends differ by at most ``slack`` columns, (k, 3) each."""
    chains: list[list[Any]] = []
    before: list[list[Any]] = []  # those that end in the row before
    for row, row_runs in groupby(runs.tolist(), key=lambda run: run[0]):
        current = []
        for run in row_runs:
            for chain in before:
                last = chain[-1]
                near = abs(run[1] - last[1]) <= slack and abs(run[2] - last[2]) <= slack
                if last[0] == row - 1 and near and run[1] < last[2] and last[1] < run[2]:
                    chain.append(run)
                    current.append(chain)
                    break
            else:
                chains.append([run])
                current.append(chains[-1])
        before = current
    return [np.array(chain) for chain in chains]


def _boxes(chain: Indices, step: float) -> Floats:
    """Return a chain as boxes (low u, low v, high u, high v), equal rows in one, (k, 4)."""
    row, first, last = chain.T
    new = np.append(True, (np.diff(first) != 0) | (np.diff(last) != 0))
    ends = np.append(row[1:][new[1:]], row[-1] + 1)
    return step * np.column_stack([first[new], row[new], last[new], ends])


def _cut_to_length(boxes: Floats, longest: float, step: float) -> list[Floats]:
    """Cut a wall into equal pieces of at most ``longest``, at a multiple of ``step``."""
    low, high = boxes[0, 1], boxes[-1, 3]
    ends = np.linspace(low, high, math.ceil((high - low) / longest - 1e-9) + 1)
    ends = np.round(ends / step) * step
    pieces = []
    for begin, end in pairwise(ends):
        piece = boxes[(boxes[:, 3] > begin) & (boxes[:, 1] < end)].copy()
        piece[:, 1], piece[:, 3] = np.maximum(piece[:, 1], begin), np.minimum(piece[:, 3], end)
        pieces.append(piece)
    return pieces
