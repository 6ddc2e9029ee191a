"""Ray casting on polygons: each ray against all walls or, among many walls, cell by cell."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from deqmcl_gym.maps import ray_kernels, stride_kernels
from deqmcl_gym.maps.map import Box, Caster
from deqmcl_gym.maps.polygons import Polygon, as_box, oriented_edges
from deqmcl_gym.maps.ray_kernels import AllWalls
from deqmcl_gym.maps.stride_kernels import CellTable
from deqmcl_gym.numerics import Floats, Singles

_PER_WALL = 4  # cells; the fastest of 2 to 16 among 256 and 1,024 walls


class SortedWalls(NamedTuple):
    """Walls sorted into square cells."""

    corner: tuple[float, float]  # lower left corner of the table (x, y)
    side: float
    table: CellTable  # the cells, with a ring around the walls


def sorted_walls(walls: Floats, directed: Singles, margin: float) -> SortedWalls:
    """Sort walls into square cells, a handful for each; one closer than ``margin`` counts as in it.

    Walls are (x₀, y₀, x₁, y₁), (S, 4), ``directed`` (x₀, y₀, unit x, unit y, low, high), (S, 6).
    """
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
    scaled = directed.astype(np.float64)
    scaled[:, :2] = (scaled[:, :2] - corner) / side
    scaled[:, 4:] /= side
    return SortedWalls(
        corner, side, CellTable(reach, first, listed, scaled.astype(np.float32), False)
    )


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
    cells: SortedWalls

    def cast(self, poses: Singles, bearings: Singles, out: Singles) -> None:
        """See ``Caster``."""
        (x, y), side, table = self.cells
        ray_kernels.cast_through(poses, bearings, self.outer, tuple(table), (x, y, side), out)


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
    """Sort walls into cells."""
    walls = _edges([outer, *obstacles])
    cells = sorted_walls(walls, _directed(walls, OVERLAP * px), MARGIN * px)
    return CellByCell(outer=_outer(outer), cells=cells)


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
