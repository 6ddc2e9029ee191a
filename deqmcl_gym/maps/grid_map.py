"""GridMap: a map of square cells, as ROS' map_server publishes it."""

import math
import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.maps import grid_file, grid_kernels, ray_kernels
from deqmcl_gym.maps.grid_file import FREE, MAX_SIDE, OCCUPIED, UNKNOWN
from deqmcl_gym.maps.map import Box, Map
from deqmcl_gym.maps.ray_kernels import Reach
from deqmcl_gym.numerics import Bools, Floats, Indices, Ints, Singles, arrays
from deqmcl_gym.validation import InputError, keep_plain, number, one_of, pose

Unknown = str | float  # "obstacle", "transparent", "free", or an occupancy from 0 to 1

_SHARES = {"obstacle": 1.0, "transparent": 1.0, "free": 0.0}  # as bodies take them
_NEVER = -1.0  # an occupancy below every threshold
_RESOLVED = 16  # least number of float32 steps in a cell


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class GridMap(Map):
    """Square cells, solid or open, in metres.

    A cell is solid if its occupancy is at least ``occupied_thresh``. Walls are the faces between
    solid and open cells and the edge of the map; all answers are exact for these squares. Unknown
    cells count as ``unknown`` says: "obstacle"; "transparent", which stops robots, but not beams;
    "free"; or an occupancy from 0 to 1. All but ``ranges`` and ``cast`` ask what stops a robot. On
    a map with transparent cells, beams that reach its edge go on, too, and have the range ∞.

    A map without an open cell is refused, and one so far from (0, 0) that single precision does not
    resolve its cells.
    """

    occupancy: NDArray[np.int8]  #: 0 (free) to 100, -1 (unknown); the lowest row first
    resolution: float  #: edge of a cell, m
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: of the first cell, yaw
    unknown: Unknown = "obstacle"
    occupied_thresh: float = 0.65  #: in (0, 1]
    free_thresh: float = 0.196  #: of cells written to a file as free, below ``occupied_thresh``

    def __post_init__(self) -> None:
        object.__setattr__(self, "occupancy", _occupancy(self.occupancy))
        object.__setattr__(self, "origin", pose("origin", self.origin))
        number("resolution", self.resolution, low=0, above=True)
        grid_file.check_thresholds(self.free_thresh, self.occupied_thresh)
        if isinstance(self.unknown, str):
            one_of("value of unknown", self.unknown, _SHARES)
        else:
            names = " nor ".join(f'"{word}"' for word in _SHARES)
            number(f"unknown, if it is neither {names},", self.unknown, low=0, high=1)
        keep_plain(self)
        farthest = max(map(abs, self.bounds))
        step = float(np.spacing(np.float32(farthest)))
        if not step * _RESOLVED <= self.resolution:
            raise InputError(
                f"the map reaches {farthest:g} m from (0, 0), where single precision tells apart "
                f"{step:g} m, too coarse for cells of {self.resolution:g} m: give an origin nearer "
                "to (0, 0), and poses as far from it."
            )
        if self.solid.all():
            counts = [int((self.occupancy == kind).sum()) for kind in (OCCUPIED, UNKNOWN)]
            raise InputError(
                f"the map has no free cell: {counts[0]:,} of {self.solid.size:,} are occupied and "
                f"{counts[1]:,} unknown, with unknown = {self.unknown!r}: check negate and the "
                'thresholds, or choose unknown="free".'
            )

    def __repr__(self) -> str:
        rows, columns = self.occupancy.shape
        return f"GridMap({columns} x {rows} cells of {self.resolution:g} m, origin {self.origin})"

    @classmethod
    def load(cls, path: str | os.PathLike[str], unknown: Unknown = "obstacle") -> "GridMap":
        """Read a map as ROS' map_server does: a yaml file and the image that it names.

        A file that has not changed is read once; the same object is returned again.
        """
        return grid_file.remembered(path, unknown, lambda read: cls(unknown=unknown, **read))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a map as ROS' map_saver does: a yaml file, and a pgm of its name beside it.

        Cells are free, occupied or, between the thresholds, unknown.
        """
        grid_file.write_map(
            path, self.occupancy, resolution=self.resolution, origin=self.origin,
            thresholds=(self.free_thresh, self.occupied_thresh),
        )  # fmt: skip

    @property
    def unit(self) -> str:
        """See ``Map``."""
        return "m"

    @cached_property
    def solid(self) -> Bools:
        """Which cells robots cannot enter, (rows, columns), the lowest row first."""
        unknown = _SHARES[self.unknown] if isinstance(self.unknown, str) else self.unknown
        return self._at_least_occupied(unknown)

    @cached_property
    def open_share(self) -> float:
        """Share of the cells that are not solid."""
        return 1.0 - np.count_nonzero(self.solid) / self.solid.size

    @cached_property
    def open_cells(self) -> Indices:
        """All cells that are not solid, (column, row), (k, 2)."""
        cells = np.argwhere(~self.solid)[:, ::-1]
        cells.setflags(write=False)
        return cells

    @cached_property
    def occupied(self) -> Bools:
        """Which cells are known to be occupied, (rows, columns): unknown ones never are."""
        return self._at_least_occupied(_NEVER)

    @cached_property
    def bounds(self) -> Box:
        """See ``Map``."""
        rows, columns = self.occupancy.shape
        corners = self.placed([(0, 0), (columns, 0), (columns, rows), (0, rows)])
        return (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())

    def placed(self, cells: ArrayLike) -> Floats:
        """Return points given in cells (column, row) from the lower left corner, (n, 2), in m."""
        x0, y0, cosine, sine, _ = self._frame
        u, v = self.resolution * np.asarray(cells, dtype=np.float64).T
        return np.column_stack([x0 + cosine * u - sine * v, y0 + sine * u + cosine * v])

    def painted(self, *layers: tuple[Iterable[Floats], int]) -> "GridMap":
        """Return a map in which the cells inside convex polygons have other occupancies.

        A cell is inside if its centre is; a polygon without a centre takes the cell at its own.
        Layers are polygons, counterclockwise, (c, 2) each, and their occupancy; later ones paint
        over others.
        """
        x0, y0, cosine, sine, cell = self._frame
        cells = self.occupancy.copy()
        for polygons, occupancy in layers:
            for corners in polygons:
                x, y = (corners - (x0, y0)).T
                us, vs = (cosine * x + sine * y) / cell, (cosine * y - sine * x) / cell
                _paint(cells, us, vs, occupancy)
        return replace(self, occupancy=cells)

    @cached_property
    def walls(self) -> Floats:
        """See ``Map``."""
        faces = _faces_of(self.solid)
        walls = np.hstack([self.placed(faces[:, :2]), self.placed(faces[:, 2:])])
        walls.setflags(write=False)
        return walls

    def cast(self, poses: Singles, bearings: Singles, out: Singles) -> None:
        """See ``Map.cast``."""
        reach, endless = self.sight
        grid_kernels.cast_cells(poses, bearings, reach, self._frame, self.origin[2], endless, out)

    def distance(self, points: ArrayLike) -> Singles:
        """See ``Map.distance``."""
        centres = self._points("points", points)
        out = np.empty(centres.shape[1], np.float32)
        grid_kernels.distances(centres, self._reach, *self._runs, self._frame, out)
        return out

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the map's content."""
        header = repr((self.occupancy.shape, self.resolution, self.origin, self.unknown))
        thresholds = repr((self.free_thresh, self.occupied_thresh))
        return sha256((header + thresholds).encode() + self.occupancy.tobytes()).hexdigest()

    @cached_property
    def cells(self) -> tuple[Any, ...]:
        """The reach of each cell, ``fill_runs`` up and down, and the frame: to drive in kernels."""
        return (self._reach, *self._runs, self._frame)

    def _rows(self, points: NDArray[Any]) -> NDArray[Any]:
        # float32 or float64: far from 0 both matter
        dtype = points.dtype if points.dtype in (np.float32, np.float64) else np.float64
        return points.astype(dtype, order="F", copy=False).T

    def _open(self, centres: NDArray[Any]) -> Bools:
        us, vs = np.empty((2, centres.shape[1]))
        reached = np.empty(us.size, np.int16)
        grid_kernels.find(centres, self._reach, self._frame, us, vs, reached)
        return reached > 0

    def _collisions_along(self, poses: Singles, path: Singles, radius: float) -> Ints:
        hits, size = np.empty(poses.shape[1], np.int32), float(radius)
        grid_kernels.collisions_along_in_cells(poses, path, self._reach, self._frame, size, hits)
        return hits

    def _feasible(self, starts: NDArray[Any], ends: NDArray[Any], radius: float) -> Bools:
        clear = np.empty(ends.shape[1], np.bool_)
        grid_kernels.feasible_in_cells(starts, ends, self._reach, self._frame, float(radius), clear)
        return clear

    @cached_property
    def _frame(self) -> tuple[float, ...]:
        x, y, yaw = self.origin
        cosine, sine = float(arrays.cos([yaw])[0]), float(arrays.sin([yaw])[0])
        return x, y, cosine, sine, float(self.resolution)

    @cached_property
    def _reach(self) -> Reach:
        return _reach_among(self.solid)

    @cached_property
    def sight(self) -> tuple[Reach, bool]:
        """The reach of each cell for beams, and whether they go on beyond the map's edge."""
        if self.unknown != "transparent":
            return self._reach, False
        return _reach_among(self.occupied), True

    def _at_least_occupied(self, unknown: float) -> Bools:
        """Which cells have an occupancy of ``occupied_thresh``, if that of unknown ones is this."""
        least = int(np.argmax(np.arange(OCCUPIED + 1) / OCCUPIED >= self.occupied_thresh))
        occupied = self.occupancy >= least
        if unknown >= self.occupied_thresh:
            occupied |= self.occupancy == UNKNOWN
        occupied.setflags(write=False)
        return occupied

    @cached_property
    def _runs(self) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
        up, down = np.zeros((2, *self._reach.shape), np.int16)
        grid_kernels.fill_runs(self._reach, up, down)
        return up, down


