"""What defines an episode: the parts of a world, frozen dataclasses, named worlds, random streams.

Lengths are in the map's unit, angles in rad. The defaults are those of the paper's room, in px: 350
× 300 with a solid inner rectangle. The paper publishes only the room; see docs/equations.md for the
other choices. What filters assume about a world is part of a benchmark's scenario.

Stream k of episode i after ``reset(seed=s)`` is SeedSequence(s, spawn_key=(i, k)), so that draws
from one source do not change those from another. The j-th further source of the same kind, such as
a second wrapper, has the key (i, k, j).
"""

import enum
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from deqmcl_gym.maps import Box, GridMap, Lidar, Map, Office, Offices, PolygonMap, polygons
from deqmcl_gym.maps.map import LENGTH, PER_LENGTH, POSE, Part, bounded, pixel, scaled
from deqmcl_gym.validation import InputError, array, one_of, part, pose, shown
from deqmcl_gym.world.differences import ChangedWalls, Clutter, Glass
from deqmcl_gym.world.people import People


class Stream(enum.IntEnum):
    """Sources of randomness. Never change the numbers: results of a seed depend on them."""

    MOTION = 0
    SENSOR = 1
    START = 2
    DROPOUT = 3
    KIDNAP = 4
    ROUTE = 5
    CLUTTER = 6
    CHANGED_WALLS = 7
    PEOPLE = 8
    GLASS = 9  # which walls are glass
    THROUGH_GLASS = 10  # which beams it does not reflect
    BUILDING = 11  # which office it is, where each episode has another


def episode_stream(seed: int, episode: int, stream: Stream, twin: int = 0) -> np.random.Generator:
    """Return the generator of one source in the ``episode``-th episode (from 0) after seeding.

    ``twin`` is the number of sources of this kind before it.
    """
    key = (episode, int(stream), twin) if twin else (episode, int(stream))
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def floor_plan_of(given: Any) -> Map:
    """Return the map that is given; see ``World.changed`` for how it may be."""
    if isinstance(given, PolygonMap | GridMap):
        return given
    if isinstance(given, Office):
        return given.grid
    if isinstance(given, str | os.PathLike):
        return _read({"file": given})
    if not isinstance(given, Mapping):
        raise InputError(
            f"floor_plan is {shown(given)}, but must be a map, the path of a map's file, or a "
            f"mapping of {', '.join(polygons.KEYS)}, of file and unknown, or of office."
        )
    if "office" in given:
        return _office(given).grid
    return _read(given) if "file" in given else polygons.of_mapping(given)


def offices_of(given: Any) -> Offices | None:
    """Return the offices of ``{"office": {"seeds": [0, 1000], …}}``; None of another floor plan."""
    if not (isinstance(given, Mapping) and isinstance(given.get("office"), Mapping)):
        return None
    office = dict(given["office"])
    if "seeds" not in office:
        return None
    seeds = office.pop("seeds")
    if "seed" in office:
        raise InputError(
            f"floor_plan.office has seed = {shown(office['seed'])} and seeds = {shown(seeds)}: "
            "give one of them."
        )
    return Offices(seeds=seeds, office=_office({**given, "office": office}))


def extent_of(given: Any, floor_plan: Map) -> Box:
    """Return the bounds of a floor plan; of all offices of its kind if it is one: one scale."""
    if not (isinstance(given, Mapping) and "office" in given):
        return floor_plan.bounds
    return (offices_of(given) or Offices(seeds=(0, 1), office=_office(given))).bounds


def _office(given: Mapping[str, Any]) -> Office:
    for key in given:
        one_of("key in floor_plan", key, ("office",))
    office = given["office"]
    if isinstance(office, Mapping) and "seeds" in office:
        raise InputError(
            "floor_plan.office has seeds, but here the building must be the same in all episodes: "
            "give a seed."
        )
    checked: Office = part("floor_plan.office", Office, office, Office())
    return checked


def _read(given: Mapping[str, Any]) -> Map:
    """Return the map in a file: a yaml of ROS, or polygons as JSON."""
    path = given["file"]
    is_json = str(path).endswith(".json")
    for key in given:
        one_of("key in floor_plan", key, ("file",) if is_json else ("file", "unknown"))
    if is_json:
        return polygons.read_polygons(path)
    return GridMap.load(path, given.get("unknown", "obstacle"))


SKIN = 1e-3  # px


@dataclass(frozen=True, kw_only=True)
class Robot(Part, called="robot.{}"):
    """A disc that turns on the spot, then drives straight ahead."""

    radius: float = bounded(8.0, LENGTH, low=0)  #: of the disc
    max_distance: float = bounded(10.0, LENGTH, low=0, above=True)  #: longest drive in one step
    #: largest turn in one step, rad
    max_turn: float = bounded(math.pi / 4, low=0, high=math.pi, above=True)


