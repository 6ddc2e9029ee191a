"""The parts of a world that can be configured, as frozen dataclasses; units px and rad."""

import math
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.validation import InputError, array, number, one_of, part, pose


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A disc that turns on the spot, then drives straight ahead.

    Attributes:
        radius: of the disc, px.
        max_distance: longest drive in one step, px.
        max_turn: largest turn in one step to either side, rad.
    """

    radius: float = 8.0
    max_distance: float = 10.0
    max_turn: float = math.pi / 4

    def __post_init__(self) -> None:
        number("robot.radius", self.radius, low=0)
        number("robot.max_distance", self.max_distance, low=0, above=True)
        number("robot.max_turn", self.max_turn, low=0, high=math.pi, above=True)


@dataclass(frozen=True, kw_only=True)
class MotionNoise:
    """ε_d ~ N(0, (drive |d|)²), ε_φ ~ N(0, (turn |φ| + drift |d|)²) on a command (d, φ).

    Attributes:
        drive: σ_dd, px per px.
        turn: σ_φφ, rad per rad.
        drift: σ_φd, rad per px.
    """

    drive: float = 0.02
    turn: float = 0.02
    drift: float = 0.0005

    def __post_init__(self) -> None:
        for name in ("drive", "turn", "drift"):
            number(f"noise.{name}", getattr(self, name), low=0)


@dataclass(frozen=True, kw_only=True)
class Start:
    """Where an episode begins: N(pose, diag(sd_position², sd_position², sd_heading²)), if free.

    Attributes:
        pose: (x px, y px, θ rad); None is the bottom centre of the lap, along it.
        sd_position: in x and in y, px; 0 starts exactly there.
        sd_heading: rad.
    """

    pose: tuple[float, float, float] | None = None
    sd_position: float = 0.0
    sd_heading: float = 0.0

    def __post_init__(self) -> None:
        if self.pose is not None:
            object.__setattr__(self, "pose", pose("start.pose", self.pose))
        number("start.sd_position", self.sd_position, low=0)
        number("start.sd_heading", self.sd_heading, low=0)


@dataclass(frozen=True, kw_only=True)
class Lap:
    """How the planned lap is driven.

    Attributes:
        step: distance of a driving step, px.
        turn: angle of a turning step, rad.
        waypoints: corners of the closed path, in order; None computes a counterclockwise path in
            the middle of the corridor around the obstacles.
    """

    step: float = 5.0
    turn: float = math.pi / 12
    waypoints: tuple[tuple[float, float], ...] | None = None

    def __post_init__(self) -> None:
        number("lap.step", self.step, low=0, above=True)
        number("lap.turn", self.turn, low=0, high=math.pi, above=True)
        if self.waypoints is not None:
            corners = array("lap.waypoints", self.waypoints, (None, 2))
            if len(corners) < 3:
                raise InputError(
                    f"lap.waypoints has {len(corners)} corners, but a lap needs 3 or more."
                )
            if (same := (corners == np.roll(corners, -1, axis=0)).all(axis=1)).any():
                x, y = corners[same.argmax()]
                raise InputError(
                    f"lap.waypoints has ({x:g}, {y:g}) twice in a row: name each corner once; the "
                    "last corner is joined to the first by itself."
                )
            object.__setattr__(self, "waypoints", tuple((x, y) for x, y in corners.tolist()))


@dataclass(frozen=True, kw_only=True)
class Driver:
    """Someone who knows the true pose and follows the lap's path from there, step by step.

    Attributes:
        look_ahead: way along the path to the point it heads for, px.
        on_the_spot: heading error beyond which it turns without driving, rad.
    """

    look_ahead: float = 25.0
    on_the_spot: float = 0.5

    def __post_init__(self) -> None:
        number("driver.look_ahead", self.look_ahead, low=0, above=True)
        number("driver.on_the_spot", self.on_the_spot, low=0, high=math.pi, above=True)


@dataclass(frozen=True, kw_only=True)
class World:
    """Everything an episode is made of, but its seed.

    Without a driver the plan is the lap, the same at every step.
    """

    floor_plan: PolygonMap
    lidar: Lidar = field(default_factory=Lidar)
    robot: Robot = field(default_factory=Robot)
    noise: MotionNoise = field(default_factory=MotionNoise)
    start: Start = field(default_factory=Start)
    lap: Lap = field(default_factory=Lap)
    driver: Driver | None = None

    def changed(self, **parts: Any) -> "World":
        """Return this world with other parts, each whole or as a mapping of changes; None keeps.

        Changes to a driver that the world does not have are changes to ``Driver()``.

        A floor plan is always given whole: ``{"outer": [...], "obstacles": [...]}``.

        Raises:
            InputError: unknown part or key, or a bad value.
        """
        known = {own.name: getattr(self, own.name) for own in fields(self)}
        for name in parts:
            one_of("part of the world", name, known)
        parts = {name: value for name, value in parts.items() if value is not None}
        if self.driver is None:
            known["driver"] = Driver()
        floor_plan = parts.get("floor_plan")
        if isinstance(floor_plan, dict):
            for key in floor_plan:
                one_of("key in floor_plan", key, ("outer", "obstacles"))
            parts["floor_plan"] = PolygonMap(**{"outer": None, **floor_plan})
        return replace(
            self,
            **{
                name: part(name, type(known[name]), value, known[name])
                for name, value in parts.items()
            },
        )
