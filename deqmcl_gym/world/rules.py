"""What all episodes of an environment share, and the commands that its robots obey."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from operator import le
from typing import TYPE_CHECKING, Any, NotRequired, SupportsFloat, TypedDict

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym import validation
from deqmcl_gym.maps import Box, Lidar, Offices, PolygonMap
from deqmcl_gym.numerics import Bools, Floats, Pose, RoomActions, Singles, arrays
from deqmcl_gym.validation import InputError, boolean, check_arguments, integer, one_of, shown
from deqmcl_gym.world import WORLDS, Robot, Stream, World, episode_stream, extent_of, offices_of
from deqmcl_gym.world.course import MAX_STEPS, Course, centred_heading
from deqmcl_gym.world.driver import FixedPlan, GuidedPlan, Plan
from deqmcl_gym.world.path_kernels import COLLISION_PENALTY, GOAL_BONUS, once_round
from deqmcl_gym.world.route import Journeys

if TYPE_CHECKING:  # OpenCV is only loaded for pictures
    from deqmcl_gym.world.drawing import Drawing, View

_FLOAT32 = np.dtype(np.float32)
_START_TRIES = 1000
_FREE_TRIES = 100_000
_ARGUMENTS = ("preset", "world", *(f.name for f in fields(World)), "horizon", "ends_at_goal")
_ARGUMENTS += ("observation", "plan", "goal", "render_mode")


class Commands:
    """The actions (distance, turn, *heads) that a robot can carry out, in the Box ``space``."""

    def __init__(self, robot: Robot, unit: str, heads: tuple[str, ...] = ()) -> None:
        """Allow distances in [0, max_distance], turns in [-max_turn, max_turn], heads in [0, 1]."""
        self.space = gym.spaces.Box(
            np.array([0.0, -robot.max_turn, *(0.0 for _ in heads)], np.float32),
            np.array([robot.max_distance, robot.max_turn, *(1.0 for _ in heads)], np.float32),
        )
        # Comparing numbers takes a tenth of the time of Box.contains.
        self._low, self._high = self.space.low.tolist(), self.space.high.tolist()
        turn = f"a turn from {self._low[1]:.4g} to {self._high[1]:.4g} rad"
        count = ("two", "three", "four")[len(heads)]
        *parts, last = turn, *(f"{head} from 0 to 1" for head in heads)
        self._allowed = (
            f"{count} numbers: a distance from 0 to {self._high[0]:g} {unit}"
            f"{''.join(f', {part}' for part in parts)} and {last}."
        )

    def checked(self, action: Any) -> RoomActions:
        """Return an action as a fresh array, (2,) float32, or longer by the heads."""
        command = _as_float32(action)
        if command is not None and command.shape == self.space.shape:
            values = command.tolist()
            if all(map(le, self._low, values)) and all(map(le, values, self._high)):
                return command
        raise InputError(f"the action is {action!r}, but must be {self._allowed}")

    def checked_each(self, actions: Any, resting: Bools) -> RoomActions:
        """Return one action for each room as a fresh array, (n, 2) float32, or longer by the heads.

        Actions of rooms that are ``resting`` (n,) are ignored, but must be numbers.
        """
        commands = _as_float32(actions)
        shape = resting.size, *self.space.shape
        if commands is None or commands.shape != shape:
            given = repr(actions) if commands is None else f"of shape {commands.shape}"
            raise InputError(
                f"the actions are {given}, but must be numbers of shape {shape}, for each room "
                f"{self._allowed}"
            )
        inside = (commands >= self.space.low) & (commands <= self.space.high)
        outside = ~(inside.all(axis=1) | resting)
        if outside.any():
            room = outside.argmax()
            try:
                self.checked(commands[room])
            except InputError as refused:
                raise InputError(f"in room {room}, {refused}") from None
        return commands

    def checked_plan(self, what: str, actions: ArrayLike) -> RoomActions:
        """Return actions as a fresh array, (k, 2) float32; [] has none."""
        none = isinstance(actions, list | tuple) and not actions
        plan = validation.array(what, np.empty((0, 2)) if none else actions, (None, 2))
        for row in plan:
            self.checked(row)
        return plan.astype(np.float32)


def _as_float32(action: Any) -> RoomActions | None:
    """Return a fresh array, or None for words, truth values, complex numbers and ragged lists."""
    if type(action) is np.ndarray and action.dtype is _FLOAT32:  # what the space asks for
        return action.copy()
    try:
        values = np.asarray(action)
    except ValueError:
        return None
    with np.errstate(over="ignore"):
        real = values.dtype.kind in "fiu" and not isinstance(action, np.ma.MaskedArray)
        return values.astype(np.float32) if real else None


StepResult = tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]  # as Gymnasium's envs return


class RoomInfo(TypedDict):
    """The ``info`` channel: fresh arrays of fixed shape and NumPy numbers, which libraries stack.

    No observation has one of the keys. Inside wrappers of actions, and heads, ``command`` is not
    the learner's action.
    """

    planned_actions: Singles  #: after this step, zero-padded, (h, 2): distance, turn
    planned_count: np.int64  #: rows of ``planned_actions`` that are actions
    command: Singles  #: carried out, before noise and contact, (2,); zeros at reset
    collided: np.float64  #: whether a wall stopped the step, 1 or 0
    is_success: np.float64  #: whether it ended lap or route at the goal, 1 or 0
    truth: Floats  #: pose (x, y, θ), (3,); for scoring only, not for estimators
    goal: NotRequired[Floats]  #: (x, y), (2,); with a route, unless observed
    building: NotRequired[np.int64]  #: seed of the office, if drawn


def check_options(options: object) -> None:
    """Refuse options of ``reset`` that are no mapping; keys of others, as wrappers', are theirs."""
    if options is not None and not isinstance(options, Mapping):
        raise InputError(f"options is {options!r}, but must be None or a mapping.")