def _paint(cells: NDArray[np.int8], us: Floats, vs: Floats, value: int) -> None:
    """Paint the cells inside a convex polygon, (c,) each, in cells from the lower left corner."""
    u0, v0 = (max(0, math.floor(axis.min())) for axis in (us, vs))
    u1, v1 = (max(0, math.floor(axis.max() + 1)) for axis in (us, vs))
    part = cells[v0:v1, u0:u1]
    if not part.size:
        return
    rows, columns = part.shape
    off_u = np.arange(columns) + (u0 + 0.5) - us[:, None, None]
    off_v = (np.arange(rows) + (v0 + 0.5) - vs[:, None])[:, :, None]
    along_u, along_v = ((np.roll(axis, -1) - axis)[:, None, None] for axis in (us, vs))
    inside = (along_u * off_v >= along_v * off_u).all(axis=0)
    if not inside.any():
        row, column = (int(axis.mean()) - low for axis, low in ((vs, v0), (us, u0)))
        inside[min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)] = True
    part[inside] = value


def _reach_among(solid: Bools) -> Reach:
    reach = np.empty(np.add(solid.shape, 2), np.uint8)
    ray_kernels.fill_reach(np.pad(solid, 1, constant_values=True), reach)
    return reach


def _occupancy(given: Any) -> NDArray[np.int8]:
    try:
        cells = np.asarray(given)
    except ValueError:  # ragged
        cells = np.empty(0, object)
    if cells.ndim != 2 or cells.dtype.kind not in "iu":
        kind = f"of shape {cells.shape} and type {cells.dtype}"
        raise InputError(f"occupancy is {kind}, but must be rows of whole numbers from -1 to 100.")
    if not 2 <= min(cells.shape) <= max(cells.shape) <= MAX_SIDE:
        rows, columns = cells.shape
        raise InputError(
            f"the map has {columns:,} x {rows:,} cells, but must have from 2 to {MAX_SIDE:,} to a "
            "side."
        )
    low, high = int(cells.min()), int(cells.max())
    if low < UNKNOWN or high > OCCUPIED:
        raise InputError(
            f"occupancy has values from {low} to {high}, but must be {FREE} (free) to {OCCUPIED} "
            f"(occupied) or {UNKNOWN} (unknown)."
        )
    occupancy = np.array(cells, dtype=np.int8, order="C")
    occupancy.setflags(write=False)
    return occupancy


