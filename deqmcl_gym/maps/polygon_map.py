"""PolygonMap: a map of polygons, for physics, lidar, localizers and drawing; read from JSON.

``{"outer": [[x, y], …], "obstacles": [[[x, y], …], …], "unit": "m"}``: the keys are those of
``floor_plan`` in Python and in TOML.
"""

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.files import UnreadableError, content_of, json_of
from deqmcl_gym.maps import drive_kernels, ray_kernels, stride_kernels
from deqmcl_gym.maps.drive_kernels import clearance_of
from deqmcl_gym.maps.grid_map import GridMap
from deqmcl_gym.maps.map import Box, Caster, MapForm, pixel
from deqmcl_gym.maps.polygons import (
    Polygon,
    as_box,
    has_free_space,
    oriented_edges,
    outlines_of,
    parse_polygon,
)
from deqmcl_gym.maps.ray_kernels import AllWalls
from deqmcl_gym.maps.stride_kernels import CellTable
from deqmcl_gym.numerics import Bools, Floats, Ints, Point, Singles
from deqmcl_gym.validation import InputError, one_of, shown

_ZERO_LENGTH = 1e-3  # px: a shorter edge counts as having no length
_FARTHEST = 1e9  # px: there, float64 resolves 1e-7 px


@final
@dataclass(frozen=True)
class PolygonMap(MapForm):
    """Polygonal walls around a free interior with solid obstacles; implements ``Map``.

    Polygons must be simple, and leave free space.
    """

    outer: Polygon  #: corners in order; the last is joined to the first
    obstacles: tuple[Polygon, ...] = ()  #: corners of each
    unit: str = "px"  #: of all lengths, "px" or "m"

    def __post_init__(self) -> None:
        limits = _ZERO_LENGTH * pixel(self.unit), _FARTHEST * pixel(self.unit)
        object.__setattr__(self, "outer", parse_polygon("the outer wall", self.outer, *limits))
        try:
            given = enumerate(self.obstacles)
        except TypeError:
            raise InputError(
                f"obstacles is {shown(self.obstacles)}, but must be a list of polygons; () for "
                "none."
            ) from None
        solid = tuple(parse_polygon(f"obstacle {i}", o, *limits) for i, o in given)
        object.__setattr__(self, "obstacles", solid)
        # a copy, as kernels are compiled for arrays that can be written
        if not has_free_space(self.walls.copy(), limits[0]):
            raise InputError(
                "the floor plan has no free space: its obstacles fill the outer wall; "
                "give smaller obstacles or a larger outer wall."
            )

    @classmethod
    def from_grid(cls, grid: GridMap) -> "PolygonMap":
        """Return the largest open region of a map of cells: its outline and the obstacles in it.

        All other open regions count as solid. Transparent cells are refused.
        """
        if grid.unknown == "transparent":
            raise InputError(
                'the grid has unknown = "transparent", but walls of polygons stop beams and robots '
                'alike: read the map with unknown = "obstacle" or "free".'
            )
        outer, *obstacles = (grid.placed(outline).tolist() for outline in outlines_of(grid.solid))
        return cls(outer=outer, obstacles=tuple(obstacles), unit=grid.unit)

    @cached_property
    def bounds(self) -> Box:
        """See ``Map.bounds``."""
        corners = np.array(self.outer)
        return (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())

    @cached_property
    def walls(self) -> Floats:
        """See ``Map.walls``."""
        solid = [oriented_edges(polygon, solid=True) for polygon in self.obstacles]
        walls = np.vstack([oriented_edges(self.outer, solid=False), *solid])
        walls.setflags(write=False)
        return walls

    def distance(self, points: ArrayLike) -> Singles:
        """See ``Map.distance``."""
        centres = self._points("points", points)
        square = np.empty(centres.shape[1], np.float32)
        drive_kernels.square_gaps(centres, centres, self._walls32, square)
        return np.sqrt(square)

    @cached_property
    def datum(self) -> Point:
        """See ``Map.datum``: (0, 0) unless the map is farther from there than twice its size."""
        x0, y0, x1, y1 = self.bounds
        near = max(map(abs, self.bounds)) <= 2 * max(x1 - x0, y1 - y0)
        return (0.0, 0.0) if near else (x0 + (x1 - x0) / 2, y0 + (y1 - y0) / 2)

    @cached_property
    def local(self) -> "PolygonMap":
        """See ``Map.local``."""
        if self.datum == (0.0, 0.0):
            return self
        local = object.__new__(PolygonMap)  # its polygons have been checked
        x0, y0 = self.datum
        outer, *obstacles = (
            tuple((x - x0, y - y0) for x, y in polygon) for polygon in (self.outer, *self.obstacles)
        )
        vars(local).update(
            outer=outer, obstacles=tuple(obstacles), unit=self.unit, datum=(0.0, 0.0)
        )
        return local

    def _rows(self, given: NDArray[Any]) -> Singles:
        """Return rows about the datum; see ``_moved``."""
        if self.datum == (0.0, 0.0):
            return np.asarray(given, dtype=np.float32, order="F").T
        return _moved(given.T, self.datum)

    def _open(self, centres: Singles) -> Bools:
        windings = np.empty(centres.shape[1], np.int32)
        drive_kernels.wind(centres, self._walls32, windings)
        return np.equal(windings, 1)

    def _feasible(self, starts: Singles, ends: Singles, radius: float) -> Bools:
        clear, size = np.empty(ends.shape[1], np.bool_), np.float32(radius)
        drive_kernels.feasible(starts, ends, self._walls32, size, self._clearance, clear)
        return clear

    def _driven(
        self, poses: Singles, moves: Singles, path: Singles, radius: float, kept: int
    ) -> tuple[Singles, Ints]:
        paths = np.empty((kept, *poses.shape), np.float32)
        hits = np.empty(poses.shape[1], np.int32)
        local, size = _moved(poses, self.datum), np.float32(radius)
        drive_kernels.roll_out(
            local, moves, path, self._walls32, size, self._clearance, hits, paths
        )
        return _moved(paths, self.datum, -1), hits

    @cached_property
    def _walls32(self) -> Singles:
        return np.ascontiguousarray(self.local.walls, dtype=np.float32)

    @cached_property
    def _clearance(self) -> tuple[Any, ...]:
        return tuple(clearance_of(self._walls32))

    @cached_property
    def caster(self) -> Caster:
        """See ``Map.caster``."""
        if self.local is not self:
            return _FarCaster(self.local.caster, self.datum)
        return caster_of(self.outer, self.obstacles, pixel(self.unit))


