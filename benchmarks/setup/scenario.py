"""Scenario: a world, what the filters assume of it, and who drives; so also what is scored."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

from benchmarks.setup import TrialEnv
from benchmarks.setup.overrides import NOTHING, Named, Overrides, located
from benchmarks.setup.priors import PRIORS, Gaussian, Places, Rng, Uniform, changed
from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.maps.map import LENGTH, pixel, scaled
from deqmcl_gym.numerics import Pose
from deqmcl_gym.validation import integer, number, one_of
from deqmcl_gym.world import World, offices_of
from localizers import GaussianUniform, OdometryMotion, Prior, RobotModel
from localizers.models.nav2_motion import MOTION_MODELS, MotionModel
from localizers.models.scan import BEAM_MODELS, BeamDensity
from localizers.registry import ScanPlugIn


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


_KINDS: Mapping[str, Any] = {"motion": MOTION_MODELS, "scan": BEAM_MODELS, "prior": PRIORS}
_PARTS = tuple(part.name for part in fields(World))
OPEN_LOOP = Named("open-loop")


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
                names = ("motion", "scan", "prior", "thresholds")
                moved = replace(moved, **{n: scaled(getattr(self, n), factor) for n in names})
        groups = moved._resolved(Overrides.told("assumed", assumed)).by_part(_KINDS, "assumption")
        parts = {
            part: changed(part, getattr(moved, part), keys, moved.unit, _KINDS[part])
            for part, keys in groups.items()
        }
        return replace(moved, **parts)

    def _resolved(self, assumed: Overrides) -> Overrides:
        """Return what is assumed with the world's values in place of the word "world"."""
        resolved: dict[str, Any] = {}
        for name, value in assumed.items():
            values = self.known if value == "world" else {name: value}
            leaves = {n: v for n, v in values.items() if f"{n}.".startswith(f"{name}.")}
            if not leaves:
                one_of('assumption that can be "world"', name, values)
            resolved |= leaves
        return Overrides(resolved)


@dataclass(frozen=True, kw_only=True)
class RoomScenario(Scenario):
    """Episodes in a room or building."""

    world: World  # all parts of it; with ``office``, in the building of trial 0
    # floor plan {"office": {…}} of which each trial has its own building; None: that of the world
    office: Mapping[str, Any] | None = None
    horizon: int | None = None  # number of planned actions shown; None: all

    @property
    def unit(self) -> str:
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
        return RoomEnv(world=self.world, horizon=self.horizon, ends_at_goal=False)

    def in_building(self, trial: int) -> Self:
        if self.office is None:
            return self
        floor_plan = _seeded(self.office, trial, self.buildings)
        return replace(self, world=self.world.changed(floor_plan=floor_plan))

    def in_world(self, values: Overrides) -> Self:
        """Return this scenario with parts of its world, or the horizon, changed by dotted name."""
        parts = values.by_part((*_PARTS, "horizon"), "part of the world")
        horizon, office = parts.pop("horizon", self.horizon), self.office
        if "floor_plan" in parts:
            plan = parts["floor_plan"]
            parts["floor_plan"] = _seeded(plan, 0, self.buildings)
            office = plan if parts["floor_plan"] is not plan else None
        world = self.world.changed(**parts)
        return replace(self, world=world, office=office, horizon=horizon)

    @property
    def known(self) -> Mapping[str, Any]:
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
