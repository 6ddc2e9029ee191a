"""p(o_t | x_t, m) from a table: how likely it is that a beam ends where it does, a look-up a beam.

The likelihood field of Thrun et al. 2005, table 6.3, tempered. Faster than ray casts, and blind to
walls that a beam would have to pass: for training, not for scores.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.maps.map import LENGTH, metre
from deqmcl_gym.numerics import Floats, Singles, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, sin64
from deqmcl_gym.validation import number
from localizers.models.nav2_scan import DistanceTable
from localizers.models.scan import Scan

_HIT = 0.5  # as likely as a random reading
_CELL = 0.05  # m, of the table on a map of polygons


@compiled
def add_at_ends(
    origins: Singles,
    ranges: Floats,
    bearings: Floats,
    table: Singles,
    shape: tuple[int, int],
    frame: tuple[float, float, float, float, float],
    out: Floats,
) -> None:
    """Add the table's value where each beam from ``origins`` (3, n) ends.

    The table is flat, the lowest row first; its last value, after those of ``shape``, is of ends
    that are off it.
    """
    x0, y0, cos_yaw, sin_yaw, cell = frame
    rows, columns = shape
    n = origins.shape[1]
    # the heading, and where the beams start, in cells of the table
    ahead_u, ahead_v, start_u, start_v = np.empty((4, n), np.float32)
    for i in range(n):
        heading = np.float64(origins[2, i])
        cosine, sine = cos64(heading), sin64(heading)
        ahead_u[i] = (cos_yaw * cosine + sin_yaw * sine) / cell
        ahead_v[i] = (cos_yaw * sine - sin_yaw * cosine) / cell
        x, y = origins[0, i] - x0, origins[1, i] - y0
        start_u[i] = (cos_yaw * x + sin_yaw * y) / cell
        start_v[i] = (cos_yaw * y - sin_yaw * x) / cell
    place, found = np.empty(n, np.int32), np.empty(n, np.float32)
    for beam in range(ranges.size):
        ahead = np.float32(ranges[beam] * cos64(bearings[beam]))
        aside = np.float32(ranges[beam] * sin64(bearings[beam]))
        for i in range(n):
            column = np.floor(start_u[i] + (ahead_u[i] * ahead - ahead_v[i] * aside))
            row = np.floor(start_v[i] + (ahead_v[i] * ahead + ahead_u[i] * aside))
            inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
            place[i] = int(row) * columns + int(column) if inside else rows * columns
        for i in range(n):
            found[i] = table[place[i]]
        for i in range(n):
            out[i] += found[i]


@dataclass(frozen=True, kw_only=True)
class ScanField:
    """p(o | x, m) ∝ (Π over beams of q)^power, q = ½ exp(-d² / 2σ²) + ½ / max_range.

    d is the distance of a beam's end to the nearest wall. A scan source of ``RobotModel``.
    """

    sigma: float = field(metadata=LENGTH)  #: of a hit, in the map's unit
    power: float = 1.0  #: exponent of each beam
    farthest: float = field(default=2.0, metadata=LENGTH)  #: distance from which on all are alike

    def __post_init__(self) -> None:
        number("scan.sigma", self.sigma, low=0, above=True)
        number("scan.power", self.power, low=0, above=True)
        number("scan.farthest", self.farthest, low=0, above=True)

    def made(self, floor_plan: Map, lidar: Lidar) -> "FieldOfMap":
        """Return the model of scans by this lidar on this map."""
        unit = metre(floor_plan.unit)
        squares, frame = DistanceTable.of(floor_plan, self.farthest, _CELL * unit)
        variance = (self.sigma / frame[-1]) ** 2
        rand = (1 - _HIT) / (lidar.max_range / unit)
        capped = np.append(squares, np.inf).clip(max=(self.farthest / frame[-1]) ** 2)
        logs = self.power * arrays.log(_HIT * arrays.exp(-0.5 * capped / variance) + rand)
        return FieldOfMap(lidar, logs.astype(np.float32), squares.shape, frame)


class FieldOfMap(NamedTuple):
    """A ``ScanField`` on a map."""

    lidar: Lidar
    table: Singles  # the log-likelihood of a beam by the cell where it ends; see ``add_at_ends``
    shape: tuple[int, int]
    frame: tuple[float, float, float, float, float]  # as of ``DistanceTable``

    def log_likelihood(self, states: Singles, scan: Scan) -> Floats:
        """Log-likelihood of a scan at each pose (3, n), (n,), by the beams with a return."""
        out = np.zeros(states.shape[1])
        counted = scan.usable & (scan.ranges < self.lidar.max_range)
        ranges, bearings = scan.ranges[counted], self.lidar.bearings[counted]
        for origins, rows in self.lidar.fans(states, counted):
            starts = np.ascontiguousarray(origins, dtype=np.float32)
            of_map = self.table, self.shape, self.frame
            add_at_ends(starts, ranges[rows], bearings[rows], *of_map, out)
        return out