@dataclass(frozen=True)
class _FarCaster:
    """The caster of a map far from (0, 0), for poses in the map's frame."""

    local: Caster
    datum: Point

    def cast(self, poses: Singles, bearings: Singles, out: Singles) -> None:
        """See ``Caster``."""
        self.local.cast(_moved(poses, self.datum), bearings, out)


def _moved(rows: NDArray[Any], datum: Point, sign: int = 1) -> Singles:
    """Return rows x, y, … (…, 2+, n) about the datum, float32; with ``sign`` -1, the inverse."""
    if datum == (0.0, 0.0):
        return rows
    moved = np.array(rows, dtype=np.float64, order="C")
    for axis in (0, 1):
        moved[..., axis, :] -= sign * datum[axis]
    return moved.astype(np.float32)


_PER_WALL = 4  # cells; the fastest of 2 to 16 among 256 and 1,024 walls


# px: walls are extended by this at both ends, so that no ray slips between two at a corner
OVERLAP = 5e-4
# px: a wall this close to a cell counts as in it; far above rounding errors
MARGIN = 0.05
# From this many walls on, walking through cells is faster than trying all walls. A box counts as
# one wall, a wall along an axis as a third. In an office with 232 of the latter, all at once does
# 31 M rays/s and cell by cell 12 M; with 844 it is 8 M and 11 M; with 256 oblique walls 14 M and
# 12 M.
MANY_WALLS = 192
_PARALLEL = 1 / 3
# Below this, lanes over the beams of each pose are faster than lanes over the poses.
FEW_POSES = 8


# Rectangles that no ray leaves, and that none enters.
EVERYWHERE: Box = (-math.inf, -math.inf, math.inf, math.inf)
NO_BOX: Box = (math.inf, math.inf, math.inf, math.inf)


@dataclass(frozen=True)
class AllAtOnce:
    """All walls against all rays, side by side in SIMD lanes."""

    walls: AllWalls

    def cast(self, poses: Singles, bearings: Singles, out: Singles) -> None:
        """See ``Caster``."""
        kernel = ray_kernels.cast_fans if poses.shape[1] < FEW_POSES else ray_kernels.cast_all
        kernel(poses, bearings, tuple(self.walls), out)

    @property
    def tries(self) -> float:
        """Number of oblique walls that would take as long as these walls."""
        walls = self.walls
        rectangles = sum(bool(np.isfinite(box[0])) for box in (walls.room, walls.box))
        parallel = len(walls.upright) + len(walls.level)
        return rectangles + len(walls.boxes) + _PARALLEL * parallel + len(walls.oblique)


@dataclass(frozen=True)
class CellByCell:
    """Each ray against the walls in the cells it crosses."""

    outer: Singles
    table: CellTable  # square cells, with a ring around the walls
    place: tuple[float, float, float]  # its lower left corner (x, y), and a cell's side

    def cast(self, poses: Singles, bearings: Singles, out: Singles) -> None:
        """See ``Caster``."""
        ray_kernels.cast_through(poses, bearings, self.outer, tuple(self.table), self.place, out)


def caster_of(outer: Polygon, obstacles: Sequence[Polygon], px: float) -> Caster:
    """Return the faster caster for these walls; ``px`` is a pixel in their unit."""
    brute = all_at_once(outer, obstacles, px)
    return brute if brute.tries < MANY_WALLS else cell_by_cell(outer, obstacles, px)


