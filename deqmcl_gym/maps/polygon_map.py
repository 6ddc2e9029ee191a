"""PolygonMap: the map m, one geometry for physics, lidar, localizers and drawing."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.maps import grid_walls, kernels
from deqmcl_gym.maps.casting import caster_of
from deqmcl_gym.maps.clearance import clearance_of
from deqmcl_gym.maps.grid_map import GridMap
from deqmcl_gym.maps.map import Box, Caster
from deqmcl_gym.maps.polygons import Polygon, oriented_edges, parse_polygon
from deqmcl_gym.maps.units import pixel
from deqmcl_gym.numerics.types import Bools, Floats, Ints, Singles
from deqmcl_gym.validation import InputError

_ZERO_LENGTH = 1e-3  # px: an edge shorter than this is none


@final
@dataclass(frozen=True)
class PolygonMap:
    """Polygonal walls around a free interior, with solid obstacles inside: a form of ``Map``.

    Attributes:
        outer: corners of the outer wall, in order, closed by itself.
        obstacles: corners of each solid obstacle.
        unit: of all lengths, "px" or "m".

    Raises:
        InputError: a polygon with fewer than 3 corners, NaN, a zero-length edge or crossing edges;
            no free space; an unknown unit.
    """

    outer: Polygon
    obstacles: tuple[Polygon, ...] = ()
    unit: str = "px"

    def __post_init__(self) -> None:
        shortest = _ZERO_LENGTH * self._pixel
        object.__setattr__(self, "outer", parse_polygon("the outer wall", self.outer, shortest))
        try:
            given = enumerate(self.obstacles)
        except TypeError:
            raise InputError(
                f"obstacles is {self.obstacles!r}, but must be a list of polygons; () for none."
            ) from None
        solid = tuple(parse_polygon(f"obstacle {i}", o, shortest) for i, o in given)
        object.__setattr__(self, "obstacles", solid)
        x0, y0, x1, y1 = self.bounds
        grid = np.meshgrid(*(np.linspace(a, b, 130)[1:-1] for a, b in ((x0, x1), (y0, y1))))
        if not self.free(np.column_stack([axis.ravel() for axis in grid])).any():
            raise InputError(
                "the floor plan has no free space: its obstacles fill the outer wall; "
                "give smaller obstacles or a larger outer wall."
            )

    @classmethod
    def from_grid(cls, grid: GridMap) -> "PolygonMap":
        """Return the largest open region of a map of cells, its outline and what stands in it.

        Exact, corner by corner. Regions that are walled off from it count as solid.
        """
        rows, columns = grid.solid.shape
        corners = np.stack(np.meshgrid(np.arange(columns + 1), np.arange(rows + 1)), axis=-1)
        cells = grid.placed(corners.reshape(-1, 2)).reshape(rows + 1, columns + 1, 2)
        outer, obstacles = grid_walls.polygons_of(grid_walls.faces_of(grid.solid), cells)
        solid = tuple(obstacle.tolist() for obstacle in obstacles)
        return cls(outer=outer.tolist(), obstacles=solid, unit=grid.unit)

    @cached_property
    def bounds(self) -> Box:
        """See ``Map.bounds``."""
        corners = np.array(self.outer)
        return (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())

    @cached_property
    def walls(self) -> Floats:
        """See ``Map.walls``."""
        solid = [oriented_edges(polygon, solid=True) for polygon in self.obstacles]
        return np.vstack([oriented_edges(self.outer, solid=False), *solid])

    def ranges(self, poses: ArrayLike, bearings: ArrayLike) -> Singles:
        """See ``Map.ranges``."""
        origins = _rows(poses, 3)
        beams = np.asarray(bearings, dtype=np.float32)
        out = np.empty((beams.size, origins.shape[1]), np.float32)
        self.caster.cast(origins, beams, out)
        return out.T

    def collides(self, starts: ArrayLike, ends: ArrayLike, radius: float) -> Bools:
        """See ``Map.collides``."""
        before, after = _rows(starts, 2), _rows(ends, 2)
        clear = np.empty(after.shape[1], np.bool_)
        kernels.feasible(before, after, self._walls32, np.float32(radius), self._clearance, clear)
        return ~clear

    def rolled_out(
        self, poses: Singles, moves: Singles, radius: float, *, kept: int
    ) -> tuple[Singles, Ints]:
        """Drive poses through several moves: ``driven`` and ``collides``, step by step, in one.

        Args:
            poses: rows x, y, θ, (3, n) float32.
            moves: distances and turns of each step, (F, 2, n) float32.
            radius: of the disc.
            kept: F to return the poses after each step, 1 for those after the last alone.

        Returns:
            The poses, (kept, 3, n), and how many steps of each collide, (n,).
        """
        paths = np.empty((kept, *poses.shape), np.float32)
        hits = np.empty(poses.shape[1], np.int32)
        size = np.float32(radius)
        kernels.roll_out(poses, moves, self._walls32, size, self._clearance, hits, paths)
        return paths, hits

    def free(self, points: ArrayLike, radius: float = 0.0) -> Bools:
        """See ``Map.free``."""
        centres = _rows(points, 2)
        free = np.empty(centres.shape[1], np.bool_)
        if radius == 0.0:
            windings = np.empty(centres.shape[1], np.int32)
            kernels.wind(centres, self._walls32, windings)
            np.equal(windings, 1, out=free)
        else:
            kernels.feasible(
                centres, centres, self._walls32, np.float32(radius), self._clearance, free
            )
        return free

    def distance(self, points: ArrayLike) -> Singles:
        """See ``Map.distance``."""
        centres = _rows(points, 2)
        square = np.empty(centres.shape[1], np.float32)
        kernels.sweep(centres, centres, self._walls32, square)
        return np.sqrt(square)

    @cached_property
    def _walls32(self) -> Singles:
        return np.ascontiguousarray(self.walls, dtype=np.float32)

    @cached_property
    def _clearance(self) -> tuple[Any, ...]:
        return tuple(clearance_of(self._walls32))

    @cached_property
    def caster(self) -> Caster:
        """See ``Map.caster``."""
        return caster_of(self.outer, self.obstacles, self._pixel)

    @cached_property
    def _pixel(self) -> float:
        return pixel(self.unit)


def driven(poses: Singles, distances: Singles, turns: Singles) -> Singles:
    """Turn, then drive: θ' = θ + turn; (x', y') = (x, y) + distance (cos θ', sin θ').

    Args:
        poses: rows x, y, θ, (3, n) float32.
        distances, turns: (n,) float32.

    Returns:
        (3, n), θ' in [-π, π].
    """
    out = np.empty_like(poses)
    kernels.drive(poses, distances, turns, out)
    return out


def _rows(items: ArrayLike, columns: int) -> Singles:
    """(n, d) in any layout as contiguous float32 rows (columns, n); such rows' .T is not copied."""
    rows = np.asarray(items, dtype=np.float32, order="F").T
    return rows if len(rows) == columns else rows[:columns]
