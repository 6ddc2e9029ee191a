"""p(o_t | x_t, m) as Nav2's AMCL weighs particles by it: three models, and beams that are skipped.

Facts from Nav2's nav2_amcl/src/sensors/laser and nav2_amcl/src/map. A weight is no density: hits
are not normalised, and two of the models add up cubes over beams. Lengths of attributes are in the
map's unit; densities of random readings are per metre on every map, as there.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from deqmcl_gym.maps import GridMap, Lidar, Map
from deqmcl_gym.maps.drive_kernels import to_nearest
from deqmcl_gym.maps.map import LENGTH, PER_LENGTH, metre
from deqmcl_gym.numerics import Bools, Floats, Singles, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import cos64, exp64, log64, sin64
from deqmcl_gym.validation import InputError, integer
from localizers.models.scan import Scan, in_blocks


@compiled
def table_at_ends(
    origins: Singles,
    ranges: Floats,
    bearings: Floats,
    table: Singles,
    frame: tuple[float, float, float, float, float],
    out: Singles,
) -> None:
    """Fill in a ``DistanceTable``'s value where each beam from ``origins`` ends, (B, n), or inf."""
    x0, y0, cos_yaw, sin_yaw, cell = frame
    rows, columns = table.shape
    n = origins.shape[1]
    flat = table.reshape(-1)
    cosine, sine = np.empty(n), np.empty(n)
    right, up = np.empty(n), np.empty(n)
    for i in range(n):
        heading = np.float64(origins[2, i])
        cosine[i], sine[i] = cos64(heading), sin64(heading)
    for beam in range(ranges.size):
        ahead, aside = ranges[beam] * cos64(bearings[beam]), ranges[beam] * sin64(bearings[beam])
        for i in range(n):
            u = origins[0, i] + (cosine[i] * ahead - sine[i] * aside) - x0
            v = origins[1, i] + (sine[i] * ahead + cosine[i] * aside) - y0
            right[i] = np.floor((cos_yaw * u + sin_yaw * v) / cell)
            up[i] = np.floor((cos_yaw * v - sin_yaw * u) / cell)
        for i in range(n):
            inside = (right[i] >= 0) & (right[i] < columns) & (up[i] >= 0) & (up[i] < rows)
            at = int(up[i]) * columns + int(right[i]) if inside else 0
            out[beam, i] = flat[at] if inside else np.float32(np.inf)


@compiled
def weigh(
    squares: Singles, cut: float, scale: float, hit: float, rand: float, cubes: bool, out: Floats
) -> None:
    """Fill in log(1 + Σ_b q³) or Σ_b log q, q = hit exp(scale min(d², cut)) + rand, d² (B, n)."""
    out[:] = 1.0 if cubes else 0.0
    q = np.empty(out.size)
    for beam in range(squares.shape[0]):
        for i in range(out.size):
            square = np.float64(squares[beam, i])
            q[i] = hit * exp64(scale * (square if square < cut else cut)) + rand
        for i in range(out.size if cubes else 0):
            out[i] += q[i] * q[i] * q[i]
        for i in range(0 if cubes else out.size):
            out[i] += log64(q[i]) if q[i] > 0.0 else -np.inf
    for i in range(out.size if cubes else 0):
        out[i] = log64(out[i])


@compiled
def beams_cubed(
    ranges: Floats,
    expected: Singles,
    metres: float,
    shares: tuple[float, float, float, float],
    model: tuple[float, float, float],
    out: Floats,
) -> None:
    """Fill in log(1 + Σ_b q³), q: the four parts of a beam; see ``BeamCubes``.

    Ranges are in m, expected ones in the map's unit, of ``metres``; NaN, outside, counts as 0. The
    model is max_range, σ and 1/λ in m.
    """
    z_hit, z_short, z_max, z_rand = shares
    max_range, sigma, decay = model
    scale = -0.5 / (sigma * sigma)
    out[:] = 1.0
    for beam in range(ranges.size):
        measured = ranges[beam]
        short = z_short * decay * exp64(-decay * measured)
        anyway = z_max if measured == max_range else 0.0
        anyway += z_rand / max_range if measured < max_range else 0.0
        for i in range(out.size):
            seen = metres * expected[beam, i]
            seen = min(seen, max_range) if seen > 0.0 else 0.0  # also if it is NaN
            z = measured - seen
            q = z_hit * exp64(scale * (z * z)) + anyway + (short if z < 0.0 else 0.0)
            out[i] += q * q * q
    for i in range(out.size):
        out[i] = log64(out[i])


MOST_CELLS = 20_000_000


