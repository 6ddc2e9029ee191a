"""Scenario: a world, what the filters assume of it, and who drives; so also what is scored.

Where a robot may start is of a kind, which says whether such a robot ``may_be_lost``: no pose is
expected of it. Lengths are in the map's unit; the defaults are for one in px.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any, Self, TypeVar

import numpy as np

from benchmarks.setup import TrialEnv
from benchmarks.setup.overrides import NOTHING, Named, Overrides, located
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps.map import LENGTH, POSE, pixel, scaled
from deqmcl_gym.numerics import Pose, arrays
from deqmcl_gym.validation import InputError, integer, number, one_of, pose
from deqmcl_gym.world.config import World, offices_of
from localizers import (
    AnnulusRegion,
    GaussianPrior,
    GaussianUniform,
    MixturePrior,
    OdometryMotion,
    PolygonRegion,
    Prior,
    RobotModel,
    UniformPrior,
)
from localizers.models.nav2_motion import MOTION_MODELS, MotionModel, unknown_motion
from localizers.models.scan import BEAM_MODELS, BeamDensity
from localizers.registry import SCAN_MODEL, ScanPlugIn

Part = TypeVar("Part")
Rng = np.random.Generator | None  # that of a displaced prior; others draw nothing
_DIRECTIONS = 1024  # that are drawn to find a free one


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
        """Return p(x_0) in the episode that a room has begun last, or in one with this start."""
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
        """Return p(x_0) in the episode that a room has begun last, or in one with this start."""
        if rng is None:
            raise InputError("the prior is displaced in a direction that is drawn: give rng.")
        right = super().of(room, start=start)
        x, y, heading = right.mean
        side, ways = rng.random(), 2 * math.pi * rng.random(_DIRECTIONS)
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

    def of(self, room: TrialEnv, rng: Rng = None, start: Pose | None = None) -> Prior:
        """Return p(x_0) in a room."""
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

    def of(self, room: TrialEnv, rng: Rng = None, start: Pose | None = None) -> Prior:
        """Return p(x_0) in the episode that a room has begun last, or in one with this start."""
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


PRIORS = MappingProxyType(
    {"gaussian": Gaussian, "uniform": Uniform, "places": Places, "displaced": Displaced}
)


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
        return current.changed(**changes)  # type: ignore[return-value]
    if "kind" in changes:
        further = ", or your own as file.py:NAME" if part == "scan" else ""
        given = one_of(f"kind of {part}", changes.pop("kind"), kinds, further)
        kind = kinds[given]
        if type(current) is not kind:
            known = {each.name for each in fields(kind)}
            shared = {name: value for name, value in vars(current).items() if name in known}
            fresh: Any = scaled(kind(), pixel(unit))
            if part == "motion":
                fresh = unknown_motion(given, unit)
            current = replace(fresh, **shared)
    for key in changes:
        one_of("assumption", f"{part}.{key}", _names(part, current))
    return replace(current, **changes)  # type: ignore[type-var]


def _names(part: str, current: Any) -> list[str]:
    """Dotted names of what can be changed of a part."""
    return [f"{part}.{name}" for name in (*(own.name for own in fields(current)), "kind")]


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """What is above these counts as far off, or lost; in the map's unit, by default in px."""

    far: float = field(default=50.0, metadata=LENGTH)  #: position error of an estimate far off
    lost: float = field(default=50.0, metadata=LENGTH)  #: mean position error of a lost trial
    lost_steps: int = 20  #: last ones, over which that mean is taken

    def __post_init__(self) -> None:
        number("thresholds.far", self.far, low=0, above=True)
        number("thresholds.lost", self.lost, low=0, above=True)
        integer("thresholds.lost_steps", self.lost_steps, low=1)


