"""FloorPlan: the map m, one geometry for physics, lidar, localizers and drawing."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.floorplan import kernels
from deqmcl_gym.floorplan.polygons import Polygon, oriented_edges, parse_polygon
from deqmcl_gym.validation import InputError

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class FloorPlan:
    """Polygonal walls around a free interior, with solid obstacles inside; px, y up.

    Estimators use four calls only: :meth:`ranges`, :meth:`collides`, :meth:`free`, :attr:`bounds`.
    All take many items at once and compute in float32 by compiled kernels; the plain NumPy form of
    each stands in ``deqmcl_gym.floorplan.reference``.

    Attributes:
        outer: corners of the outer wall, in order, closed by itself.
        obstacles: corners of each solid obstacle.

    Raises:
        InputError: a polygon with fewer than 3 corners, NaN, a zero-length edge or crossing edges;
            no free space.
    """

    outer: Polygon
    obstacles: tuple[Polygon, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "outer", parse_polygon("the outer wall", self.outer))
        try:
            given = enumerate(self.obstacles)
        except TypeError:
            raise InputError(
                f"obstacles is {self.obstacles!r}, but must be a list of polygons; () for none."
            ) from None
        solid = tuple(parse_polygon(f"obstacle {i}", o) for i, o in given)
        object.__setattr__(self, "obstacles", solid)
        x0, y0, x1, y1 = self.bounds
        grid = np.meshgrid(*(np.linspace(a, b, 130)[1:-1] for a, b in ((x0, x1), (y0, y1))))
        if not self.free(np.column_stack([axis.ravel() for axis in grid])).any():
            raise InputError(
                "the floor plan has no free space: its obstacles fill the outer wall; "
                "give smaller obstacles or a larger outer wall."
            )

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """Smallest box around the outer wall: (x_min, y_min, x_max, y_max) px."""
        corners = np.array(self.outer)
        return (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())

    @cached_property
    def walls(self) -> NDArray[np.float64]:
        """All walls as segments (x0, y0, x1, y1), free space to their left, (S, 4) px.

        For physics and drawing; estimators have no use for it.
        """
        solid = [oriented_edges(polygon, solid=True) for polygon in self.obstacles]
        return np.vstack([oriented_edges(self.outer, solid=False), *solid])

    def ranges(self, poses: ArrayLike, bearings: ArrayLike) -> Floats:
        """Exact distance along each beam to the nearest wall.

        Walls are seen as segments, also from inside an obstacle. NaN for a pose outside the outer
        wall: nothing can be measured there.

        Args:
            poses: (n, 3) px, px, rad.
            bearings: angles of the beams against the heading, (B,) rad.

        Returns:
            (n, B) px.
        """
        x, y, headings = _rows(poses, 3)
        beams = np.asarray(bearings, dtype=np.float64)
        fan = np.stack([np.sin(beams), np.cos(beams)]).astype(np.float32)
        sines, cosines = sincos(headings)
        out = np.empty((beams.size, x.size), np.float32)
        kernels.cast(x, y, sines, cosines, fan, self._walls32, out)
        inside = np.empty(x.size, np.int32)
        kernels.windings(x, y, self._outer32, inside)
        out[:, inside != 1] = np.nan
        return out.T

    def collides(self, starts: ArrayLike, ends: ArrayLike, radius: float) -> NDArray[np.bool_]:
        """Whether a disc swept from ``starts`` to ``ends`` touches a wall or ends in solid space.

        Args:
            starts, ends: centres of the disc, (n, 2) px; further columns are ignored.
            radius: of the disc, px.

        Returns:
            (n,) bool.
        """
        paths = np.stack([_rows(starts, 2), _rows(ends, 2)])
        square = np.empty(paths.shape[2], np.float32)
        kernels.sweep(paths[0], paths[1], self._walls32, square)
        touches: NDArray[np.bool_] = square <= np.float32(radius) ** 2
        return touches | ~self._interior(paths[1, 0], paths[1, 1])

    def free(self, points: ArrayLike, radius: float = 0.0) -> NDArray[np.bool_]:
        """Whether a disc at each point lies in free space, clear of the walls.

        Args:
            points: centres, (n, 2) px; further columns are ignored.
            radius: of the disc, px.

        Returns:
            (n,) bool.
        """
        centres = _rows(points, 2)
        if radius == 0.0:
            return self._interior(centres[0], centres[1])
        return ~self.collides(centres.T, centres.T, radius)

    @cached_property
    def _walls32(self) -> Floats:
        return np.ascontiguousarray(self.walls, dtype=np.float32)

    @cached_property
    def _outer32(self) -> Floats:
        return self._walls32[: len(self.outer)]

    def _interior(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Winding number exactly 1: once inside the outer wall, in no (clockwise) obstacle."""
        turns = np.empty(x.size, np.int32)
        kernels.windings(x, y, self._walls32, turns)
        interior: NDArray[np.bool_] = turns == 1
        return interior


def sincos(angles: Floats) -> tuple[Floats, Floats]:
    """Sin and cos of float32 angles (rad, |angle| < 1000), the same bits on every processor."""
    sines, cosines = np.empty_like(angles), np.empty_like(angles)
    kernels.sincos(angles, sines, cosines)
    return sines, cosines


def _rows(items: ArrayLike, columns: int) -> Floats:
    """(n, d) in any layout as contiguous float32 rows (columns, n): no copy if it is one's view."""
    return np.ascontiguousarray(np.asarray(items, dtype=np.float32)[:, :columns].T)