class DistanceTable(NamedTuple):
    """Distances of square cells' centres to the nearest wall."""

    # squared, in cells, (rows, columns), lowest row first: on a map of cells exact whole numbers
    squares: Singles
    # lower left corner (x, y) of the first cell, cos and sin of the table's yaw, and a cell's edge
    frame: tuple[float, float, float, float, float]

    @classmethod
    def of(cls, floor_plan: Map, farthest: float, cell: float) -> "DistanceTable":
        """Return the table of a map, up to a distance; map_cspace.cpp, but distances are exact.

        Of a map of cells its own, from centre to centre of *occupied* ones: unknown is no wall.
        Of a map of polygons cells of edge ``cell``, as far around it as the table tells distances;
        walls are lines, seen from both sides.
        """
        if isinstance(floor_plan, GridMap):
            x, y, yaw = floor_plan.origin
            cosine, sine = float(arrays.cos([yaw])[0]), float(arrays.sin([yaw])[0])
            frame = (float(x), float(y), cosine, sine, float(floor_plan.resolution))
            squares = np.rint(np.square(to_nearest(floor_plan.occupied)))
            return cls(np.ascontiguousarray(squares, np.float32), frame)
        x0, y0, x1, y1 = floor_plan.bounds
        sides = x1 - x0 + 2 * farthest, y1 - y0 + 2 * farthest
        columns, rows = (math.ceil(side / cell - 1e-9) for side in sides)
        if columns * rows > MOST_CELLS:
            raise InputError(
                f"field_cell makes a table of {columns * rows:,} cells of {cell:g} "
                f"{floor_plan.unit}, but at most {MOST_CELLS:,} are allowed: give larger cells."
            )
        left, low = x0 - farthest, y0 - farthest
        xs, ys = left + cell * (np.arange(columns) + 0.5), low + cell * (np.arange(rows) + 0.5)
        points = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        squares = np.square(floor_plan.distance(points).reshape(rows, columns) / np.float32(cell))
        return cls(np.ascontiguousarray(squares, np.float32), (left, low, 1.0, 0.0, float(cell)))

    def at_ends(self, origins: Singles, ranges: Floats, bearings: Floats) -> Singles:
        """Squares at the cell that each beam ends in, inf off the table, (B, n)."""
        starts = np.ascontiguousarray(origins, np.float32)
        out = np.empty((ranges.size, origins.shape[1]), np.float32)
        table_at_ends(starts, ranges, bearings, self.squares, self.frame, out)
        return out


@dataclass(frozen=True, kw_only=True)
class LikelihoodField:
    """w by q = z_hit exp(-d² / 2σ²) + z_rand / max_range of each beam, d the distance of its end.

    w ∝ 1 + Σ q³ over beams: blunt, so it rarely loses a robot; likelihood_field_model.cpp. Or the
    product of q, as if beams were independent: likelihood_field_model_prob.cpp.
    """

    floor_plan: Map
    lidar: Lidar
    sigma: float
    farthest: float  # the largest d, also that of ends off the map, in the map's unit
    hit: float = 0.5
    rand: float = 0.5
    max_beams: int = 60  # at least 2
    cell: float  # edge of the table's cells on a map of polygons
    product: bool = False

    def __post_init__(self) -> None:
        integer("max_beams", self.max_beams, low=2)
        _ = self.table  # made now, not in the first update

    @cached_property
    def table(self) -> DistanceTable:
        """Distances to the nearest wall."""
        return DistanceTable.of(self.floor_plan, float(self.farthest), float(self.cell))

    @property
    def step(self) -> int:
        """Every step-th beam is looked at; the product's model alone rounds up."""
        if self.product:
            return max(1, math.ceil(self.lidar.beams / self.max_beams))
        return _every(self.lidar.beams, self.max_beams)

    def informative(self, ranges: Floats) -> Bools:
        """Which beams of a scan count, (B,): looked at, and shorter than the largest range."""
        # NaN is neither; a range below 0 is one below the sensor's least, which Nav2 takes for none
        short = (ranges >= 0.0) & (ranges < self.lidar.max_range)
        return np.asarray(short & (np.arange(ranges.size) % self.step == 0))

    def squares(self, states: Singles, ranges: Floats) -> Singles:
        """Squared distances, in cells of the table, at the ends of the beams that count, (b, n)."""
        counted = self.informative(ranges)
        looked_at, bearings = ranges[counted], self.lidar.bearings[counted]
        squares = [
            self.table.at_ends(origins, looked_at[rows], bearings[rows])
            for origins, rows in self.lidar.fans(states, counted)
        ]
        return squares[0] if len(squares) == 1 else np.concatenate(squares)

    def log_likelihood(self, states: Singles, scan: Scan) -> Floats:
        """Log w of each pose (3, n) of the robot for a scan, (n,)."""
        edge, metres = self.table.frame[-1], 1 / metre(self.floor_plan.unit)
        cut, scale = (self.farthest / edge) ** 2, -0.5 * (edge / self.sigma) ** 2
        rand = self.rand / (self.lidar.max_range * metres)

        def weighed(some: Singles) -> Floats:
            out, squares = np.zeros(some.shape[1]), self.squares(some, scan.ranges)
            weigh(squares, cut, scale, self.hit, rand, not self.product, out)
            return out

        if not self.informative(scan.ranges).any():
            return np.zeros(states.shape[1])
        return in_blocks(weighed, states)