_KINDS: Mapping[str, Mapping[str, Any]] = {
    "motion": MOTION_MODELS, "scan": BEAM_MODELS, "prior": PRIORS
}  # fmt: skip
_PARTS = tuple(own.name for own in fields(World))
_LENGTHS = ("motion", "scan", "prior", "thresholds")  # what has lengths in the map's unit
OPEN_LOOP = Named("open-loop")
AS_WORLD = "world"  # what is assumed is what the world is


@dataclass(frozen=True, kw_only=True)
class Scenario(ABC):
    """What the filters assume of a world, and who drives in it."""

    words: str
    motion: MotionModel = field(default_factory=OdometryMotion)  #: p(x_t | x_{t-1}, a_t)
    #: p(o | ô) of a beam, or p(o | x, m) of somebody else
    scan: BeamDensity | ScanPlugIn = field(default_factory=GaussianUniform)
    prior: Gaussian | Uniform | Places = field(default_factory=Gaussian)  #: p(x_0)
    agent: Named = OPEN_LOOP
    #: wrappers around the world, innermost first, ``{"kind": "kidnap", …}``
    disturbance: tuple[Mapping[str, Any], ...] = ()
    #: trial k is in the office of seed k modulo this, if the floor plan is one without own seeds
    buildings: int = 1
    thresholds: Thresholds = field(default_factory=Thresholds)
    source: str = ""  #: digest of the files that it was read from; "" if built-in

    def __post_init__(self) -> None:
        integer("buildings", self.buildings, low=1)
        if isinstance(self.agent, str):
            object.__setattr__(self, "agent", Named(self.agent))

    @property
    @abstractmethod
    def unit(self) -> str:
        """Of all lengths."""

    @property
    @abstractmethod
    def known(self) -> Mapping[str, Any]:
        """What filters may assume as it is in the world, by dotted name."""

    @abstractmethod
    def room(self) -> TrialEnv:
        """Return the env, set up to run all planned steps."""

    @abstractmethod
    def in_world(self, values: Overrides) -> Self:
        """Return this scenario with its world changed, by dotted name."""

    @property
    def scores(self) -> frozenset[str]:
        """Groups of scores of a whole run that it is about, by the parts that it is made of.

        A robot that may be anywhere may be lost; one that is carried off is to be found again.
        """
        carried = any(wrapper["kind"] == "kidnap" for wrapper in self.disturbance)
        return frozenset(["lost"] * self.prior.may_be_lost + ["recovery"] * carried)

    @property
    def judged(self) -> int | None:
        """Of a whole log, the first record by which beliefs are judged; None of other worlds."""
        return None

    def in_building(self, trial: int) -> Self:
        """Return this scenario in the building of a trial's number."""
        return self

    def robot_model(self, room: TrialEnv) -> RobotModel:
        """Return what localizers and agents are made for: the room's map and lidar, this noise."""
        return RobotModel(
            floor_plan=room.floor_plan,
            lidar=room.lidar,
            radius=room.radius,
            motion=self.motion,
            scan=self.scan,
        )

    def prior_in(self, room: TrialEnv, rng: Rng = None, start: Pose | None = None) -> Prior:
        """Return p(x_0) in the episode that a room has begun last, or in one with this start."""
        return self.prior.of(room, rng, start)

    def changed(
        self, world: Mapping[str, Any] = NOTHING, assumed: Mapping[str, Any] = NOTHING
    ) -> Self:
        """Return this scenario with some values changed, by dotted name.

        ``world`` are parts of the ``World``: ``{"lidar.beams": 9, "driver": "none"}``, or arguments
        of the ``LogEnv``; ``assumed``: ``{"scan.kind": "beam-model", "prior.sd_position": 5.0}``,
        or "world" for what the new world is: ``{"motion": "world", "scan.sigma": "world"}``. If the
        unit of the new world is another one, lengths of this scenario are converted.
        """
        moved = self
        if values := located(Overrides(world)):
            moved = self.in_world(values)
            if (factor := pixel(moved.unit) / pixel(self.unit)) != 1.0:
                own = {name: scaled(getattr(self, name), factor) for name in _LENGTHS}
                moved = replace(moved, **own)
        groups = moved._told(Overrides.told("assumed", assumed)).by_part(_KINDS, "assumption")
        parts = {
            part: changed(part, getattr(moved, part), keys, moved.unit, _KINDS[part])
            for part, keys in groups.items()
        }
        return replace(moved, **parts)

    def _told(self, assumed: Overrides) -> Overrides:
        """Return what is assumed with the world's values in place of the word "world"."""
        told: dict[str, Any] = {}
        for name, value in assumed.items():
            known = self.known if value == AS_WORLD else {name: value}
            of_it = {n: v for n, v in known.items() if f"{n}.".startswith(f"{name}.")}
            if not of_it:
                one_of('assumption that can be "world"', name, known)
            told |= of_it
        return Overrides(told)


