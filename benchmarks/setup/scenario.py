"""Scenario: a world, what the filters assume of it, who drives, and when an estimate is far off."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from benchmarks.setup.assumed import changed
from benchmarks.setup.changes import NOTHING, Changes, Named, located
from benchmarks.setup.interfaces import TrialEnv
from benchmarks.setup.priors import PRIORS, Displaced, Gaussian, Places, Uniform
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps.map import LENGTH, pixel, scaled
from deqmcl_gym.validation import integer, number, one_of
from deqmcl_gym.world.config import World, offices_of
from deqmcl_gym.world.presets import WORLDS
from localizers import GaussianUniform, OdometryMotion, Prior, RobotModel
from localizers.models.beams import BEAM_MODELS, BeamDensity
from localizers.models.nav2_motion import MOTION_MODELS, MotionModel
from localizers.scan_plug_in import ScanPlugIn


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """What the scores count as far off, and as lost.

    Lengths are in the map's unit; the defaults are for one in px.

    Attributes:
        far: position error above which an estimate is far off.
        lost: mean position error of the last steps above which a trial is lost.
        lost_steps: how many steps these are.
    """

    far: float = field(default=50.0, metadata=LENGTH)
    lost: float = field(default=50.0, metadata=LENGTH)
    lost_steps: int = 20

    def __post_init__(self) -> None:
        number("thresholds.far", self.far, low=0, above=True)
        number("thresholds.lost", self.lost, low=0, above=True)
        integer("thresholds.lost_steps", self.lost_steps, low=1)


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
        code: names of the plug-ins that it and its bases are.
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
    code: tuple[str, ...] = ()

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
        moved, values = self, located(Changes(world))
        if values:
            moved = replace(self, env=self._env_with(values))
            factor = pixel(moved.unit) / pixel(self.unit)
            moved = moved if factor == 1.0 else replace(scaled(self, factor), env=moved.env)
        groups = moved._told(Changes.told("assumed", assumed)).by_part(_ASSUMED, "assumption")
        parts = {
            part: changed(part, getattr(moved, part), keys, moved.unit, _KINDS[part])
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
