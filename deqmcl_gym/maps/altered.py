"""Maps that differ from a given one: its inner walls and doors, solids put in, walls cut out.

Inner walls are found along the axes of a map: straight strips of wall with open space beside them.
"""

import math
from functools import lru_cache
from itertools import groupby, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.maps.grid_file import FREE, OCCUPIED
from deqmcl_gym.maps.grid_map import GridMap
from deqmcl_gym.maps.map import Map, pixel
from deqmcl_gym.maps.polygons import PolygonMap
from deqmcl_gym.numerics import Bools, Floats, Indices
from deqmcl_gym.validation import InputError

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


class _Lattice(NamedTuple):
    """A map between lines along its axes."""

    walls: Bools  # which cells are wall, (rows, columns)
    free: Bools
    us: Floats  # the lines between columns, (columns + 1,)
    vs: Floats  # between rows, (rows + 1,)

    @property
    def turned(self) -> "_Lattice":
        """The same with rows and columns swapped."""
        return _Lattice(self.walls.T, self.free.T, self.vs, self.us)


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


def comes_near(points: Floats, polygon: Floats, within: float) -> bool:
    """Whether any of ``points`` (n, 2) is nearer to a convex polygon (c, 2) than ``within``."""
    low, high = polygon.min(axis=0) - within, polygon.max(axis=0) + within
    near = points[((points > low) & (points < high)).all(axis=1)]
    if not len(near):
        return False
    along = np.roll(polygon, -1, axis=0) - polygon
    off = near[:, None] - polygon
    if (along[:, 0] * off[..., 1] >= along[:, 1] * off[..., 0]).all(axis=1).any():
        return True  # inside
    share = np.clip((off * along).sum(axis=2) / (along**2).sum(axis=1), 0.0, 1.0)
    square = ((off - share[..., None] * along) ** 2).sum(axis=2)
    return bool(square.min() < within * within)


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
    us, vs = (step * np.arange(size + 1) for size in floor_plan.solid.shape[::-1])
    lattice = _Lattice(floor_plan.occupied, ~floor_plan.solid, us, vs)
    walls, doors = list[Piece](), list[Piece]()
    for upright in (True, False):
        own = lattice if upright else lattice.turned
        for found, boxes in ((walls, _walls(own, step, px)), (doors, _doors(own, px))):
            found += [_piece(floor_plan, one, upright) for one in boxes]
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


def _walls(lattice: _Lattice, step: float, px: float) -> list[Floats]:
    """Return the upright walls, each as boxes (low u, low v, high u, high v), (k, 4)."""
    runs = _runs(lattice.walls)
    row, first, last = runs.T
    inner = (first > 0) & (last < lattice.us.size - 1)
    runs, row, first, last = runs[inner], row[inner], first[inner], last[inner]
    thin = lattice.us[last] - lattice.us[first] <= _THICKEST * px * (1 + 1e-9)
    beside = lattice.free[row, first - 1] | lattice.free[row, last]
    found = []
    for chain in _chains(runs[thin & beside], 1):
        boxes = _boxes(lattice, chain)
        length = boxes[-1, 3] - boxes[0, 1]
        thickness = float(np.median(boxes[:, 2] - boxes[:, 0]))
        if length >= max(_SHORTEST * px, thickness):
            found += _cut_to_length(boxes, _LONGEST * px, step)
    return found


def _doors(lattice: _Lattice, px: float) -> list[Floats]:
    """Return the gaps in level walls, as ``_walls``."""
    runs = _runs(lattice.free)
    row, first, last = runs.T
    inner = (first > 0) & (last < lattice.us.size - 1)
    runs, row, first, last = runs[inner], row[inner], first[inner], last[inner]
    width = lattice.us[last] - lattice.us[first]
    narrow = (width >= _NARROWEST * px) & (width <= _WIDEST * px)
    between = lattice.walls[row, first - 1] & lattice.walls[row, last]
    chains = (_boxes(lattice, one) for one in _chains(runs[narrow & between], lattice.us.size))
    return [boxes for boxes in chains if boxes[-1, 3] - boxes[0, 1] <= _DEEPEST * px]


def _runs(among: Bools) -> Indices:
    """Return all runs of True in rows: row, first column, column after the last, (n, 3)."""
    steps = np.diff(np.pad(among, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, first = np.nonzero(steps == 1)
    return np.column_stack([row, first, np.nonzero(steps == -1)[1]])


def _chains(runs: Indices, slack: int) -> list[Indices]:
    """Join runs of following rows whose ends differ by at most ``slack`` columns, (k, 3) each."""
    chains: list[list[Any]] = []
    before: list[list[Any]] = []  # those that end in the row before
    for row, own in groupby(runs.tolist(), key=lambda run: run[0]):
        here = []
        for run in own:
            for chain in before:
                last = chain[-1]
                near = abs(run[1] - last[1]) <= slack and abs(run[2] - last[2]) <= slack
                if last[0] == row - 1 and near and run[1] < last[2] and last[1] < run[2]:
                    chain.append(run)
                    here.append(chain)
                    break
            else:
                chains.append([run])
                here.append(chains[-1])
        before = here
    return [np.array(chain) for chain in chains]


def _boxes(lattice: _Lattice, chain: Indices) -> Floats:
    """Return a chain as boxes (low u, low v, high u, high v), equal rows in one, (k, 4)."""
    row, first, last = chain.T
    new = np.append(True, (np.diff(first) != 0) | (np.diff(last) != 0))
    ends = np.append(row[1:][new[1:]], row[-1] + 1)
    us, vs = lattice.us, lattice.vs
    return np.column_stack([us[first[new]], vs[row[new]], us[last[new]], vs[ends]])


def _cut_to_length(boxes: Floats, longest: float, step: float) -> list[Floats]:
    """Cut a wall into equal pieces of at most ``longest``, at a multiple of ``step``."""
    low, high = boxes[0, 1], boxes[-1, 3]
    ends = np.linspace(low, high, math.ceil((high - low) / longest - 1e-9) + 1)
    ends = np.round(ends / step) * step
    pieces = []
    for begin, end in pairwise(ends):
        own = boxes[(boxes[:, 3] > begin) & (boxes[:, 1] < end)].copy()
        own[:, 1], own[:, 3] = np.maximum(own[:, 1], begin), np.minimum(own[:, 3], end)
        pieces.append(own)
    return pieces
