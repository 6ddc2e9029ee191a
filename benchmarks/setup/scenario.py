"""Scenario: a world, what the filters assume of it, who drives, and when an estimate is far off.

The interfaces of worlds and agents stand here, too.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, Protocol, Self, TypeVar

import gymnasium as gym
import numpy as np

from benchmarks.setup.changes import NOTHING, Changes, Named
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.maps.map import LENGTH, POSE, pixel, scaled
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Reals
from deqmcl_gym.validation import InputError, integer, number, one_of, pose
from deqmcl_gym.world.config import WORLDS, World, offices_of
from localizers import (
    AnnulusRegion,
    Belief,
    GaussianPrior,
    GaussianUniform,
    MixturePrior,
    OdometryMotion,
    PolygonRegion,
    Prior,
    RobotModel,
    UniformPrior,
)
from localizers.models.beams import BEAM_MODELS, BeamDensity
from localizers.models.nav2_motion import MOTION_MODELS, MotionModel, unknown_motion
from localizers.naming.plugins import is_file, is_reference
from localizers.naming.scans import ScanPlugIn


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """What the scores count as far off, and as lost.

    Attributes:
        far: position error above which an estimate is far off, px.
        lost: mean position error of the last steps above which a trial is lost, px.
        lost_steps: how many steps these are.
    """

    far: float = field(default=50.0, metadata=LENGTH)
    lost: float = field(default=50.0, metadata=LENGTH)
    lost_steps: int = 20

    def __post_init__(self) -> None:
        number("thresholds.far", self.far, low=0, above=True)
        number("thresholds.lost", self.lost, low=0, above=True)
        integer("thresholds.lost_steps", self.lost_steps, low=1)


Pose = tuple[float, float, float]
_DIRECTIONS = 1024  # that are drawn to find a free one


class TrialEnv(Protocol):
    """An env that localizers can be tried in.

    Its ``info`` has ``action``, ``planned_actions``, ``planned_count``, ``collided`` and, at every
    step, ``truth``: see ``deqmcl_gym.envs.room``.
    """

    @property
    def floor_plan(self) -> Map:
        """The map m."""

    @property
    def lidar(self) -> Lidar:
        """The sensor."""

    @property
    def radius(self) -> float:
        """Of the robot's disc."""

    @property
    def expected_start(self) -> Pose:
        """Where the episode begun last was to begin (x, y, θ): what a local prior is around."""

    @property
    def unwrapped(self) -> gym.Env[Any, Any]:
        """The env itself, for ``reset`` and ``step``."""


class Agent(Protocol):
    """Chooses actions.

    Made anew for every episode, by ``AGENT(robot, **params)`` with a ``RobotModel``. The ``info``
    that it gets has, beside what the env shows, the latest scan under ``ranges``.

    Two attributes are optional. ``sees_truth`` = True: ``info`` has the true pose under ``truth``,
    for authors of plans who see the robot. ``plan_author`` = "own": its plans are made from the
    belief, so they are no evidence; localizers with ``own_plans`` = False are not shown them.
    """

    def plan_at_reset(self, info: dict[str, Any]) -> Reals | None:
        """Return the plan that the localizer is reset with, (h, 2); None: the one the env shows.

        Args:
            info: of the env at reset, without the truth.
        """

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        """Return the next action, and the plan after it.

        Args:
            belief: what the localizer believes now.
            info: the env's latest, without the truth.

        Returns:
            The action to be carried out next, (distance px, turn rad), and the plan after it,
            (h, 2), which the localizer gets with the next scan; None: that which the env then
            shows.
        """