@dataclass(frozen=True, kw_only=True)
class MotionNoise(Part, called="noise.{}"):
    """``ε_d ~ N(0, (drive |d|)²)``, ``ε_φ ~ N(0, (turn |φ| + drift |d|)²)`` on a command (d, φ)."""

    drive: float = bounded(0.02, low=0)  #: error of the distance, per distance driven
    turn: float = bounded(0.02, low=0)  #: error of the turn, rad per rad turned
    drift: float = bounded(0.0005, PER_LENGTH, low=0)  #: error of the turn, rad per length

    @property
    def sds(self) -> tuple[float, float, float]:
        """σ_dd, σ_φφ and σ_φd, as kernels take them."""
        return float(self.drive), float(self.turn), float(self.drift)


@dataclass(frozen=True, kw_only=True)
class Start(Part, called="start.{}"):
    """Where an episode begins: N(pose, diag(sd_position², sd_position², sd_heading²)), if free."""

    #: (x, y, θ); None: the middle of the lowest side of the lap, along it
    pose: tuple[float, float, float] | None = field(default=None, metadata=POSE)
    sd_position: float = bounded(0.0, LENGTH, low=0)  #: standard deviation in x and in y
    sd_heading: float = bounded(0.0, low=0)  #: standard deviation of the heading, rad

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.pose is not None:
            object.__setattr__(self, "pose", pose("start.pose", self.pose))


@dataclass(frozen=True, kw_only=True)
class Lap(Part, called="lap.{}"):
    """How the planned lap is driven: along ``waypoints``, the corners of a closed path, in order.

    Without them, counterclockwise in the middle of the corridor around the obstacles.
    """

    step: float = bounded(5.0, LENGTH, low=0, above=True)  #: distance of a driving step
    #: angle of a turning step, rad
    turn: float = bounded(math.pi / 12, low=0, high=math.pi, above=True)
    #: 3 or more corners of the closed path; None: around the obstacles
    waypoints: tuple[tuple[float, float], ...] | None = field(default=None, metadata=LENGTH)

    def __post_init__(self) -> None:
        super().__post_init__()
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
class Driver(Part, called="driver.{}"):
    """A driver that knows the true pose and steers back to the planned path at every step."""

    look_ahead: float = bounded(25.0, LENGTH, low=0, above=True)  #: how far along the path it aims
    #: heading error beyond which it turns without driving, rad
    on_the_spot: float = bounded(0.5, low=0, high=math.pi, above=True)


@dataclass(frozen=True, kw_only=True)
class Route(Part, called="route.{}"):
    """A route from a start to a goal instead of the lap, both drawn anew in each episode.

    A given ``start.pose`` or ``goal`` is not drawn.
    """

    goal: tuple[float, float] | None = field(default=None, metadata=LENGTH)  #: its end; None: drawn
    min_length: float = bounded(250.0, LENGTH, low=0)  #: of a drawn route
    max_length: float = bounded(3000.0, LENGTH, low=0, above=True)  #: of a drawn route
    clearance: float = bounded(2.5, LENGTH, low=0)  #: least distance of the rim to walls
    #: distance to walls where there is room
    comfort: float = bounded(40.0, LENGTH, low=0, above=True)
    tolerance: float = bounded(25.0, LENGTH, low=0, above=True)  #: where the goal counts as reached

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.goal is not None:
            x, y = array("route.goal", self.goal, (2,)).tolist()
            object.__setattr__(self, "goal", (x, y))
        if self.min_length > self.max_length:
            raise InputError(
                f"route.min_length is {self.min_length:g}, but must be at most route.max_length, "
                f"{self.max_length:g}."
            )


