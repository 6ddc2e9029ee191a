"""Polygons: checked, their edges, and PolygonMap, a map of them for physics, lidar and localizers.

A file is JSON, ``{"outer": [[x, y], …], "obstacles": [[[x, y], …], …], "unit": "m"}``: the keys are
those of ``floor_plan`` in Python and in TOML.
"""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.files import content_of, json_of, refusing
from deqmcl_gym.maps import drive_kernels, ray_kernels
from deqmcl_gym.maps.map import Box, Map, pixel
from deqmcl_gym.maps.ray_kernels import AllWalls
from deqmcl_gym.numerics import Bools, Floats, Ints, Singles
from deqmcl_gym.validation import InputError, array, digits, one_of, shown

Polygon = Sequence[tuple[float, float]]

_ZERO_LENGTH = 1e-3  # px: a shorter edge counts as having no length
_FARTHEST = 5e5  # px (10 km): there, single precision resolves 0.03 px
_LATTICE = 64  # points a side at which free space is looked for, if there is none beside walls
# px: walls are extended by this at both ends, so that no ray slips between two at a corner
OVERLAP = 5e-4
# Below this, lanes over the beams of each pose are faster than lanes over the poses.
FEW_POSES = 8
KEYS = ("outer", "obstacles", "unit")


def _first_touching(edges: Floats, within: float) -> tuple[int, int] | None:
    """Return the first two edges (S, 4) without a common corner that cross or are this near."""
    for first, edge in enumerate(edges):
        others = edges[first + 2 : len(edges) - (first == 0)]
        sides = [_sides(edge, others[:, :2]) * _sides(edge, others[:, 2:])]
        sides.append(_sides(others, edge[:2]) * _sides(others, edge[2:]))
        near = [square_distances(edge, others[:, :2]), square_distances(edge, others[:, 2:])]
        near += [square_distances(others, edge[:2]), square_distances(others, edge[2:])]
        touching = (np.max(sides, axis=0) < 0.0) | (np.min(near, axis=0) <= within * within)
        if touching.any():
            return first, first + 2 + int(touching.argmax())
    return None


def _sides(edges: Floats, points: Floats) -> Floats:
    """Sides of the lines of edges (…, 4) on which points (…, 2) lie: -1, 0 or 1."""
    x0, y0, x1, y1 = edges.T
    x, y = points.T
    sides: Floats = np.sign((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0))
    return sides  # a product of two areas may underflow


def square_distances(edges: Floats, points: Floats) -> Floats:
    """Squared distances between edges (…, 4) and points (…, 2)."""
    along, off = edges[..., 2:] - edges[..., :2], points - edges[..., :2]
    share = np.clip((off * along).sum(axis=-1) / (along**2).sum(axis=-1), 0.0, 1.0)
    squares: Floats = ((off - share[..., None] * along) ** 2).sum(axis=-1)
    return squares


def parse_polygon(
    name: str, polygon: Any, shortest: float, farthest: float
) -> tuple[tuple[float, float], ...]:
    """Return the corners of a simple polygon, no coordinate above ``farthest``.

    No edge is shorter than ``shortest``, and no two that share no corner are nearer than that.
    """
    try:
        corners = array(name, list(polygon), (None, 2))
    except TypeError:
        raise InputError(
            f"{name} is {shown(polygon)}, but must be a list of (x, y) corners."
        ) from None
    if len(corners) < 3:
        raise InputError(f"{name} has {len(corners)} corners, but a polygon needs 3 or more.")
    if (far := np.flatnonzero(np.abs(corners).max(axis=1) > farthest)).size:
        raise InputError(
            f"{name} has the corner {_point(corners[far[0]])}, but coordinates of more than "
            f"{farthest:g} are too coarse: move the floor plan towards (0, 0)."
        )
    edges = edges_of(corners)
    along = edges[:, 2:] - edges[:, :2]
    lengths = np.sqrt((along**2).sum(axis=1))
    if (short := np.flatnonzero(lengths < shortest)).size:
        raise InputError(
            f"{name} has an edge of zero length at {_point(corners[short[0]])}: name each corner "
            "once; the last corner is joined to the first by itself."
        )
    after, longer = np.roll(along, -1, axis=0), np.maximum(lengths, np.roll(lengths, -1))
    across = np.abs(along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0])
    # how far the far end of the shorter edge is from the longer one
    folds = ((along * after).sum(axis=1) < 0.0) & (across < shortest * longer)
    if folds.any():
        corner = (folds.argmax() + 1) % len(edges)
        raise InputError(
            f"{name} folds back on itself at corner {corner}, {_point(edges[corner, :2])}: leave "
            "that corner out, or give the wall some thickness."
        )
    if (touching := _first_touching(edges, shortest)) is not None:
        first, second = touching
        raise InputError(
            f"{name} crosses or touches itself between edges {first} and {second}, from "
            f"{_point(edges[first, :2])} and {_point(edges[second, :2])}: give its corners in "
            f"order around it, edges {shortest:g} apart, or two polygons."
        )
    return tuple((x, y) for x, y in corners.tolist())