@dataclass(frozen=True, kw_only=True)
class Gaussian:
    """x_0 ~ N(mean, diag(sd_position², sd_position², sd_heading²)).

    Attributes:
        mean: (x px, y px, θ rad); None is the planned start, which need not be the true one, and
            in a log its reference.
        sd_position: in x and in y, px.
        sd_heading: rad.
    """

    mean: tuple[float, float, float] | None = field(default=None, metadata=POSE)
    sd_position: float = field(default=10.0, metadata=LENGTH)
    sd_heading: float = 0.1

    def __post_init__(self) -> None:
        if self.mean is not None:
            object.__setattr__(self, "mean", pose("prior.mean", self.mean))
        number("prior.sd_position", self.sd_position, low=0)
        number("prior.sd_heading", self.sd_heading, low=0)

    @property
    def where(self) -> str:
        """Where it is, in words."""
        if self.mean is None:
            return "around the planned start"
        return "around ({:g}, {:g}, {:.2f} rad)".format(*self.mean)

    def of(self, room: TrialEnv, rng: np.random.Generator | None = None) -> GaussianPrior:
        """Return p(x_0) in the episode that a room has begun last; nothing is drawn."""
        mean = room.expected_start if self.mean is None else self.mean
        return GaussianPrior(mean=mean, sd_position=self.sd_position, sd_heading=self.sd_heading)


@dataclass(frozen=True, kw_only=True)
class Displaced:
    """A Gaussian whose mean is wrong by a distance and an angle, as if a person were mistaken.

    The direction is drawn, evenly among those that lead to free space, as nobody says that a robot
    stands in a wall; the angle is to the left or to the right.

    Attributes:
        mean, sd_position, sd_heading: as of ``Gaussian``, before the mean is displaced.
        distance: by which the mean is off, px.
        angle: by which its heading is off, rad.
    """

    mean: tuple[float, float, float] | None = field(default=None, metadata=POSE)
    sd_position: float = field(default=10.0, metadata=LENGTH)
    sd_heading: float = 0.1
    distance: float = field(default=0.0, metadata=LENGTH)
    angle: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "mean", self._right.mean)
        number("prior.distance", self.distance, low=0)
        number("prior.angle", self.angle, low=0, high=math.pi)

    def of(self, room: TrialEnv, rng: np.random.Generator | None = None) -> GaussianPrior:
        """Return p(x_0) in the episode that a room has begun last.

        Args:
            room: has the free space.
            rng: draws the direction, the same for all distances that are free there.

        Raises:
            InputError: nothing is free at that distance, or there is nothing to draw with.
        """
        if rng is None:
            raise InputError("the prior is displaced in a direction that is drawn: give rng.")
        right = self._right.of(room)
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
        return replace(right, mean=(px, py, turned))

    @property
    def where(self) -> str:
        """Where it is, in words."""
        off = f"wrong by {self.distance:g} and {math.degrees(self.angle):.0f}°"
        return f"{self._right.where}, {off}"

    @property
    def _right(self) -> Gaussian:
        return Gaussian(mean=self.mean, sd_position=self.sd_position, sd_heading=self.sd_heading)


@dataclass(frozen=True, kw_only=True)
class Uniform:
    """x_0 is anywhere in free space, or in that of a polygon or annulus, in any heading.

    Attributes:
        polygon: corners (x, y) of a room, px; None: no polygon.
        near: centre (x, y) of an annulus, px; None: no annulus.
        within, beyond: distances from there, px.
    """

    polygon: tuple[tuple[float, float], ...] | None = field(default=None, metadata=LENGTH)
    near: tuple[float, float] | None = field(default=None, metadata=LENGTH)
    within: float | None = field(default=None, metadata=LENGTH)
    beyond: float = field(default=0.0, metadata=LENGTH)

    def __post_init__(self) -> None:
        if self.polygon is not None and self.near is not None:
            raise InputError("the prior has both polygon and near: give one of them.")
        if (self.near is None) != (self.within is None) or (self.near is None and self.beyond):
            raise InputError(
                "the prior has only some of near and within: give both, as in near = [3.2, 1.5] "
                "and within = 2.0, and beyond only with them."
            )
        self._region()  # refuses what is none

    def of(self, room: TrialEnv, rng: np.random.Generator | None = None) -> Prior:
        """Return p(x_0) in a room; nothing is drawn."""
        region = self._region()
        return UniformPrior(floor_plan=room.floor_plan, radius=room.radius, region=region)

    @property
    def where(self) -> str:
        """Where it is, in words."""
        if self.polygon is not None:
            return f"anywhere in the polygon of {len(self.polygon)} corners, in any heading"
        if self.near is None:
            return "anywhere on the map"
        x, y = self.near
        at_least = f"{self.beyond:g} to " if self.beyond else "up to "
        return f"{at_least}{self.within:g} from ({x:g}, {y:g}), in any heading"

    def _region(self) -> PolygonRegion | AnnulusRegion | None:
        if self.polygon is not None:
            return PolygonRegion(corners=self.polygon)
        if self.near is None or self.within is None:
            return None
        return AnnulusRegion(centre=self.near, within=self.within, beyond=self.beyond)


