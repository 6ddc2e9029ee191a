"""p(o_t | x_t, m) from a table of exact ranges: a look-up a beam instead of a ray cast.

Ranges are those of the cell's centre, in the nearest of some directions. Much faster than ray
casts, and nearly as informative where beams are noisy: for training.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.maps.map import LENGTH
from deqmcl_gym.numerics import Floats, Reals, Singles
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.validation import InputError, number
from localizers.models.scan import CensoredGaussianUniform, Scan, log_outside

Codes = NDArray[np.uint8]  # of ranges, in steps; the last is of readings at the largest range, …
_LAST = 255  # … or of cells without free ground
_DIRECTIONS = 64  # a power of 2
_MOST = 2**26  # bytes of a table; it takes some 16 times as much while it is made
# Where in a cell the rays start, in cells off its centre: the first that is on free ground.
_STARTS = (0.0, 0.0), (-0.25, -0.25), (0.25, 0.25), (-0.25, 0.25), (0.25, -0.25)


@compiled
def add_from_table(
    states: Singles,
    readings: Codes,
    bearings: Floats,
    logs: Floats,
    table: Codes,
    shape: tuple[int, int],
    frame: tuple[float, float, float],
    out: Floats,
) -> None:
    """Add the log-likelihood of beams at poses (3, n) to ``out``.

    ``logs`` has that of each reading, given each exact range. The flat table has the exact ranges
    of each cell, the lowest row first, then those of a cell outside; ``frame`` is (x0, y0, cell).
    """
    x0, y0, cell = frame
    rows, columns = shape
    n = states.shape[1]
    base, heading = np.empty(n, np.int32), np.empty(n, np.float32)
    per_turn = _DIRECTIONS / (2 * np.pi)
    for i in range(n):
        column, row = np.floor((states[0, i] - x0) / cell), np.floor((states[1, i] - y0) / cell)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        index = int(row) * columns + int(column) if inside else rows * columns
        base[i] = _DIRECTIONS * index
        heading[i] = states[2, i] * per_turn + 0.5
    for beam in range(readings.size):
        turn, likely = np.float32(bearings[beam] * per_turn), logs[readings[beam]]
        for i in range(n):
            direction = int(np.floor(heading[i] + turn)) & (_DIRECTIONS - 1)
            out[i] += likely[table[base[i] + direction]]


@dataclass(frozen=True, kw_only=True)
class RangeTable:
    """``LidarScan`` with exact ranges that are looked up. A scan source for ``RobotModel``.

    Rays start up to half a cell's diagonal off, and end, at a distance d, up to πd/64 aside.
    """

    beam: CensoredGaussianUniform
    cell: float = field(metadata=LENGTH)  #: side of the table's cells, in the map's unit

    def __post_init__(self) -> None:
        number("scan.cell", self.cell, low=0, above=True)

    def made(self, floor_plan: Map, lidar: Lidar) -> "TableOfMap":
        """Return the model of scans by this lidar on this map."""
        step = 1.25 * lidar.max_range / (_LAST - 1)  # exact ranges beyond these are alike
        x0, y0, x1, y1 = floor_plan.bounds
        columns, rows = int(np.ceil((x1 - x0) / self.cell)), int(np.ceil((y1 - y0) / self.cell))
        if (size := columns * rows * _DIRECTIONS) > _MOST:
            raise InputError(
                f"the table of this map's ranges would take {size >> 20:,} MiB, but may take "
                f'{_MOST >> 20}: use ray casts, as scan="beams" does, or a larger cell.'
            )
        cells = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
        bearings = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
        table = np.full((rows * columns + 1, _DIRECTIONS), _LAST, np.uint8)
        for start in _STARTS:
            left = np.flatnonzero(table[:-1, 0] == _LAST)
            poses = np.zeros((left.size, 3))
            poses[:, :2] = (x0, y0) + (cells[left] + 0.5 + start) * self.cell
            exact = floor_plan.ranges(poses, bearings)
            free = ~np.isnan(exact[:, 0])
            table[left[free]] = np.rint(exact[free] / step).clip(max=_LAST - 1).astype(np.uint8)
        logs, frame = _logs(self.beam, lidar.max_range, step), (x0, y0, self.cell)
        return TableOfMap(lidar, step, logs, table.ravel(), (rows, columns), frame)


@lru_cache(4)
def _logs(beam: CensoredGaussianUniform, max_range: float, step: float) -> Floats:
    """Log-likelihood of each reading given each exact range, by their codes, (256, 256)."""
    levels = step * np.arange(_LAST)
    logs = np.full((_LAST + 1, _LAST + 1), log_outside(beam, max_range))
    for code, reading in enumerate([*levels.clip(max=max_range), max_range]):
        expected = levels[:, None].astype(np.float32)
        logs[code, :_LAST] = beam.log_likelihood(np.array([reading]), expected, max_range)
    return logs


class TableOfMap(NamedTuple):
    """A ``RangeTable`` on a map; see ``add_from_table``."""

    lidar: Lidar
    step: float  # of codes, in the map's unit
    logs: Floats
    table: Codes
    shape: tuple[int, int]
    frame: tuple[float, float, float]

    def log_likelihood(self, states: Singles, scan: Scan) -> Floats:
        """Log-likelihood of a scan at each pose (3, n), (n,)."""
        out, used = np.zeros(states.shape[1]), scan.usable
        readings = self.codes(scan.ranges[used])
        for origins, rows in self.lidar.fans(states, used):
            starts = np.ascontiguousarray(origins, dtype=np.float32)
            beams = readings[rows], self.lidar.bearings[used][rows]
            add_from_table(starts, *beams, self.logs, self.table, self.shape, self.frame, out)
        return out

    def codes(self, ranges: Reals) -> Codes:
        """Return the codes of usable ranges."""
        steps = np.rint(ranges / self.step)
        return np.where(ranges < self.lidar.max_range, steps, _LAST).astype(np.uint8)
