"""p(x_0): where the robot may start; poses in free space, evenly spread or drawn."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeGuard

import numpy as np

from deqmcl_gym.maps import GridMap, Map
from deqmcl_gym.maps.map import LENGTH, POSE
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Singles
from deqmcl_gym.validation import InputError, number, pose

_BLOCK = 1024
_COUNTED = 16 * _BLOCK  # points at which free space is measured
_RARE = 1 / 64  # share of open cells below which poses are drawn in these only
_MOST = 2**20  # poses drawn in vain
# Powers of the inverse of the root of g⁴ = g + 1: the additive recurrence of lowest known
# discrepancy in three dimensions (Roberts 2018).
_STEPS = np.array(
    [0.8191725133961644, 0.6710436067037892, 0.5497004779019702]
)  # written out, as NumPy's powers differ between processors


def even_poses(floor_plan: Map, count: int) -> Singles:
    """Return poses spread evenly over free space and headings, always the same, (3, count)."""
    starts = itertools.count(step=_BLOCK)
    return _first(count, floor_plan, (_even_shares(start, _BLOCK) for start in starts), 0.0)


def random_poses(
    floor_plan: Map, count: int, rng: np.random.Generator, radius: float = 0.0
) -> Singles:
    """Draw poses uniformly over all headings and where a disc fits, (3, count)."""
    drawn = (rng.random((max(2 * count, 16), 3)) for _ in itertools.repeat(None))
    return _first(count, floor_plan, drawn, radius)


def _first(count: int, floor_plan: Map, shares: Iterator[Floats], radius: float) -> Singles:
    """Return the first ``count`` free poses at shares, (3, count).

    Raises:
        InputError: next to none is free.
    """
    found, tried = [np.empty((0, 3))], 0
    while sum(map(len, found)) < count:
        found.append(_free(floor_plan, drawn := next(shares), radius))
        tried += len(drawn)
        if tried > _MOST and not any(map(len, found)):
            raise InputError(
                f"of {tried:,} places on the floor plan, none is free for a radius of {radius:g}: "
                "give a map with more free space."
            )
    return np.ascontiguousarray(np.vstack(found)[:count].T, dtype=np.float32)


def _even_shares(start: int, count: int) -> Floats:
    shares: Floats = (0.5 + np.arange(start, start + count)[:, None] * _STEPS) % 1.0
    return shares


def _free(floor_plan: Map, shares: Floats, radius: float = 0.0) -> Floats:
    """Those of the poses at ``shares`` of the ground and of a turn where a disc fits, (k, 3).

    The ground is the map's bounds, or the open cells of a grid that has few.
    """
    x0, y0, x1, y1 = floor_plan.bounds
    low, high = np.array([x0, y0, -np.pi]), np.array([x1, y1, np.pi])
    poses: Floats = low + (high - low) * shares
    if _is_rare(floor_plan):
        cells, place = floor_plan.open_cells, shares[:, 0] * len(floor_plan.open_cells)
        chosen = cells[np.minimum(place.astype(np.intp), len(cells) - 1)]
        points = floor_plan.placed(chosen + np.column_stack([place % 1.0, shares[:, 1]]))
        poses[:, :2] = points.astype(np.float32)  # as they are returned
    return poses[floor_plan.free(poses, radius)]


def _is_rare(floor_plan: Map) -> TypeGuard[GridMap]:
    """Whether free space is a small part of the cells of a grid."""
    return isinstance(floor_plan, GridMap) and floor_plan.open_share < _RARE


def _sides(floor_plan: Map) -> tuple[float, float]:
    """Sides of a rectangle as large as the ground of ``_free``."""
    if _is_rare(floor_plan):
        return len(floor_plan.open_cells) * floor_plan.resolution, floor_plan.resolution
    x0, y0, x1, y1 = floor_plan.bounds
    return x1 - x0, y1 - y0


_SD_IN_PX = 10.0


@dataclass(frozen=True, kw_only=True)
class GaussianPrior:
    """x_0 ~ N(mean, diag(sd_position², sd_position², sd_heading²)).

    Attributes:
        mean: (x, y, θ rad).
        sd_position: in x and in y, in the map's unit; None is 10 px, refused on maps in metres.
        sd_heading: in rad.
    """

    mean: tuple[float, float, float] = field(metadata=POSE)
    sd_position: float = field(default=None, metadata=LENGTH)  # type: ignore[assignment]
    sd_heading: float = 0.1

    def __post_init__(self) -> None:
        object.__setattr__(self, "_in_px", self.sd_position is None)
        if self.sd_position is None:
            object.__setattr__(self, "sd_position", _SD_IN_PX)
        object.__setattr__(self, "mean", pose("the prior's mean", self.mean))
        number("prior.sd_position", self.sd_position, low=0)
        number("prior.sd_heading", self.sd_heading, low=0)

    def sample(self, n: int, rng: np.random.Generator) -> Floats:
        """Draw n poses, (n, 3)."""
        return np.array(self.mean) + rng.standard_normal((n, 3)) * self._sd

    def log_density(self, poses: Floats) -> Floats:
        """Log p(x_0) of poses (n, 3), the heading difference wrapped to [-π, π], (n,)."""
        apart = np.asarray(poses, dtype=np.float64) - np.array(self.mean)
        apart[:, 2] = arrays.wrapped(apart[:, 2])
        with np.errstate(divide="ignore", invalid="ignore"):
            log_density: Floats = (
                -0.5 * np.square(apart / self._sd) - arrays.log(self._sd * np.sqrt(2 * np.pi))
            ).sum(axis=1)
        return log_density

    def check_unit(self, unit: str) -> None:
        """Refuse a map in another unit than px if ``sd_position`` was not given."""
        if unit != "px" and self.__dict__["_in_px"]:
            raise InputError(
                f"the prior has no sd_position, whose default of {_SD_IN_PX:g} is in px, but the "
                f"map is in {unit}: give sd_position in {unit}, such as 0.2."
            )

    @property
    def _sd(self) -> Floats:
        return np.array([self.sd_position, self.sd_position, self.sd_heading])


@dataclass(frozen=True, kw_only=True)
class UniformPrior:
    """x_0 is anywhere in free space, with any heading: the robot must be found.

    Attributes:
        floor_plan: the map m.
        radius: of a disc that must fit at x_0, in the map's unit.
    """

    floor_plan: Map
    radius: float = field(default=0.0, metadata=LENGTH)

    def __post_init__(self) -> None:
        number("prior.radius", self.radius, low=0)
        if self._share == 0:
            raise InputError(
                f"prior.radius is {self.radius:g}, but a disc that wide does not fit into the "
                "floor plan: give a smaller radius."
            )

    @property
    def mean(self) -> None:
        """None: no single pose is representative."""
        return None

    def sample(self, n: int, rng: np.random.Generator) -> Floats:
        """Draw n poses, (n, 3)."""
        return random_poses(self.floor_plan, n, rng, self.radius).T.astype(np.float64)

    def log_density(self, poses: Floats) -> Floats:
        """Log p(x_0) of poses (n, 3): one number in free space, -inf elsewhere, (n,).

        The area of free space is counted at even points, to about one percent.
        """
        width, height = _sides(self.floor_plan)
        density = 1 / (self._share * width * height * 2 * math.pi)
        free = self.floor_plan.free(poses, self.radius)
        return np.where(free, arrays.log(np.array([density]))[0], -np.inf)

    @cached_property
    def _share(self) -> float:
        """Share of the ground of ``_free`` where the disc fits."""
        return len(_free(self.floor_plan, _even_shares(0, _COUNTED), self.radius)) / _COUNTED