_kept_lap = lru_cache(maxsize=8)(Course.of)  # a sweep makes the same room for every trial


@dataclass(frozen=True)
class RoomRules:
    """A world, and the rules of its episodes."""

    world: World  # as configured
    horizon: int | None  # how many planned actions ``info`` shows; None: all
    ends_at_goal: bool  # when lap or route is done, even if the plan has steps left
    observation: str  # "scan", or "dict" for scan, plan, progress, clock and goal
    shows_plan: bool = True  # in dicts
    goal: str = "map"  # of a route, in dicts: "map", x and y, or "relative" to the true pose
    offices: Offices | None = None  # of which each episode draws one
    extent: Box | None = None  # (x0, y0, x1, y1) of goals in observations; None: the map's

    @classmethod
    def of(
        cls,
        *,
        preset: str = "paper",
        world: World | None = None,
        horizon: int | None = None,
        ends_at_goal: bool = True,
        observation: str = "scan",
        plan: bool = True,
        goal: str = "map",
        **parts: Any,
    ) -> "RoomRules":
        """Return the rules that the environment's arguments describe."""
        check_arguments(parts, _ARGUMENTS)
        offices = offices_of(raw_map := parts.get("floor_plan"))
        if offices is not None:
            parts["floor_plan"] = offices.map(offices.seeds[0])
        if world is not None and not isinstance(world, World):
            raise InputError(f"world is {shown(world)}, but must be a World: see deqmcl_gym.world.")
        world = world or WORLDS[one_of("preset", preset, WORLDS)]
        world = world.changed(**parts)
        if offices is not None and world.route is None:
            raise InputError(
                "floor_plan.office has seeds, but a lap is that of one building: give a route, "
                "such as route={}, or a seed."
            )
        rows = None if horizon is None else integer("horizon", horizon, low=1, high=MAX_STEPS)
        one_of("observation", observation, ("scan", "dict"))
        ends, extent = boolean("ends_at_goal", ends_at_goal), extent_of(raw_map, world.floor_plan)
        shows_plan = boolean("plan", plan)
        one_of("goal", goal, ("map", "relative"))
        if observation == "scan" and not shows_plan:
            raise InputError('plan is False, but it is part of observation="dict" only: give that.')
        if goal == "relative" and (observation == "scan" or world.route is None):
            raise InputError(
                'goal is "relative", but only the observation "dict" of a world with a route has a '
                "goal: take Journey-v1."
            )
        rules = cls(world, rows, ends, observation, shows_plan, goal, offices, extent)
        for part in (world.changed_walls, world.glass):
            if part is not None:
                part.check(world.floor_plan)
        if rules.journeys is None:
            _ = rules.plan  # refuses laps that cannot be driven
        else:
            rules.journeys.check()
            if observation == "dict" and rows is None:
                raise InputError(
                    'observation is "dict" and there is a route, whose plans differ in length: '
                    "give a horizon, such as 50."
                )
        return rules

    @cached_property
    def journeys(self) -> Journeys | None:
        """The courses of a world with a route; None if it has a lap."""
        return None if self.world.route is None else Journeys(self.world)

    @cached_property
    def course(self) -> Course:
        """The lap as planned: path, start and actions."""
        kept = isinstance(self.world.floor_plan, PolygonMap)  # others may change, or have no hash
        return _kept_lap(self.world) if kept else Course.of(self.world)

    @cached_property
    def plan(self) -> Plan:
        """The plan of the lap, from which ``info`` shows the coming actions."""
        return self.plan_for(self.course)

    @property
    def rows(self) -> int:
        """Number of planned actions that are shown; of routes, only with a horizon."""
        return self.horizon or self.plan.horizon

    def of_episode(self, seed: int, number: int) -> tuple["RoomRules", int | None]:
        """Return the rules of an episode, and the seed of the office that it draws, if it does."""
        if self.offices is None:
            return self, None
        building = self.offices.drawn(episode_stream(seed, number, Stream.BUILDING))
        world = replace(self.world, floor_plan=self.offices.map(building))
        return replace(self, world=world), building

    def plan_for(self, course: Course, begun: int = 0) -> Plan:
        """Return the plan for a course that begins after the step ``begun`` of an episode."""
        world = self.world
        if world.driver is not None:
            return GuidedPlan.of(world, world.driver, course, self.horizon, begun)
        return FixedPlan(course.actions, self.horizon or len(course.actions))

    @cached_property
    def commands(self) -> Commands:
        """The commands that the robot can carry out."""
        return Commands(self.world.robot, self.world.floor_plan.unit)

    @cached_property
    def rewards(self) -> tuple[float, float, float, float]:
        """Progress at the goal, bonus there, penalty for a contact; how near a route's goal is."""
        px, goal, near, route = self.world.pixel, math.inf, -1.0, self.world.route
        if self.ends_at_goal and route is not None:
            near = route.tolerance
        elif self.ends_at_goal:
            goal = once_round(self.course.path.length, self.world.robot.radius)
        return goal, GOAL_BONUS * px, COLLISION_PENALTY * px, near

    @cached_property
    def observation_space(self) -> gym.Space[Any]:
        """The space of scans, or of dicts with plan, progress and clock too."""
        scans = scan_space(self.world.lidar)
        if self.observation == "scan":
            return scans
        actions, shape = self.commands.space, (self.rows, 1)
        parts: dict[str, Any] = {}
        if self.world.route is not None:
            extent = self.extent or self.world.floor_plan.bounds
            parts["goal"] = within(extent) if self.goal == "map" else relative_space(extent)
        if self.shows_plan:
            low, high = np.tile(actions.low, shape), np.tile(actions.high, shape)
            parts["plan"] = gym.spaces.Box(low, high)
        return gym.spaces.Dict(
            scan=scans,
            **parts,
            progress=gym.spaces.Box(-1.0, 1.0, (1,), np.float32),
            clock=gym.spaces.Box(0.0, 1.0, (1,), np.float32),
        )

    def seen(
        self,
        scan: Singles,
        planned: Singles,
        covered: Any,
        elapsed: Any,
        goal: ArrayLike | None = None,
        pose: ArrayLike | None = None,
    ) -> Any:
        """Return an observation "dict" of one room or of n, all arrays fresh.

        Scans are (B,) or (n, B), planned actions (h, 2) or (n, h, 2), goals of routes (2,) or
        (n, 2), true poses (3,) or (n, 3). ``covered`` and ``elapsed`` are shares of the path and
        of the plan's steps.
        """
        parts: dict[str, Any] = {"plan": planned.copy()} if self.shows_plan else {}
        if goal is not None:
            target = goal if self.goal == "map" else relative_to(pose, goal)
            parts["goal"] = np.array(target, np.float32)
        return {
            "scan": scan.copy(),
            **parts,
            "progress": np.asarray(np.clip(covered, -1.0, 1.0), np.float32)[..., None],
            "clock": np.asarray(elapsed, np.float32)[..., None],
        }

    def start(self, course: Course, seed: int, number: int) -> Pose:
        """Return the true start of the ``number``-th episode after seeding, heading in [-π, π)."""
        x, y, heading = course.start
        start = self.world.start
        if not start.sd_position == start.sd_heading == 0.0:
            rng = episode_stream(seed, number, Stream.START)
            sd = np.array([start.sd_position, start.sd_position, start.sd_heading])
            for _ in range(_START_TRIES):
                dx, dy, turn = (sd * rng.standard_normal(3)).tolist()
                if self.world.floor_plan.free([(x + dx, y + dy)], self.world.body)[0]:
                    break
            else:
                raise InputError(
                    f"none of {_START_TRIES} starts drawn around ({x:g}, {y:g}) is free: give a "
                    "smaller start.sd_position."
                )
            x, y, heading = x + dx, y + dy, heading + turn
        return x, y, heading if -np.pi <= heading < np.pi else centred_heading(heading)

    def elsewhere(self, course: Course, rng: np.random.Generator) -> Pose:
        """Draw a free pose: anywhere for a lap; for a route, as its start is drawn."""
        if self.journeys is not None and course.goal is not None:
            return self.journeys.elsewhere(course.goal, rng)
        x0, y0, x1, y1 = self.world.floor_plan.bounds
        for _ in range(_FREE_TRIES):
            x, y = rng.uniform((x0, y0), (x1, y1)).tolist()
            if self.world.floor_plan.free([(x, y)], self.world.body)[0]:
                return x, y, float(rng.uniform(-np.pi, np.pi))
        raise InputError(
            f"none of {_FREE_TRIES:,} poses drawn for the kidnapping is free: give a pose."
        )

    def picture(
        self, ground: "Drawing", course: Course, pose: Pose, scan: Singles, step: int
    ) -> NDArray[np.uint8]:
        """Draw path, robot, scan and number of steps onto ``ground``; return it, (h, w, 3) RGB."""
        from deqmcl_gym.world.drawing import LIGHT_BLUE

        lidar = self.world.lidar
        ground.path(course.path.outline, LIGHT_BLUE)
        if course.goal is not None:
            ground.points([course.goal], LIGHT_BLUE, 9)
        ground.beams(lidar.rays(pose), scan)
        return ground.robot(pose, self.world.robot.radius).number(step).image

    @cached_property
    def view(self) -> "View":
        """How the map is seen in pictures."""
        from deqmcl_gym.world.drawing import View

        return View(self.world.floor_plan)


