"""Where a robot may start, as the filters assume it, by kind; and how what they assume is changed.

Each says whether a robot that starts like this ``may_be_lost``: no pose is expected of it. Lengths
are in the map's unit; the defaults are for one in px.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

import numpy as np

from benchmarks.setup import TrialEnv
from deqmcl_gym.maps.map import LENGTH, POSE, pixel, scaled
from deqmcl_gym.numerics import Pose, arrays
from deqmcl_gym.validation import InputError, number, one_of, pose
from localizers import AnnulusRegion, GaussianPrior, MixturePrior, PolygonRegion, UniformPrior
from localizers.models.nav2_motion import unknown_motion
from localizers.registry import SCAN_MODEL, ScanPlugIn

Part = TypeVar("Part")
Rng = np.random.Generator | None  # that of a displaced prior; others draw nothing


@dataclass(frozen=True, kw_only=True)
class Gaussian:
    """x_0 ~ N(mean, diag(sd_position², sd_position², sd_heading²))."""

    #: (x, y, θ rad); None is the planned start, perhaps not the true one; in a log its reference
    mean: tuple[float, float, float] | None = field(default=None, metadata=POSE)
    sd_position: float = field(default=10.0, metadata=LENGTH)  #: in x and in y
    sd_heading: float = 0.1  #: rad
    may_be_lost = False

    def __post_init__(self) -> None:
        if self.mean is not None:
            object.__setattr__(self, "mean", pose("prior.mean", self.mean))
        number("prior.sd_position", self.sd_position, low=0)
        number("prior.sd_heading", self.sd_heading, low=0)

    def of(self, room: TrialEnv, rng: Rng = None, start: Pose | None = None) -> GaussianPrior:
        mean = self.mean or start or room.expected_start
        return GaussianPrior(mean=mean, sd_position=self.sd_position, sd_heading=self.sd_heading)


@dataclass(frozen=True, kw_only=True)
class Displaced(Gaussian):
    """A Gaussian whose mean is wrong by a distance and an angle, as if a person were mistaken.

    The direction is drawn evenly among those that lead to free space; the angle is to the left or
    to the right.
    """

    distance: float = field(default=0.0, metadata=LENGTH)  #: by which the mean is off
    angle: float = 0.0  #: by which its heading is off, rad
    may_be_lost = True

    def __post_init__(self) -> None:
        super().__post_init__()
        number("prior.distance", self.distance, low=0)
        number("prior.angle", self.angle, low=0, high=3.1416)  # π, as people write it

    def of(self, room: TrialEnv, rng: Rng = None, start: Pose | None = None) -> GaussianPrior:
        if rng is None:
            raise InputError("the prior is displaced in a direction that is drawn: give rng.")
        right = super().of(room, start=start)
        x, y, heading = right.mean
        side, ways = rng.random(), 2 * math.pi * rng.random(1024)
        off = np.column_stack([arrays.cos(ways), arrays.sin(ways)])
        around = np.array([x, y]) + self.distance * off
        free = np.flatnonzero(room.floor_plan.free(around, room.radius))
        if self.distance > 0 and not free.size:
            raise InputError(
                f"prior.distance is {self.distance:g}, but nothing is free at that distance from "
                f"({x:.2f}, {y:.2f}): give a smaller one."
            )
        px, py = around[free[0]].tolist() if self.distance > 0 else (x, y)
        turned = heading + (self.angle if side < 0.5 else -self.angle)
        within = math.remainder(turned, 4 * math.pi)  # within 2π, as a pose must be
        return replace(right, mean=(px, py, within))


@dataclass(frozen=True, kw_only=True)
class Uniform:
    """x_0 is anywhere in free space, or in that of a polygon or annulus, in any heading."""

    #: corners (x, y) of a room; None is no polygon
    polygon: tuple[tuple[float, float], ...] | None = field(default=None, metadata=LENGTH)
    #: centre (x, y) of an annulus; None is no annulus
    near: tuple[float, float] | None = field(default=None, metadata=LENGTH)
    within: float | None = field(default=None, metadata=LENGTH)  #: largest distance from there
    beyond: float = field(default=0.0, metadata=LENGTH)  #: least distance
    may_be_lost = True

    def __post_init__(self) -> None:
        if self.polygon is not None and self.near is not None:
            raise InputError("the prior has both polygon and near: give one of them.")
        if (self.near is None) != (self.within is None) or (self.near is None and self.beyond):
            raise InputError(
                "the prior has only some of near and within: give both, as in near = [3.2, 1.5] "
                "and within = 2.0, and beyond only with them."
            )
        self._region()  # refuses what is none

    def of(self, room: TrialEnv, rng: Rng = None, start: Pose | None = None) -> UniformPrior:
        region = self._region()
        return UniformPrior(floor_plan=room.floor_plan, radius=room.radius, region=region)

    def _region(self) -> PolygonRegion | AnnulusRegion | None:
        if self.polygon is not None:
            return PolygonRegion(corners=self.polygon)
        if self.near is None or self.within is None:
            return None
        return AnnulusRegion(centre=self.near, within=self.within, beyond=self.beyond)


@dataclass(frozen=True, kw_only=True)
class WeightedPlace:
    """One of several places: a prior and its weight."""

    prior: "Gaussian | Uniform"
    weight: float

    def __post_init__(self) -> None:
        number("weight of a place", self.weight, low=0, above=True)


@dataclass(frozen=True, kw_only=True)
class Places:
    """x_0 is at one of several places: tables of ``weight`` (1) and the keys of another kind."""

    places: tuple[WeightedPlace, ...] = ()
    may_be_lost = True

    def __post_init__(self) -> None:
        if not isinstance(self.places, tuple | list):
            raise InputError(f"prior.places is {self.places!r}, but must be a list of tables.")
        object.__setattr__(self, "places", tuple(map(_place, self.places)))

    def of(self, room: TrialEnv, rng: Rng = None, start: Pose | None = None) -> MixturePrior:
        if not self.places:
            raise InputError("the prior has kind places, but no place: add [[prior.places]].")
        parts = tuple(place.prior.of(room, start=start) for place in self.places)
        return MixturePrior(parts=parts, weights=tuple(place.weight for place in self.places))


def _place(given: Any) -> WeightedPlace:
    """Return a place, of the table of a scenario file."""
    if isinstance(given, WeightedPlace):
        return given
    if not isinstance(given, Mapping):
        raise InputError(f"a place of the prior is {given!r}, but must be a table.")
    keys = dict(given)
    weight = keys.pop("weight", 1.0)
    if keys.get("kind") == "places":
        raise InputError("a place of the prior is of kind places: name the places side by side.")
    if keys.get("kind") in (None, "displaced"):
        one_of("kind of a place", keys.get("kind"), ("gaussian", "uniform"))
    prior = changed("prior", Gaussian(), keys, "px", PRIORS)  # lengths as they are told
    if isinstance(prior, Gaussian) and (prior.mean is None or "sd_position" not in keys):
        raise InputError("a gaussian place of the prior needs mean and sd_position: give both.")
    return WeightedPlace(prior=prior, weight=weight)


PRIORS = {"gaussian": Gaussian, "uniform": Uniform, "places": Places, "displaced": Displaced}


def changed(part: str, current: Part, keys: Any, unit: str, kinds: Mapping[str, Any]) -> Part:
    """Change values of a part by name; another ``kind`` keeps those that both kinds have.

    A kind is one of ``kinds``, or of a scan model its code; a fresh one has lengths in ``unit``.
    """
    if not isinstance(keys, Mapping):
        names = ", ".join(_names(part, current))
        raise InputError(f"{part} is {keys!r}, but must name a key: {names}.")
    changes = dict(keys)
    if part == "scan" and SCAN_MODEL.reference(changes.get("kind")):
        return ScanPlugIn(kind=changes.pop("kind")).changed(**changes)  # type: ignore[return-value]
    if isinstance(current, ScanPlugIn) and "kind" not in changes:
        return current.changed(**changes)
    if "kind" in changes:
        further = ", or your own as file.py:NAME" if part == "scan" else ""
        chosen = one_of(f"kind of {part}", changes.pop("kind"), kinds, further)
        kind = kinds[chosen]
        if type(current) is not kind:
            common = {f.name for f in fields(kind)} & vars(current).keys()
            shared = {name: getattr(current, name) for name in common}
            fresh: Any = scaled(kind(), pixel(unit))
            if part == "motion":
                fresh = unknown_motion(chosen, unit)
            current = replace(fresh, **shared)
    for key in changes:
        one_of("assumption", f"{part}.{key}", _names(part, current))
    return replace(current, **changes)  # type: ignore[type-var]


def _names(part: str, current: Any) -> list[str]:
    """Dotted names of what can be changed of a part."""
    return [f"{part}.{f.name}" for f in fields(current)] + [f"{part}.kind"]