def all_at_once(outer: Polygon, obstacles: Sequence[Polygon], px: float) -> AllAtOnce:
    """Sort walls by direction: those along an axis need less arithmetic."""
    room, found = as_box(outer), [as_box(polygon) for polygon in obstacles]
    polygons = zip((outer, *obstacles), (room, *found), strict=True)
    walls = _edges([polygon for polygon, box in polygons if box is None])
    boxes = np.array([box for box in found if box is not None] or [NO_BOX], np.float32)
    x0, y0, x1, y1 = walls.T
    upright, level = x0 == x1, y0 == y1
    overlap = OVERLAP * px
    low_x, high_x = np.minimum(x0, x1) - overlap, np.maximum(x0, x1) + overlap
    low_y, high_y = np.minimum(y0, y1) - overlap, np.maximum(y0, y1) + overlap
    walls32 = AllWalls(
        outer=_outer(outer),
        room=np.array(EVERYWHERE if room is None else room, np.float32),
        box=boxes[0],
        boxes=boxes[1:],
        upright=_singles([x0, low_y, high_y])[upright],
        level=_singles([y0, low_x, high_x])[level],
        oblique=_directed(walls[~(upright | level)], overlap),
    )
    return AllAtOnce(walls32)


def cell_by_cell(outer: Polygon, obstacles: Sequence[Polygon], px: float) -> CellByCell:
    """Sort walls into square cells, a handful for each; one within ``MARGIN`` counts as in it."""
    walls, margin = _edges([outer, *obstacles]), MARGIN * px
    x, y = walls[:, [0, 2]], walls[:, [1, 3]]
    width, height = (float(np.ptp(axis)) + 4 * margin for axis in (x, y))
    side = max(math.sqrt(width * height / (_PER_WALL * len(walls))), max(width, height) / 4096)
    columns, rows = math.ceil(width / side) + 2, math.ceil(height / side) + 2
    corner = float(x.min()) - 2 * margin - side, float(y.min()) - 2 * margin - side
    inside = (walls - np.tile(corner, 2)) / side
    first = np.zeros(rows * columns + 1, np.int32)
    stride_kernels.count_walls(inside, margin / side, columns, first)
    np.cumsum(first, out=first)
    listed = np.empty(first[-1], np.int32)
    stride_kernels.list_walls(inside, margin / side, columns, first.copy(), listed)
    taken = np.diff(first).reshape(rows, columns) > 0
    taken[[0, -1]] = taken[:, [0, -1]] = True
    reach = np.empty((rows, columns), np.uint8)
    stride_kernels.fill_reach(taken, reach)
    scaled = _directed(walls, OVERLAP * px).astype(np.float64)
    scaled[:, :2] = (scaled[:, :2] - corner) / side
    scaled[:, 4:] /= side
    table = CellTable(reach, first, listed, scaled.astype(np.float32), False)
    return CellByCell(_outer(outer), table, (*corner, side))


def _outer(polygon: Polygon) -> Singles:
    return oriented_edges(polygon, solid=False).astype(np.float32)


def _edges(polygons: Sequence[Polygon]) -> Floats:
    edges = [oriented_edges(polygon, solid=True) for polygon in polygons]
    return np.vstack([np.empty((0, 4)), *edges])


def _directed(walls: Floats, overlap: float) -> Singles:
    """(x₀, y₀, unit x, unit y, low, high) of walls (S, 4), (S, 6)."""
    x0, y0, x1, y1 = walls.T
    length = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2)
    start = np.full_like(length, -overlap)
    return _singles([x0, y0, (x1 - x0) / length, (y1 - y0) / length, start, length + overlap])


def _singles(columns: list[Floats]) -> Singles:
    return np.ascontiguousarray(np.column_stack(columns), dtype=np.float32)


KEYS = ("outer", "obstacles", "unit")


def read_polygons(path: str | os.PathLike[str]) -> PolygonMap:
    """Read a map."""
    try:
        given = json_of(content_of(Path(os.path.expanduser(path))))
    except FileNotFoundError:
        raise InputError(f"the map file {path} does not exist: give one that does.") from None
    except UnreadableError as error:
        raise InputError(f"the map file {path} {error}.") from None
    try:
        for key in given:
            one_of("key", key, KEYS)
        return of_mapping(given)
    except InputError as error:
        raise InputError(f"the map {path}: {error}") from None


def of_mapping(given: Any) -> PolygonMap:
    """Return the map that a mapping describes."""
    if not isinstance(given, Mapping):
        kind = type(given).__name__
        raise InputError(f"it is a {kind}, but must be a mapping of {', '.join(KEYS)}.")
    for key in given:
        one_of("key in floor_plan", key, (*KEYS, "file", "office"))
    return PolygonMap(**{"outer": None, **given})


def polygons_text(floor_plan: PolygonMap) -> str:
    """Return a map as JSON, one polygon per line."""
    outer, unit = json.dumps(floor_plan.outer), json.dumps(floor_plan.unit)
    obstacles = ",\n".join(map(json.dumps, floor_plan.obstacles))
    return f'{{"unit": {unit},\n"outer": {outer},\n"obstacles": [\n{obstacles}\n]}}\n'