def within(extent: Box) -> gym.spaces.Box:
    """Return the space of positions (x, y) in (x0, y0, x1, y1)."""
    x0, y0, x1, y1 = extent
    return gym.spaces.Box(np.array([x0, y0], np.float32), np.array([x1, y1], np.float32))


def relative_space(extent: Box) -> gym.spaces.Box:
    """Return the space of distance and bearing of positions in (x0, y0, x1, y1) from within."""
    x0, y0, x1, y1 = extent
    low, high = np.array([[0.0, -np.pi], [math.hypot(x1 - x0, y1 - y0), np.pi]], np.float32)
    return gym.spaces.Box(low, high)


def relative_to(pose: Any, goal: Any) -> Floats:
    """Return distance and bearing, in [-π, π], of goals (..., 2) from poses (..., 3)."""
    off = np.asarray(goal, np.float64) - np.asarray(pose, np.float64)[..., :2]
    distance = np.sqrt((off**2).sum(axis=-1))
    ahead = arrays.arctan2(off[..., 1], off[..., 0]) - np.asarray(pose, np.float64)[..., 2]
    return np.stack([distance, arrays.wrapped(ahead)], axis=-1)


def scan_space(lidar: Lidar) -> gym.spaces.Box:
    """Return the space of all scans of a lidar; a lost beam reads +inf."""
    most = np.inf if lidar.loses else lidar.max_range
    return gym.spaces.Box(0.0, most, (lidar.beams,), np.float32)
