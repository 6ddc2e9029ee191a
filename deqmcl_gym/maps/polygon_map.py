"""PolygonMap: a map of polygons, for physics, lidar, localizers and drawing; read from JSON.

``{"outer": [[x, y], …], "obstacles": [[[x, y], …], …], "unit": "m"}``: the keys are those of
``floor_plan`` in Python and in TOML.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.files import UnreadableError, content_of, json_of
from deqmcl_gym.maps import drive_kernels
from deqmcl_gym.maps.casting import caster_of
from deqmcl_gym.maps.drive_kernels import clearance_of
from deqmcl_gym.maps.grid_map import GridMap
from deqmcl_gym.maps.map import (
    NO_MOVES,
    NO_PATH,
    Box,
    Caster,
    check_beams,
    check_moves,
    check_pairs,
    check_path,
    pixel,
    table,
)
from deqmcl_gym.maps.polygons import (
    Polygon,
    has_free_space,
    oriented_edges,
    outlines_of,
    parse_polygon,
    thinned,
)
from deqmcl_gym.numerics import Bools, Floats, Ints, Point, Singles
from deqmcl_gym.validation import InputError, number, one_of, shown

_ZERO_LENGTH = 1e-3  # px: a shorter edge counts as having no length
_FARTHEST = 1e9  # px: there, float64 resolves 1e-7 px


@final
@dataclass(frozen=True)
class PolygonMap:
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
    def from_grid(cls, grid: GridMap, tolerance: float = 0.0) -> "PolygonMap":
        """Return the largest open region of a map of cells: its outline and the obstacles in it.

        All other open regions count as solid. Transparent cells are refused. ``tolerance`` is the
        largest distance of an outline from that of the cells, m; 0 keeps all corners. It is smaller
        where two outlines would cross.
        """
        if grid.unknown == "transparent":
            raise InputError(
                'the grid has unknown = "transparent", but walls of polygons stop beams and robots '
                'alike: read the map with unknown = "obstacle" or "free".'
            )
        number("tolerance", tolerance, low=0)
        outlines = outlines_of(grid.solid)
        if tolerance > 0.0:
            apart = 2 * _ZERO_LENGTH * pixel(grid.unit)
            outlines = thinned(outlines, tolerance / grid.resolution, apart / grid.resolution)
        outer, *obstacles = (grid.placed(outline).tolist() for outline in outlines)
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

    def ranges(self, poses: ArrayLike, bearings: ArrayLike) -> Singles:
        """See ``Map.ranges``."""
        beams = check_beams(poses, bearings)
        origins = self._rows("poses", poses, 3)
        out = np.empty((beams.size, origins.shape[1]), np.float32)
        self.local.caster.cast(origins, beams, out)
        return out.T

    def collides(self, starts: ArrayLike, ends: ArrayLike, radius: float) -> Bools:
        """See ``Map.collides``."""
        before, after = self._rows("starts", starts, 2), self._rows("ends", ends, 2)
        check_pairs(before, after, radius)
        clear = np.empty(after.shape[1], np.bool_)
        drive_kernels.feasible(
            before, after, self._walls32, np.float32(radius), self._clearance, clear
        )
        return ~clear

    def rolled_out(
        self, poses: Singles, moves: Singles, radius: float, *, kept: int
    ) -> tuple[Singles, Ints]:
        """See ``Map.rolled_out``."""
        check_moves(poses, moves, kept, radius)
        return self._rolled_out(poses, moves, NO_PATH, radius, kept)

    def collisions_along(self, poses: Singles, path: Singles, radius: float) -> Ints:
        """See ``Map.collisions_along``."""
        check_path(poses, path, radius)
        return self._rolled_out(poses, NO_MOVES, path, radius, 0)[1]

    def _rolled_out(
        self, poses: Singles, moves: Singles, path: Singles, radius: float, kept: int
    ) -> tuple[Singles, Ints]:
        paths = np.empty((kept, *poses.shape), np.float32)
        hits = np.empty(poses.shape[1], np.int32)
        local, size = _moved(poses, self.datum), np.float32(radius)
        drive_kernels.roll_out(
            local, moves, path, self._walls32, size, self._clearance, hits, paths
        )
        return _moved(paths, self.datum, -1), hits

    def free(self, points: ArrayLike, radius: float = 0.0) -> Bools:
        """See ``Map.free``."""
        centres = self._rows("points", points, 2)
        free = np.empty(centres.shape[1], np.bool_)
        if number("radius", radius, low=0) == 0.0:
            windings = np.empty(centres.shape[1], np.int32)
            drive_kernels.wind(centres, self._walls32, windings)
            np.equal(windings, 1, out=free)
        else:
            drive_kernels.feasible(
                centres, centres, self._walls32, np.float32(radius), self._clearance, free
            )
        return free

    def distance(self, points: ArrayLike) -> Singles:
        """See ``Map.distance``."""
        centres = self._rows("points", points, 2)
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

    def _rows(self, what: str, items: ArrayLike, columns: int) -> Singles:
        """(n, d) in any layout as contiguous rows (columns, n) about the datum; see ``_moved``."""
        given = table(what, items, columns)
        if self.datum == (0.0, 0.0):
            rows = np.asarray(given, dtype=np.float32, order="F").T  # no copy of rows that fit
        else:
            rows = _moved(given.T, self.datum)
        return rows if len(rows) == columns else rows[:columns]

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


def driven(poses: Singles, moves: Singles) -> Singles:
    """Turn, then move: θ' = θ + turn; (x', y') = (x, y) + R(θ') (forward, left); θ' in [-π, π].

    Poses x, y, θ and moves forward, left, turn are rows, (3, n) float32.
    """
    if len(poses) != 3 or poses.shape != moves.shape:
        raise InputError(
            f"poses have shape {poses.shape} and moves {moves.shape}, but both must be (3, n)."
        )
    out = np.empty_like(poses)
    drive_kernels.drive(poses, moves, out)
    return out


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