@dataclass(frozen=True, kw_only=True)
class Place:
    """One of several places: a prior and its weight."""

    prior: "Gaussian | Uniform"
    weight: float

    def __post_init__(self) -> None:
        number("weight of a place", self.weight, low=0, above=True)


@dataclass(frozen=True, kw_only=True)
class Places:
    """x_0 is at one of several places.

    Attributes:
        places: a table for each: its ``weight`` (1), and the keys of another kind of prior.
    """

    places: tuple[Place, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.places, tuple | list):
            raise InputError(f"prior.places is {self.places!r}, but must be a list of tables.")
        object.__setattr__(self, "places", tuple(map(_place, self.places)))

    def of(self, room: TrialEnv, rng: np.random.Generator | None = None) -> Prior:
        """Return p(x_0) in the episode that a room has begun last; nothing is drawn."""
        if not self.places:
            raise InputError("the prior has kind places, but no place: add [[prior.places]].")
        parts = tuple(place.prior.of(room) for place in self.places)
        return MixturePrior(parts=parts, weights=tuple(place.weight for place in self.places))

    @property
    def where(self) -> str:
        """Where they are, in words."""
        total = sum(place.weight for place in self.places)
        each = (f"{100 * p.weight / total:.0f} % {p.prior.where}" for p in self.places)
        return f"one of {len(self.places)} places: {'; '.join(each)}"


def _place(given: Any) -> Place:
    """Return a place, of the table of a scenario file."""
    if isinstance(given, Place):
        return given
    if not isinstance(given, Mapping):
        raise InputError(f"a place of the prior is {given!r}, but must be a table.")
    keys = dict(given)
    weight = keys.pop("weight", 1.0)
    if keys.get("kind") == "places":
        raise InputError("a place of the prior is of kind places: name the places side by side.")
    if keys.get("kind") in (None, "displaced"):
        one_of("kind of a place", keys.get("kind"), ("gaussian", "uniform"))
    prior = _changed("prior", Gaussian(), keys, "px")  # lengths as they are told
    if isinstance(prior, Gaussian) and (prior.mean is None or "sd_position" not in keys):
        raise InputError("a gaussian place of the prior needs mean and sd_position: give both.")
    return Place(prior=prior, weight=weight)


PRIORS = MappingProxyType(
    {"gaussian": Gaussian, "uniform": Uniform, "places": Places, "displaced": Displaced}
)


T = TypeVar("T")

