"""Scenario: a world, what the filters assume of it, and who drives."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, TypeVar

from benchmarks.setup.priors import PRIORS, Gaussian, Uniform
from benchmarks.setup.thresholds import Thresholds
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps.units import pixel, scaled
from deqmcl_gym.validation import InputError, integer, one_of
from deqmcl_gym.world.config import World
from deqmcl_gym.world.presets import WORLDS
from localizers import GaussianUniform, OdometryMotion, Prior, RobotModel
from localizers.models.beams import BEAM_MODELS, BeamDensity

T = TypeVar("T")

_KINDS: Mapping[str, Mapping[str, Any]] = {"scan": BEAM_MODELS, "prior": PRIORS}
_PARTS = tuple(own.name for own in fields(World))
_NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A world, what the filters assume of it, and who drives.

    Attributes:
        words: what is special about it, one line.
        env: arguments of ``RoomEnv``: the preset to start from, and changes to its parts.
        motion: p(x_t | x_{t-1}, a_t), as the filters assume it.
        scan: p(o | ô) of a beam, as the filters assume it.
        prior: what the filters are told of x_0.
        agent: who drives, by name.
        disturbance: wrappers around the world, innermost first: ((("kind", "kidnap"), …), …).
        buildings: trial k takes place in the office of seed k modulo this, if the floor plan is one
            without a seed of its own.
        thresholds: of the scores.
        source: digest of the files that it was read from; "" if built-in.
    """

    words: str
    env: Mapping[str, Any]
    motion: OdometryMotion = field(default_factory=OdometryMotion)
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

    def room(self) -> RoomEnv:
        """Return the env, set up to run all planned steps."""
        return RoomEnv(**self.env, ends_at_goal=False)

    def in_building(self, trial: int) -> "Scenario":
        """Return this scenario in the building of a trial's number."""
        floor_plan = self.env.get("floor_plan")
        office = floor_plan.get("office") if isinstance(floor_plan, Mapping) else None
        if office is None or "seed" in office:
            return self
        seeded = {"office": {**office, "seed": trial % self.buildings}}
        return replace(self, env={**self.env, "floor_plan": seeded})

    def robot_model(self, room: RoomEnv) -> RobotModel:
        """Return what localizers and agents are made for: the room's map and lidar, this noise."""
        return RobotModel(
            floor_plan=room.floor_plan,
            lidar=room.lidar,
            radius=room.world.robot.radius,
            motion=self.motion,
            scan=self.scan,
        )

    def prior_in(self, room: RoomEnv) -> Prior:
        """Return p(x_0) in a room."""
        return self.prior.of(room)

    def changed(
        self, world: Mapping[str, Any] = _NOTHING, assumed: Mapping[str, Any] = _NOTHING
    ) -> "Scenario":
        """Return this scenario with some values changed, by dotted name.

        If lengths are in another unit in the new world, those of this scenario are converted.

        Args:
            world: arguments of ``RoomEnv``: ``{"lidar.beams": 9, "driver": "none"}``.
            assumed: ``{"scan.kind": "beam-model", "prior.sd_position": 5.0}``.

        Raises:
            InputError: unknown name or a bad value.
        """
        moved = self._moved(_grouped(world, (*_PARTS, "horizon"), "part of the world"))
        unit = moved.world.floor_plan.unit
        groups = _grouped(assumed, ("motion", "scan", "prior"), "assumption")
        parts = {
            part: _changed(part, getattr(moved, part), keys, unit) for part, keys in groups.items()
        }
        return replace(moved, **parts)

    def _moved(self, groups: Mapping[str, Any]) -> "Scenario":
        """Change the world; convert all other lengths if its unit is another one."""
        if not groups:
            return self
        if isinstance(floor_plan := groups.get("floor_plan"), Mapping):
            groups = {**groups, "floor_plan": _nested(floor_plan)}
        world = self.world.changed(**{name: groups[name] for name in _PARTS if name in groups})
        factor = pixel(world.floor_plan.unit) / pixel(self.world.floor_plan.unit)
        ours = self if factor == 1.0 else scaled(self, factor)
        whole = {name: getattr(world, name) or "none" for name in _PARTS}
        given = groups.get("floor_plan", self.env.get("floor_plan"))
        whole["floor_plan"] = (
            world.floor_plan if given is None else given
        )  # offices differ by trial
        horizon = {"horizon": groups["horizon"]} if "horizon" in groups else {}
        return replace(ours, env={**self.env, **whole, **horizon})


def _grouped(values: Mapping[str, Any], parts: Sequence[str], what: str) -> dict[str, Any]:
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
    return whole | keyed


def _nested(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table whose keys may be dotted, at one level, as nested ones."""
    nested: dict[str, Any] = {}
    for name, value in keys.items():
        outer, _, inner = name.partition(".")
        if inner:
            nested.setdefault(outer, {})[inner] = value
        else:
            nested[outer] = value
    return nested


def _changed(part: str, current: T, keys: Any, unit: str) -> T:
    """Change values of what is assumed; another kind keeps those that both kinds have."""
    kinds = _KINDS.get(part, {})
    if not isinstance(keys, dict):
        raise InputError(
            f"{part} is {keys!r}, but must name a key: {', '.join(_names(part, current))}."
        )
    changes = dict(keys)
    if kinds and "kind" in changes:
        kind = kinds[one_of(f"kind of {part}", changes.pop("kind"), kinds)]
        if not isinstance(current, kind):
            known = {own.name for own in fields(kind)}
            shared = {name: value for name, value in vars(current).items() if name in known}
            current = replace(scaled(kind(), pixel(unit)), **shared)
    for key in changes:
        one_of("assumption", f"{part}.{key}", _names(part, current))
    return replace(current, **changes)  # type: ignore[type-var]


def _names(part: str, current: Any) -> list[str]:
    """Dotted names of what can be changed of an assumption."""
    keys = [own.name for own in fields(current)] + ["kind"] * (part in _KINDS)
    return [f"{part}.{key}" for key in keys]