def _has_free_space(walls: Floats, bounds: Box, least: float) -> bool:
    """Whether the walls (S, 4) wind once around a point beside one of them, or of a lattice."""
    along = walls[:, 2:] - walls[:, :2]
    normal = along[:, ::-1] * (-1, 1) / np.sqrt((along**2).sum(axis=1, keepdims=True))
    beside = walls[:, :2] + along / 2 + least * normal
    across, up = (np.linspace(bounds[i], bounds[i + 2], _LATTICE + 2)[1:-1] for i in (0, 1))
    lattice = np.stack(np.meshgrid(across, up), axis=-1).reshape(-1, 2)
    x0, y0, x1, y1 = walls.T
    for x, y in (*beside, *lattice):
        left = (x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)
        rises, falls = (y0 <= y) & (y1 > y) & (left > 0.0), (y0 > y) & (y1 <= y) & (left < 0.0)
        if rises.sum() - falls.sum() == 1:
            return True
    return False


def oriented_edges(polygon: Polygon, *, solid: bool) -> Floats:
    """Return the edges (S, 4), counterclockwise, or clockwise if the polygon is ``solid``."""
    corners = np.array(polygon)
    clockwise = signed_area(corners) < 0
    return edges_of(corners if clockwise == solid else corners[::-1])


def as_box(polygon: Polygon) -> Box | None:
    """Return (x_low, y_low, x_high, y_high) if the polygon is an axis-aligned rectangle."""
    if len(polygon) != 4:
        return None
    (x0, y0), (x1, y1) = np.min(polygon, axis=0).tolist(), np.max(polygon, axis=0).tolist()
    corners = {(x, y) for x in (x0, x1) for y in (y0, y1)}
    return (x0, y0, x1, y1) if set(polygon) == corners else None


def signed_area(points: Floats) -> float:
    """½ Σ (x_i y_{i+1} - x_{i+1} y_i), positive if counterclockwise."""
    x, y = (points - points[0]).T  # relative to a corner: no cancellation far from (0, 0)
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2


def edges_of(corners: Floats) -> Floats:
    """Return the edges (S, 4) of a polygon, (S, 2)."""
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def _point(corner: Floats) -> str:
    x, y = corner[:2].tolist()
    return f"({digits(x)}, {digits(y)})"


