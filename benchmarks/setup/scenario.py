"""Scenario: a world, what the filters assume of it, and who drives."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, Self, TypeVar

import numpy as np

from benchmarks.setup.priors import PRIORS, Gaussian, Uniform
from benchmarks.setup.thresholds import Thresholds
from benchmarks.setup.trial_env import TrialEnv
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps.map import pixel, scaled
from deqmcl_gym.validation import InputError, integer, one_of
from deqmcl_gym.world.config import WORLDS, World
from localizers import GaussianUniform, OdometryMotion, Prior, RobotModel
from localizers.models.beams import BEAM_MODELS, BeamDensity
from localizers.models.nav2_motion import MOTION_MODELS, MotionModel, unknown_motion

T = TypeVar("T")

_KINDS: Mapping[str, Mapping[str, Any]] = {
    "motion": MOTION_MODELS, "scan": BEAM_MODELS, "prior": PRIORS
}  # fmt: skip
_PARTS = tuple(own.name for own in fields(World))
NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A world, what the filters assume of it, and who drives.

    Attributes:
        words: what is special about it, one line.
        env: arguments of ``RoomEnv``: the preset to start from, and changes to its parts.
        motion: p(x_t | x_{t-1}, a_t), as the filters assume it.
        scan: p(o | ô) of a beam, as the filters assume it.
        prior: p(x_0), as the filters assume it.
        agent: who drives, by name.
        disturbance: wrappers around the world, innermost first: ((("kind", "kidnap"), …), …).
        buildings: trial k takes place in the office of seed k modulo this, if the floor plan is one
            without a seed of its own.
        thresholds: of the scores.
        source: digest of the files that it was read from; "" if built-in.
    """

    words: str
    env: Mapping[str, Any]
    motion: MotionModel = field(default_factory=OdometryMotion)
    scan: BeamDensity = field(default_factory=GaussianUniform)
    prior: Gaussian | Uniform = field(default_factory=Gaussian)
    agent: str = "open-loop"
    disturbance: tuple[tuple[tuple[str, Any], ...], ...] = ()
    buildings: int = 1
    thresholds: Thresholds = field(default_factory=Thresholds)
    source: str = ""

    def __post_init__(self) -> None:
        integer("buildings", self.buildings, low=1)

    @cached_property
    def world(self) -> World:
        """The world that the env's arguments describe."""
        parts = {name: value for name, value in self.env.items() if name in _PARTS}
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

    def in_building(self, trial: int) -> Self:
        """Return this scenario in the building of a trial's number."""
        floor_plan = self.env.get("floor_plan")
        if not isinstance(floor_plan, Mapping) or "office" not in floor_plan:
            return self
        office = floor_plan["office"]
        if "seed" in office:
            return self
        seeded = {**floor_plan, "office": {**office, "seed": trial % self.buildings}}
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

    def filter_rng(self, trial: Any) -> np.random.Generator:
        """Return the stream of a trial's localizer: see ``Trial.filter_rng``."""
        found: np.random.Generator = trial.filter_rng()
        return found

    def prior_in(self, room: TrialEnv) -> Prior:
        """Return p(x_0) in the episode that a room has begun last."""
        return self.prior.of(room)

    def changed(
        self, world: Mapping[str, Any] = NOTHING, assumed: Mapping[str, Any] = NOTHING
    ) -> Self:
        """Return this scenario with some values changed, by dotted name.

        If lengths are in another unit in the new world, those of this scenario are converted.

        Args:
            world: arguments of ``RoomEnv``: ``{"lidar.beams": 9, "driver": "none"}``.
            assumed: ``{"scan.kind": "beam-model", "prior.sd_position": 5.0}``.

        Raises:
            InputError: unknown name or a bad value.
        """
        moved = self._moved(world)
        groups = grouped(assumed, ("motion", "scan", "prior"), "assumption")
        parts = {
            part: _changed(part, getattr(moved, part), keys, moved.unit)
            for part, keys in groups.items()
        }
        return replace(moved, **parts)

    def _moved(self, values: Mapping[str, Any]) -> Self:
        """Change the world; convert all other lengths if its unit is another one."""
        if not values:
            return self
        moved = replace(self, env=self._env_with(values))
        factor = pixel(moved.unit) / pixel(self.unit)
        return moved if factor == 1.0 else replace(scaled(self, factor), env=moved.env)

    def _env_with(self, values: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the env's arguments with some changed, by dotted name."""
        groups = grouped(values, (*_PARTS, "horizon"), "part of the world")
        world = self.world.changed(**{name: groups[name] for name in _PARTS if name in groups})
        whole = {name: getattr(world, name) or "none" for name in _PARTS}
        given = groups.get("floor_plan", self.env.get("floor_plan"))
        if given is not None:
            whole["floor_plan"] = given  # as it was said: offices differ by trial
        horizon = {"horizon": groups["horizon"]} if "horizon" in groups else {}
        return {**self.env, **whole, **horizon}


def grouped(values: Mapping[str, Any], parts: Collection[str], what: str) -> dict[str, Any]:
    """Return values by dotted name as those of each part; one without a dot is the whole part.

    Raises:
        InputError: unknown part, or one that is given both ways.
    """
    whole: dict[str, Any] = {}
    keyed: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        part, _, key = name.partition(".")
        one_of(what, part, parts)
        if key:
            keyed.setdefault(part, {})[key] = value
        else:
            whole[part] = value
    for part in whole.keys() & keyed.keys():
        raise InputError(f"{part} is given whole and by key: give only one of them.")
    return whole | {part: _nested(part, keys) for part, keys in keyed.items()}


def _nested(part: str, keys: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``{"office.seed": 3}`` as ``{"office": {"seed": 3}}``."""
    return grouped(keys, {key.partition(".")[0] for key in keys}, f"key in {part}")


def _changed(part: str, current: T, keys: Any, unit: str) -> T:
    """Change values of what is assumed; another kind keeps those that both kinds have."""
    kinds = _KINDS.get(part, {})
    if not isinstance(keys, dict):
        raise InputError(
            f"{part} is {keys!r}, but must name a key: {', '.join(_names(part, current))}."
        )
    changes = dict(keys)
    if kinds and "kind" in changes:
        given = one_of(f"kind of {part}", changes.pop("kind"), kinds)
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


def _names(part: str, current: Any) -> list[str]:
    """Dotted names of what can be changed of an assumption."""
    keys = [own.name for own in fields(current)] + ["kind"] * (part in _KINDS)
    return [f"{part}.{key}" for key in keys]