@dataclass(frozen=True, kw_only=True)
class World:
    """Everything that defines an episode, except its seed.

    Without a driver, the plan is the lap or the route, fixed before the start. The floor plan is
    the map. Clutter, changed walls, people and glass, if any, are not on it, and differ between
    episodes.
    """

    floor_plan: Map
    lidar: Lidar = field(default_factory=Lidar)
    robot: Robot = field(default_factory=Robot)
    noise: MotionNoise = field(default_factory=MotionNoise)
    start: Start = field(default_factory=Start)
    lap: Lap = field(default_factory=Lap)
    driver: Driver | None = None
    route: Route | None = None
    clutter: Clutter | None = None
    changed_walls: ChangedWalls | None = None
    people: People | None = None
    glass: Glass | None = None

    @property
    def differs_from_map(self) -> bool:
        """Whether anything is there, or may be, that is not on the map."""
        return any((self.clutter, self.changed_walls, self.people, self.glass))

    def __post_init__(self) -> None:
        if self.route is not None and self.lap.waypoints is not None:
            raise InputError(
                "a world has a route or lap.waypoints: give only one of them, or "
                'route = "none" for the lap.'
            )
        radius = self.robot.radius
        place = max(self.lidar.places, key=lambda at: math.hypot(*at))
        if math.hypot(*place) > radius:
            name = "a place in lidar.mounts" if self.lidar.mounts else "lidar.mounting"
            raise InputError(
                f"{name} is {place}, {math.hypot(*place):.4g} {self.floor_plan.unit} from the "
                f"robot's centre, but its radius is {radius:g}: give a mounting on the robot, "
                "or a larger robot.radius."
            )

    @cached_property
    def pixel(self) -> float:
        """Length of a pixel of the paper's room in the map's unit."""
        return pixel(self.floor_plan.unit)

    @cached_property
    def skin(self) -> float:
        """Distance at which a robot stops before a contact, so that it can drive away again.

        ``SKIN`` or, in a large room, four steps of float32.
        """
        x0, y0, x1, y1 = self.floor_plan.bounds
        coarse = float(np.spacing(np.float32(2 * max(x1 - x0, y1 - y0))))
        return max(SKIN * self.pixel, 4 * coarse)

    @cached_property
    def reach(self) -> float:
        """A length that no straight drive can have without contact."""
        x0, y0, x1, y1 = self.floor_plan.bounds
        return 2 * (x1 - x0 + y1 - y0)

    @property
    def body(self) -> float:
        """Radius of the disc that touches walls: the robot's, but at least the skin."""
        return max(self.robot.radius, self.skin)

    def changed(self, **parts: Any) -> "World":
        """Return this world with some parts replaced, each by an object or a mapping of changes.

        None leaves a part as it is. A floor plan is always given whole:
        ``{"outer": [...], "obstacles": [...], "unit": "px"}``, ``{"office": {"seed": 3}}``,
        ``{"file": "map.yaml", "unknown": "obstacle"}``, or the path of such a file or of polygons
        in JSON.
        If its unit differs, the parts of this world are converted to it, then changed. In a world
        without a driver, changes apply to ``Driver()``; ``driver="none"`` removes the driver. The
        same holds for all parts that a world may have.
        """
        names = [f.name for f in fields(self)]
        new_parts = {one_of("part of the world", name, names): parts[name] for name in parts}
        new_parts = {name: value for name, value in new_parts.items() if value is not None}
        floor_plan = floor_plan_of(new_parts.pop("floor_plan", self.floor_plan))
        factor = pixel(floor_plan.unit) / self.pixel
        world = replace(self if factor == 1 else scaled(self, factor), floor_plan=floor_plan)
        changes: dict[str, Any] = {}
        for name, value in new_parts.items():
            default = getattr(world, name) or scaled(_OPTIONAL[name](), world.pixel)
            if name not in _OPTIONAL or not isinstance(value, str):
                changes[name] = part(name, type(default), value, default)
            elif value == "none":
                changes[name] = None
            else:
                raise InputError(
                    f"{name} is {value!r}, but must be a {type(default).__name__}, a mapping of "
                    f'changes to it, or "none" for no {name}.'
                )
        return replace(world, **changes)


_OPTIONAL: Mapping[str, Any] = {
    "driver": Driver, "route": Route,
    "clutter": Clutter, "changed_walls": ChangedWalls, "people": People, "glass": Glass,
}  # fmt: skip


PAPER_ROOM = PolygonMap(
    outer=((0, 0), (350, 0), (350, 300), (0, 300)),
    obstacles=(((100, 100), (250, 100), (250, 200), (100, 200)),),
)
#: the worlds of presets, by name
WORLDS = MappingProxyType(
    {
        # one noisy beam ahead, little motion noise, exact start
        "paper": World(floor_plan=PAPER_ROOM),
        # the same, but the start is drawn from the filter's prior
        "matched": World(floor_plan=PAPER_ROOM, start=Start(sd_position=10.0, sd_heading=0.1)),
        # a sharp fan of nine beams
        "sharp": World(
            floor_plan=PAPER_ROOM, lidar=Lidar(beams=9, field_of_view=math.pi / 2, sigma=5.0)
        ),
        # strong motion noise, and a driver that corrects for it from the true pose
        "guided": World(
            floor_plan=PAPER_ROOM,
            noise=MotionNoise(drive=0.2, turn=0.2, drift=0.02),
            start=Start(sd_position=5.0, sd_heading=0.05),
            driver=Driver(),
        ),
    }
)
