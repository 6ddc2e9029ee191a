"""p(x_0): where the robot may start; regions; poses in free space, evenly spread or drawn."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeGuard

import numpy as np

from deqmcl_gym.maps import GridMap, Map
from deqmcl_gym.maps.map import LENGTH, POSE, Box
from deqmcl_gym.maps.polygons import edges_of, parse_polygon, signed_area
from deqmcl_gym.numerics import Bools, Floats, Singles, arrays
from deqmcl_gym.validation import LARGEST, InputError, array, number, pose
from localizers.api import Prior

_BLOCK = 1024
_COUNTED = 16 * _BLOCK  # points at which free space is measured
_MOST = 2**20  # poses drawn in vain
# Powers of the inverse of the root of g⁴ = g + 1: the additive recurrence of lowest known
# discrepancy in three dimensions (Roberts 2018).
_STEPS = np.array(
    [0.8191725133961644, 0.6710436067037892, 0.5497004779019702]
)  # written out, as NumPy's powers differ between processors


@dataclass(frozen=True, kw_only=True)
class PolygonRegion:
    """The inside of a simple polygon, as of a room: corners (x, y) in order, in the map's unit."""

    corners: tuple[tuple[float, float], ...] = field(metadata=LENGTH)

    def __post_init__(self) -> None:
        corners = parse_polygon("the prior's polygon", self.corners, 1e-9, LARGEST)
        object.__setattr__(self, "corners", corners)
        if not self.area > 0:
            raise InputError("the prior's polygon has no area: give corners around a room.")

    @cached_property
    def bounds(self) -> Box:
        """The rectangle (x0, y0, x1, y1) around it."""
        (x0, y0), (x1, y1) = (end(self._corners, axis=0).tolist() for end in (np.min, np.max))
        return x0, y0, x1, y1

    @cached_property
    def area(self) -> float:
        """Its area."""
        return abs(signed_area(self._corners))

    def contains(self, points: Floats) -> Bools:
        """Whether points (n, 2 or more) lie in it, (n,): a ray crosses an odd number of edges."""
        x, y = points[:, 0], points[:, 1]
        inside = np.zeros(len(points), np.bool_)
        for x0, y0, x1, y1 in edges_of(self._corners).tolist():
            spans = (y0 > y) != (y1 > y)
            inside[spans] ^= x[spans] < x0 + (y[spans] - y0) * (x1 - x0) / (y1 - y0)
        return inside

    @property
    def _corners(self) -> Floats:
        return np.array(self.corners)


@dataclass(frozen=True, kw_only=True)
class AnnulusRegion:
    """Points at a distance of ``beyond`` to ``within`` from a point: near a door, say."""

    centre: tuple[float, float] = field(metadata=LENGTH)  #: (x, y) in the map's unit
    within: float = field(metadata=LENGTH)  #: largest distance, in the map's unit
    beyond: float = field(default=0.0, metadata=LENGTH)  #: least distance; 0 is a disc

    def __post_init__(self) -> None:
        x, y = array("the prior's centre", self.centre, (2,)).tolist()
        object.__setattr__(self, "centre", (x, y))
        number("prior.beyond", self.beyond, low=0)
        number("prior.within", self.within, low=self.beyond, above=True)

    @property
    def bounds(self) -> Box:
        """The rectangle (x0, y0, x1, y1) around it."""
        (x, y), most = self.centre, self.within
        return x - most, y - most, x + most, y + most

    @property
    def area(self) -> float:
        """Its area."""
        return math.pi * (self.within**2 - self.beyond**2)

    def contains(self, points: Floats) -> Bools:
        """Whether points (n, 2 or more) lie in it, (n,)."""
        square = ((points[:, :2] - np.array(self.centre)) ** 2).sum(axis=1)
        return np.asarray((square >= self.beyond**2) & (square <= self.within**2))


Region = PolygonRegion | AnnulusRegion