@dataclass(frozen=True, kw_only=True)
class BeamSkipping:
    """Leave out beams that end near a wall from too few particles: people, not the map.

    A beam agrees with a particle if its end is nearer than ``distance`` to a wall. It is kept if
    more than ``threshold`` of the particles agree. If ``error_threshold`` of ``max_beams`` or more
    would be left out, the cloud itself may be wrong, and all are kept. Beams without a return are
    among those left out, as are those that a small scan lacks. Source:
    likelihood_field_model_prob.cpp.
    """

    field: LikelihoodField  # with ``product``
    distance: float
    threshold: float
    error_threshold: float

    def kept(self, states: Singles, log_weights: Floats, scan: Scan) -> Scan:
        """Return the scan without the beams that the cloud (3, n), by its numbers, leaves out."""
        field = self.field
        near = field.squares(states, scan.ranges) < (self.distance / field.table.frame[-1]) ** 2
        agreeing = near.sum(axis=1) / states.shape[1] > self.threshold
        if field.max_beams - int(agreeing.sum()) >= field.max_beams * self.error_threshold:
            return scan
        return scan.without(~agreeing, field.informative(scan.ranges))


@dataclass(frozen=True, kw_only=True)
class BeamCubes:
    """w ∝ 1 + Σ over beams of q³, q of four parts by the range z* that the map would give.

    q = z_hit exp(-(z - z*)² / 2σ²) + [z < z*] z_short λ exp(-λ z) + [z = max_range] z_max +
    [z < max_range] z_rand / max_range. Rays stop at unknown cells, and are 0 from outside. Source:
    beam_model.cpp, map_range.c; rays are exact here.
    """

    floor_plan: Map
    lidar: Lidar
    hit: float = 0.5
    short: float = 0.05
    max: float = 0.05
    rand: float = 0.5
    sigma: float = field(default=0.2, metadata=LENGTH)
    decay: float = field(default=0.1, metadata=PER_LENGTH)
    max_beams: int = 60

    def __post_init__(self) -> None:
        integer("max_beams", self.max_beams, low=2)
        _ = self._stopping

    def informative(self, ranges: Floats) -> Bools:
        """Which beams of a scan count, (B,): looked at, and numbers."""
        step = _every(self.lidar.beams, self.max_beams)
        return np.asarray(~np.isnan(ranges) & (np.arange(ranges.size) % step == 0))

    def log_likelihood(self, states: Singles, scan: Scan) -> Floats:
        """Log w of each pose (3, n) of the robot for a scan, (n,)."""
        ranges = scan.ranges
        counted = self.informative(ranges)
        max_range = self.lidar.max_range
        # below the sensor's least range is as no return, and so is infinitely far
        measured = np.where((ranges >= 0.0) & (ranges <= max_range), ranges, max_range)[counted]
        metres = 1 / metre(self.floor_plan.unit)
        shares = float(self.hit), float(self.short), float(self.max), float(self.rand)
        model = max_range * metres, self.sigma * metres, self.decay / metres

        def weighed(some: Singles) -> Floats:
            out, expected = np.zeros(n := some.shape[1]), np.empty((measured.size, n), np.float32)
            self.lidar.cast(self._stopping.cast, some, expected, counted)
            beams_cubed(measured * metres, expected, metres, shares, model, out)
            return out

        return in_blocks(weighed, states) if measured.size else np.zeros(states.shape[1])

    @cached_property
    def _stopping(self) -> Map:
        """The map, with unknown cells that stop rays."""
        if isinstance(self.floor_plan, GridMap) and self.floor_plan.unknown != "obstacle":
            return replace(self.floor_plan, unknown="obstacle")
        return self.floor_plan


def _every(beams: int, most: int) -> int:
    return max(1, (beams - 1) // (most - 1))