_KINDS: Mapping[str, Mapping[str, Any]] = {
    "motion": MOTION_MODELS, "scan": BEAM_MODELS, "prior": PRIORS
}  # fmt: skip
_PARTS = tuple(own.name for own in fields(World))
_ASSUMED = ("motion", "scan", "prior")
OPEN_LOOP = Named("open-loop")
AS_WORLD = "world"  # what is assumed is what the world is


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A world, what the filters assume of it, and who drives.

    Attributes:
        words: what is special about it, one line.
        env: arguments of ``RoomEnv``: the preset to start from, and changes to its parts.
        motion: p(x_t | x_{t-1}, a_t), as the filters assume it.
        scan: p(o | ô) of a beam, or p(o | x, m) of somebody else, as the filters assume it.
        prior: p(x_0), as the filters assume it.
        agent: who drives, by name, with its parameters.
        disturbance: wrappers around the world, innermost first: {"kind": "kidnap", …}.
        buildings: trial k takes place in the office of seed k modulo this, if the floor plan is one
            without a seed or seeds of its own.
        thresholds: of the scores.
        source: digest of the files that it was read from; "" if built-in.
    """

    words: str
    env: Mapping[str, Any]
    motion: MotionModel = field(default_factory=OdometryMotion)
    scan: BeamDensity | ScanPlugIn = field(default_factory=GaussianUniform)
    prior: Gaussian | Uniform | Places | Displaced = field(default_factory=Gaussian)
    agent: Named = OPEN_LOOP
    disturbance: tuple[Mapping[str, Any], ...] = ()
    buildings: int = 1
    thresholds: Thresholds = field(default_factory=Thresholds)
    source: str = ""

    def __post_init__(self) -> None:
        integer("buildings", self.buildings, low=1)
        if isinstance(self.agent, str):
            object.__setattr__(self, "agent", Named(self.agent))

    @cached_property
    def world(self) -> World:
        """The world that the env's arguments describe."""
        parts = {name: value for name, value in self.in_building(0).env.items() if name in _PARTS}
        return WORLDS[one_of("preset", self.env["preset"], WORLDS)].changed(**parts)

    @property
    def unit(self) -> str:
        """Of all lengths."""
        return self.world.floor_plan.unit

    def room(self) -> TrialEnv:
        """Return the env, set up to run all planned steps."""
        return RoomEnv(**self.env, ends_at_goal=False)

    @property
    def has_goal(self) -> bool:
        """Whether its robot is to arrive somewhere."""
        return self.world.route is not None

    @property
    def may_be_lost(self) -> bool:
        """Whether the question is where the robot is: no pose is expected, or the map is wrong.

        A robot that drives on what it believes, on a wrong map, is to arrive.
        """
        if not isinstance(self.prior, Gaussian):
            return True
        return self.world.differs_from_map and self.agent == type(self).agent

    @property
    def judged(self) -> int | None:
        """Of a whole log, the first record by which beliefs are judged; None of other worlds."""
        return None

    def in_building(self, trial: int) -> Self:
        """Return this scenario in the building of a trial's number."""
        floor_plan = self.env.get("floor_plan")
        seeded = _seeded(floor_plan, trial, self.buildings)
        if seeded is floor_plan:
            return self
        return replace(self, env={**self.env, "floor_plan": seeded})

    def robot_model(self, room: TrialEnv) -> RobotModel:
        """Return what localizers and agents are made for: the room's map and lidar, this noise."""
        return RobotModel(
            floor_plan=room.floor_plan,
            lidar=room.lidar,
            radius=room.radius,
            motion=self.motion,
            scan=self.scan,
        )

    def prior_in(self, room: TrialEnv, rng: np.random.Generator | None = None) -> Prior:
        """Return p(x_0) in the episode that a room has begun last; ``rng`` is for ``Displaced``."""
        return self.prior.of(room, rng)

    def changed(
        self, world: Mapping[str, Any] = NOTHING, assumed: Mapping[str, Any] = NOTHING
    ) -> Self:
        """Return this scenario with some values changed, by dotted name.

        If lengths are in another unit in the new world, those of this scenario are converted.

        Args:
            world: arguments of ``RoomEnv``: ``{"lidar.beams": 9, "driver": "none"}``.
            assumed: ``{"scan.kind": "beam-model", "prior.sd_position": 5.0}``; "world" is what the
                new world is: ``{"motion": "world", "scan.sigma": "world"}``.

        Raises:
            InputError: unknown name or a bad value.
        """
        moved, values = self, Changes(world)
        if values:
            moved = replace(self, env=self._env_with(values))
            factor = pixel(moved.unit) / pixel(self.unit)
            moved = moved if factor == 1.0 else replace(scaled(self, factor), env=moved.env)
        groups = moved._told(Changes(assumed)).by_part(_ASSUMED, "assumption")
        parts = {
            part: _changed(part, getattr(moved, part), keys, moved.unit)
            for part, keys in groups.items()
        }
        return replace(moved, **parts)

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

    def _told(self, assumed: Changes) -> Changes:
        """Return what is assumed with the world's values in place of the word "world"."""
        told: dict[str, Any] = {}
        for name, value in assumed.items():
            known = self.known if value == AS_WORLD else {name: value}
            of_it = {n: v for n, v in known.items() if f"{n}.".startswith(f"{name}.")}
            if not of_it:
                one_of('assumption that can be "world"', name, known)
            told |= of_it
        return Changes(told)

    def _env_with(self, values: Changes) -> Mapping[str, Any]:
        """Return the env's arguments with some changed."""
        groups = values.by_part((*_PARTS, "horizon"), "part of the world")
        parts = {name: groups[name] for name in _PARTS if name in groups}
        if "floor_plan" in parts:
            parts["floor_plan"] = _seeded(parts["floor_plan"], 0, self.buildings)
        world = self.world.changed(**parts)
        whole = {name: getattr(world, name) or "none" for name in _PARTS}
        given = groups.get("floor_plan", self.env.get("floor_plan"))
        if given is not None:
            whole["floor_plan"] = given  # as it was said: offices differ by trial
        horizon = {"horizon": groups["horizon"]} if "horizon" in groups else {}
        return {**self.env, **whole, **horizon}