def even_poses(floor_plan: Map, count: int) -> Singles:
    """Return poses spread evenly over free space and headings, always the same, (3, count)."""
    shares = map(_even_shares, itertools.count(step=_BLOCK))
    return _first(count, floor_plan, shares, 0.0)


def random_poses(
    floor_plan: Map,
    count: int,
    rng: np.random.Generator,
    radius: float = 0.0,
    region: Region | None = None,
) -> Singles:
    """Draw poses uniformly over all headings and where a disc fits in a region, (3, count)."""
    drawn = (rng.random((max(2 * count, 16), 3)) for _ in itertools.repeat(None))
    return _first(count, floor_plan, drawn, radius, region)


def _first(
    count: int,
    floor_plan: Map,
    shares: Iterator[Floats],
    radius: float,
    region: Region | None = None,
) -> Singles:
    """Return the first ``count`` free poses at shares, (3, count)."""
    free, tried = [np.empty((0, 3))], 0
    while sum(map(len, free)) < count:
        free.append(_free(floor_plan, drawn := next(shares), radius, region))
        tried += len(drawn)
        if tried > _MOST and not any(map(len, free)):
            raise InputError(
                f"of {tried:,} places on the floor plan, none is free for a radius of {radius:g}: "
                "give a map with more free space."
            )
    return np.ascontiguousarray(np.vstack(free)[:count].T, dtype=np.float32)


def _even_shares(start: int, count: int = _BLOCK) -> Floats:
    return np.asarray((0.5 + np.arange(start, start + count)[:, None] * _STEPS) % 1.0)


def _free(
    floor_plan: Map, shares: Floats, radius: float = 0.0, region: Region | None = None
) -> Floats:
    """Poses at ``shares`` of the ground and of a turn where a disc fits, (k, 3)."""
    poses = _within(floor_plan.bounds if region is None else region.bounds, shares)
    if region is not None:
        poses = poses[region.contains(poses)]
    elif _is_rare(floor_plan):
        cells, place = floor_plan.open_cells, shares[:, 0] * len(floor_plan.open_cells)
        chosen = cells[np.minimum(place.astype(np.intp), len(cells) - 1)]
        points = floor_plan.placed(chosen + np.column_stack([place % 1.0, shares[:, 1]]))
        poses[:, :2] = points.astype(np.float32)  # as they are returned
    return poses[floor_plan.free(poses, radius)]


def _within(bounds: Box, shares: Floats) -> Floats:
    x0, y0, x1, y1 = bounds
    low, high = np.array([x0, y0, -np.pi]), np.array([x1, y1, np.pi])
    return np.asarray(low + (high - low) * shares)


def _is_rare(floor_plan: Map) -> TypeGuard[GridMap]:
    """Whether so few cells of a grid are open that poses are drawn in these only."""
    return isinstance(floor_plan, GridMap) and floor_plan.open_share < 1 / 64


_SD_IN_PX = 10.0