def _faces_of(solid: Bools) -> Floats:
    """Return the faces between open and solid cells, joined where they are in a line, (S, 4).

    The edge of the map is solid. (x₀, y₀, x₁, y₁) are in cells from the lower left corner, the open
    side to the left.
    """
    open_ = np.pad(~solid, 1).astype(np.int8)
    level, upright = np.diff(open_, axis=0)[:, 1:-1], -np.diff(open_, axis=1)[1:-1].T
    row, x0, x1 = runs_of(level)  # to the right where open cells are above, else to the left
    column, y0, y1 = runs_of(upright)  # up where open cells are to the left, else down
    faces = np.vstack(
        [np.column_stack([x0, row, x1, row]), np.column_stack([column, y0, column, y1])]
    )
    return faces.astype(np.float64)


def runs_of(lines: Any) -> tuple[Indices, Indices, Indices]:
    """Return line, start and end of all runs of +1, and of those of -1, from their ends, (n,)."""
    padded = np.pad(lines, ((0, 0), (1, 1)))
    line, place = np.nonzero(np.diff(padded, axis=1))
    before, after = padded[line, place], padded[line, place + 1]
    starts, ends, forth = after != 0, before != 0, after[after != 0] > 0
    first, last = place[starts], place[ends]
    return line[starts], np.where(forth, first, last), np.where(forth, last, first)
