"""p(o_t | x_t, m) from the distance of each beam's end to the nearest wall, without ray casts."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Bools, Floats, Singles
from deqmcl_gym.validation import InputError, number
from localizers.models import field_kernels, scan_kernels
from localizers.models.scan import outside

_MAX_CELLS = 20_000_000
_AHEAD = np.zeros(1, np.float32)


@dataclass(frozen=True, kw_only=True)
class LikelihoodField:
    """Σ over beams of log(h N(d; 0, σ²) + (1 - h) / max_range); Thrun et al. 2005, table 6.3.

    d is the distance from a beam's end to the nearest wall, read from a table of the floor plan.
    Walls are lines seen from both sides: a beam that ends inside an obstacle is as far from it as
    its end is from the obstacle's outline. A beam at max_range says nothing. For a pose outside the
    outer wall see ``outside``.

    Attributes:
        sigma: σ > 0, in the map's unit.
        hit: h, share of the beams that end at a wall.
        farthest: d is cut to this, in the map's unit.
        cell: edge of the table's cells, in the map's unit; d is accurate to one cell.
        power: exponent of the likelihood, in (0, 1], for beams that depend on each other.
    """

    floor_plan: Map
    lidar: Lidar
    sigma: float
    cell: float
    hit: float = 0.5
    farthest: float = math.inf
    power: float = 1.0

    def __post_init__(self) -> None:
        number("sigma_hit", self.sigma, low=0, above=True)
        number("hit", self.hit, low=0, high=1)
        number("laser_likelihood_max_dist", self.farthest, low=0, above=True, finite=False)
        number("scan.power", self.power, low=0, high=1, above=True)
        number("field_cell", self.cell, low=0, above=True)
        rows, columns = self._shape
        if rows * columns > _MAX_CELLS:
            raise InputError(
                f"field_cell is {self.cell:g} {self.floor_plan.unit}, which makes a table of "
                f"{rows * columns:,} cells, but at most {_MAX_CELLS:,} are allowed: "
                "give larger cells."
            )

    def informative(self, ranges: Floats) -> Bools:
        """Which beams of a scan count, (B,)."""
        informative: Bools = (ranges >= 0.0) & (ranges < self.lidar.max_range)  # false for NaN
        return informative

    def log_likelihood(self, states: Singles, ranges: Floats) -> Floats:
        """Log-likelihood of the scan (B,) at each pose (3, n), (n,)."""
        usable = self.informative(ranges)
        out = np.zeros(states.shape[1])
        if not usable.any():
            return out
        poses = np.ascontiguousarray(states, dtype=np.float32)
        xs, ys = self._axes
        peak, floor = self._shares
        field_kernels.field_log_likelihood(
            poses,
            ranges[usable],
            self._bearings[usable],
            self.distances,
            (float(xs[0]), float(ys[0]), float(self.cell)),
            (float(self.sigma), peak, floor, float(self.farthest)),
            out,
        )
        out *= self.power
        ahead = np.empty((1, out.size), np.float32)  # any beam tells whether a pose is outside
        self.floor_plan.caster.cast(poses, _AHEAD, ahead)
        scan_kernels.fill_where_nan(ahead[0], int(usable.sum()) * self._outside, out)
        return out

    @cached_property
    def distances(self) -> Singles:
        """Distance of each cell's centre to the nearest wall, (Y, X)."""
        xs, ys = self._axes
        points = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        return self.floor_plan.distance(points).reshape(self._shape)

    @cached_property
    def _shares(self) -> tuple[float, float]:
        """Density of a beam that ends at a wall, and of one that ends anywhere."""
        peak = self.hit / (self.sigma * math.sqrt(2 * math.pi))
        return peak, (1 - self.hit) / self.lidar.max_range

    @cached_property
    def _outside(self) -> float:
        peak, floor = self._shares
        z = self.farthest / self.sigma
        return outside(peak * float(arrays.exp(-0.5 * z * z)) + floor)

    @cached_property
    def _bearings(self) -> Floats:
        return self.lidar.bearings

    @cached_property
    def _shape(self) -> tuple[int, int]:
        x0, y0, x1, y1 = self.floor_plan.bounds
        return math.ceil((y1 - y0) / self.cell) + 1, math.ceil((x1 - x0) / self.cell) + 1

    @cached_property
    def _axes(self) -> tuple[Floats, Floats]:
        """Centres of the cells along x and y; the first ones on the bounds."""
        x0, y0, _, _ = self.floor_plan.bounds
        rows, columns = self._shape
        return x0 + self.cell * np.arange(float(columns)), y0 + self.cell * np.arange(float(rows))