@dataclass(frozen=True, kw_only=True)
class GaussianPrior:
    """x_0 ~ N(mean, diag(sd_position², sd_position², sd_heading²))."""

    mean: tuple[float, float, float] = field(metadata=POSE)  #: (x, y, θ rad)
    #: in x and in y, in the map's unit; None is 10 px, refused on maps in metres
    sd_position: float = field(default=None, metadata=LENGTH)  # type: ignore[assignment]
    sd_heading: float = 0.1  #: in rad

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
        offsets = np.asarray(poses, dtype=np.float64) - np.array(self.mean)
        offsets[:, 2] = arrays.wrapped(offsets[:, 2])
        with np.errstate(divide="ignore", invalid="ignore"):
            log_density: Floats = (
                -0.5 * np.square(offsets / self._sd) - arrays.log(self._sd * np.sqrt(2 * np.pi))
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
    """x_0 is anywhere in the free space of a region, with any heading: the robot must be found."""

    floor_plan: Map
    radius: float = field(default=0.0, metadata=LENGTH)  #: of a disc that must fit at x_0
    region: Region | None = None  #: ``PolygonRegion`` or ``AnnulusRegion``; None is the whole map
    mean = None  #: no single pose is representative

    def __post_init__(self) -> None:
        number("prior.radius", self.radius, low=0)
        if not self._share > 0:
            raise InputError(
                f"prior.radius is {self.radius:g}, but a disc that wide does not fit into the "
                f"{self.region or 'floor plan'}: give a smaller one, or a place with free space."
            )

    def sample(self, n: int, rng: np.random.Generator) -> Floats:
        """Draw n poses, (n, 3)."""
        drawn = random_poses(self.floor_plan, n, rng, self.radius, self.region)
        return drawn.T.astype(np.float64)

    def log_density(self, poses: Floats) -> Floats:
        """Log p(x_0) of poses (n, 3): one number in free space, -inf elsewhere, (n,).

        Exact for a region that is free all over, else to about one percent, by even points.
        """
        if self.region is not None:
            area = self.region.area
        elif _is_rare(plan := self.floor_plan):
            area = len(plan.open_cells) * plan.resolution**2
        else:
            x0, y0, x1, y1 = plan.bounds
            area = (x1 - x0) * (y1 - y0)
        density = 1 / (self._share * area * 2 * math.pi)
        free = self.floor_plan.free(poses, self.radius)
        if self.region is not None:
            free &= self.region.contains(np.asarray(poses, dtype=np.float64))
        return np.where(free, arrays.log(np.array([density]))[0], -np.inf)

    @cached_property
    def _share(self) -> float:
        """Share of the region, or else of the ground of ``_free``, where the disc fits."""
        shares = _even_shares(0, _COUNTED)
        free = len(_free(self.floor_plan, shares, self.radius, self.region))
        if self.region is None:
            return free / _COUNTED
        inside = int(self.region.contains(_within(self.region.bounds, shares)).sum())
        return free / inside if inside else 0.0


@dataclass(frozen=True, kw_only=True)
class MixturePrior:
    """p(x_0) = Σ w_k p_k(x_0): one of several places."""

    parts: tuple[Prior, ...]
    weights: tuple[float, ...] | None = None  #: above 0 with any sum; None is all equal

    def __post_init__(self) -> None:
        parts = tuple(self.parts)
        if not parts:
            raise InputError("a mixture of priors has no part: give one or more.")
        given = np.ones(len(parts))
        if self.weights is not None:
            given = array("weights of priors", self.weights, (len(parts),))
        if not (given > 0).all():
            raise InputError(f"weights of priors are {tuple(given.tolist())}, but must be above 0.")
        object.__setattr__(self, "parts", parts)
        object.__setattr__(self, "weights", tuple((given / given.sum()).tolist()))

    @property
    def mean(self) -> tuple[float, float, float] | None:
        """That of a single part; None: no single pose is representative."""
        return self.parts[0].mean if len(self.parts) == 1 else None

    def sample(self, n: int, rng: np.random.Generator) -> Floats:
        """Draw n poses, (n, 3), in random order of the parts."""
        chosen = rng.choice(len(self.parts), n, p=self.weights)
        poses = np.empty((n, 3))
        for index, part in enumerate(self.parts):
            rows = chosen == index
            poses[rows] = part.sample(int(rows.sum()), rng)
        return poses

    def log_density(self, poses: Floats) -> Floats:
        """Log p(x_0) of poses (n, 3), (n,)."""
        each = np.array([part.log_density(poses) for part in self.parts])
        each += arrays.log(np.array(self.weights))[:, None]
        top = each.max(axis=0)
        safe = np.where(np.isneginf(top), 0.0, top)
        with np.errstate(divide="ignore"):
            return np.asarray(safe + arrays.log(arrays.exp(each - safe).sum(axis=0)))

    def check_unit(self, unit: str) -> None:
        """Refuse a map in another unit than that of the parts."""
        for part in self.parts:
            if isinstance(part, GaussianPrior | MixturePrior):
                part.check_unit(unit)