@dataclass(frozen=True, kw_only=True)
class RoomScenario(Scenario):
    """Episodes in a room or building."""

    world: World  # all parts of it; with ``office``, in the building of trial 0
    # floor plan {"office": {…}} of which each trial has its own building; None: that of the world
    office: Mapping[str, Any] | None = None
    horizon: int | None = None  # number of planned actions shown; None: all

    @property
    def unit(self) -> str:
        """Of all lengths."""
        return self.world.floor_plan.unit

    @property
    def scores(self) -> frozenset[str]:
        """Those of any scenario; on a wrong map, too, a robot that is driven may be lost.

        Any other that knows where it starts is to arrive where its route ends, also on such a map.
        """
        about = super().scores
        if self.world.differs_from_map and self.agent == OPEN_LOOP:
            about |= {"lost"}
        if self.world.route is not None and "lost" not in about:
            about |= {"driving"}
        return about

    def room(self) -> TrialEnv:
        """Return the env, set up to run all planned steps."""
        return RoomEnv(world=self.world, horizon=self.horizon, ends_at_goal=False)

    def in_building(self, trial: int) -> Self:
        """Return this scenario in the building of a trial's number."""
        if self.office is None:
            return self
        floor_plan = _seeded(self.office, trial, self.buildings)
        return replace(self, world=self.world.changed(floor_plan=floor_plan))

    def in_world(self, values: Overrides) -> Self:
        """Return this scenario with parts of its world, or the horizon, changed by dotted name."""
        parts = values.by_part((*_PARTS, "horizon"), "part of the world")
        horizon, office = parts.pop("horizon", self.horizon), self.office
        if "floor_plan" in parts:
            given = parts["floor_plan"]
            parts["floor_plan"] = _seeded(given, 0, self.buildings)
            office = given if parts["floor_plan"] is not given else None
        world = self.world.changed(**parts)
        return replace(self, world=world, office=office, horizon=horizon)

    @property
    def known(self) -> Mapping[str, Any]:
        """What filters may assume as it is in the world, by dotted name."""
        noise, start = self.world.noise, self.world.start
        return {
            "motion.kind": "odometry",
            **{f"motion.{name}": value for name, value in vars(noise).items()},
            "scan.sigma": self.world.lidar.sigma,
            "prior.sd_position": start.sd_position,
            "prior.sd_heading": start.sd_heading,
        }


def _seeded(floor_plan: Any, trial: int, buildings: int) -> Any:
    """Return a floor plan with the seed that an office has in a trial; others as they are."""
    if not isinstance(floor_plan, Mapping) or not isinstance(floor_plan.get("office"), Mapping):
        return floor_plan
    if (offices := offices_of(floor_plan)) is not None:
        first, end = offices.seeds
        options = {key: v for key, v in floor_plan["office"].items() if key != "seeds"}
        return {**floor_plan, "office": {**options, "seed": first + trial % (end - first)}}
    if "seed" in floor_plan["office"]:
        return floor_plan
    return {**floor_plan, "office": {**floor_plan["office"], "seed": trial % buildings}}