def _seeded(floor_plan: Any, trial: int, buildings: int) -> Any:
    """Return a floor plan with the seed that an office has in a trial; others as they are.

    Of ``seeds`` it is the first + trial, modulo their number.
    """
    if not isinstance(floor_plan, Mapping) or not isinstance(floor_plan.get("office"), Mapping):
        return floor_plan
    if (offices := offices_of(floor_plan)) is not None:
        first, end = offices.seeds
        options = {key: v for key, v in floor_plan["office"].items() if key != "seeds"}
        return {**floor_plan, "office": {**options, "seed": first + trial % (end - first)}}
    if "seed" in floor_plan["office"]:
        return floor_plan
    return {**floor_plan, "office": {**floor_plan["office"], "seed": trial % buildings}}


def _changed(part: str, current: T, keys: Any, unit: str) -> T:
    """Change values of what is assumed; another kind keeps those that both kinds have."""
    kinds = _KINDS.get(part, {})
    if not isinstance(keys, Mapping):
        raise InputError(
            f"{part} is {keys!r}, but must name a key: {', '.join(_names(part, current))}."
        )
    changes = dict(keys)
    if part == "scan" and is_code(changes.get("kind")):
        return ScanPlugIn(kind=changes.pop("kind")).changed(**changes)  # type: ignore[return-value]
    if isinstance(current, ScanPlugIn) and "kind" not in changes:
        return current.changed(**changes)  # type: ignore[return-value]
    if kinds and "kind" in changes:
        given = _kind(part, changes.pop("kind"), kinds)
        kind = kinds[given]
        if not isinstance(current, kind):
            known = {own.name for own in fields(kind)}
            shared = {name: value for name, value in vars(current).items() if name in known}
            motion = part == "motion"
            fresh: Any = unknown_motion(given, unit) if motion else scaled(kind(), pixel(unit))
            current = replace(fresh, **shared)
    for key in changes:
        one_of("assumption", f"{part}.{key}", _names(part, current))
    return replace(current, **changes)  # type: ignore[type-var]


def is_code(kind: object) -> bool:
    """Whether a kind of scan model says where its code is."""
    return isinstance(kind, str) and (is_file(kind) or is_reference(kind))


def _kind(part: str, given: Any, kinds: Mapping[str, Any]) -> str:
    try:
        return one_of(f"kind of {part}", given, kinds)
    except InputError as error:
        if part != "scan":
            raise
        raise InputError(f"{str(error).rstrip('.')}, or your own as file.py:NAME.") from None


def _names(part: str, current: Any) -> list[str]:
    """Dotted names of what can be changed of an assumption."""
    keys = [own.name for own in fields(current)] + ["kind"] * (part in _KINDS)
    return [f"{part}.{key}" for key in keys]