@final
@dataclass(frozen=True)
class PolygonMap(Map):
    """Polygonal walls around a free interior with solid obstacles.

    Polygons must be simple, leave free space, and lie within 10 km of (0, 0).
    """

    outer: Polygon  #: corners in order; the last is joined to the first
    obstacles: tuple[Polygon, ...] = ()  #: corners of each
    unit: str = "px"  #: of all lengths, "px" or "m"

    def __post_init__(self) -> None:
        limits = _ZERO_LENGTH * pixel(self.unit), _FARTHEST * pixel(self.unit)
        object.__setattr__(self, "outer", parse_polygon("the outer wall", self.outer, *limits))
        try:
            numbered = enumerate(self.obstacles)
        except TypeError:
            raise InputError(
                f"obstacles is {shown(self.obstacles)}, but must be a list of polygons; () for "
                "none."
            ) from None
        solid = tuple(parse_polygon(f"obstacle {i}", o, *limits) for i, o in numbered)
        object.__setattr__(self, "obstacles", solid)
        if not _has_free_space(self.walls, self.bounds, limits[0]):
            raise InputError(
                "the floor plan has no free space: its obstacles fill the outer wall; "
                "give smaller obstacles or a larger outer wall."
            )

    @cached_property
    def bounds(self) -> Box:
        """See ``Map``."""
        corners = np.array(self.outer)
        return (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())

    @cached_property
    def walls(self) -> Floats:
        """See ``Map``."""
        solid = [oriented_edges(polygon, solid=True) for polygon in self.obstacles]
        walls = np.vstack([oriented_edges(self.outer, solid=False), *solid])
        walls.setflags(write=False)
        return walls

    def cast(self, poses: Singles, bearings: Singles, out: Singles) -> None:
        """See ``Map.cast``."""
        kernel = ray_kernels.cast_fans if poses.shape[1] < FEW_POSES else ray_kernels.cast_all
        kernel(poses, bearings, self._sorted_walls, out)

    def distance(self, points: ArrayLike) -> Singles:
        """See ``Map.distance``."""
        centres = self._points("points", points)
        square = np.empty(centres.shape[1], np.float32)
        drive_kernels.square_gaps(centres, centres, self._walls32, square)
        return np.sqrt(square)

    def _open(self, centres: Singles) -> Bools:
        windings = np.empty(centres.shape[1], np.int32)
        drive_kernels.wind(centres, self._walls32, windings)
        return np.equal(windings, 1)

    def _feasible(self, starts: Singles, ends: Singles, radius: float) -> Bools:
        clear, size = np.empty(ends.shape[1], np.bool_), np.float32(radius)
        drive_kernels.feasible(starts, ends, self._walls32, size, self._clearance, clear)
        return clear

    def _collisions_along(self, poses: Singles, path: Singles, radius: float) -> Ints:
        hits, size = np.empty(poses.shape[1], np.int32), np.float32(radius)
        drive_kernels.collisions_along(poses, path, self._walls32, size, self._clearance, hits)
        return hits

    @cached_property
    def _walls32(self) -> Singles:
        return np.ascontiguousarray(self.walls, dtype=np.float32)

    @cached_property
    def _clearance(self) -> tuple[Any, ...]:
        return tuple(drive_kernels.clearance_of(self._walls32))

    @cached_property
    def _sorted_walls(self) -> tuple[Singles, ...]:
        """An ``AllWalls``: walls along an axis need less arithmetic."""
        room, inner = as_box(self.outer), [as_box(polygon) for polygon in self.obstacles]
        polygons = zip((self.outer, *self.obstacles), (room, *inner), strict=True)
        edges = [oriented_edges(polygon, solid=True) for polygon, box in polygons if box is None]
        walls = np.vstack([np.empty((0, 4)), *edges])
        boxes = np.array([box for box in inner if box is not None], np.float32)
        x0, y0, x1, y1 = walls.T
        upright, level, overlap = x0 == x1, y0 == y1, OVERLAP * pixel(self.unit)
        low_x, high_x = np.minimum(x0, x1) - overlap, np.maximum(x0, x1) + overlap
        low_y, high_y = np.minimum(y0, y1) - overlap, np.maximum(y0, y1) + overlap
        length = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2)
        start, end = np.full_like(length, -overlap), length + overlap
        oblique = [x0, y0, (x1 - x0) / length, (y1 - y0) / length, start, end]
        return tuple(
            AllWalls(
                outer=oriented_edges(self.outer, solid=False).astype(np.float32),
                room=np.array(room or (-math.inf, -math.inf, math.inf, math.inf), np.float32),
                boxes=boxes.reshape(-1, 4),
                upright=_singles([x0, low_y, high_y])[upright],
                level=_singles([y0, low_x, high_x])[level],
                oblique=_singles(oblique)[~(upright | level)],
            )
        )


def _singles(columns: list[Floats]) -> Singles:
    return np.ascontiguousarray(np.column_stack(columns), dtype=np.float32)


def read_polygons(path: str | os.PathLike[str]) -> PolygonMap:
    """Read a map."""
    with refusing(f"the map file {path}"):
        content = json_of(content_of(Path(os.path.expanduser(path))))
    try:
        for key in content:
            one_of("key", key, KEYS)
        return of_mapping(content)
    except InputError as error:
        raise InputError(f"the map {path}: {error}") from None


def of_mapping(given: Mapping[str, Any]) -> PolygonMap:
    """Return the map that a mapping describes."""
    for key in given:
        one_of("key in floor_plan", key, (*KEYS, "file", "office"))
    return PolygonMap(**{"outer": None, **given})
