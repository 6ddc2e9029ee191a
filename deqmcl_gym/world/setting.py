"""What all episodes of an environment share, whether it runs one room or many."""

import math
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.maps import Lidar
from deqmcl_gym.numerics.types import Singles
from deqmcl_gym.validation import InputError, boolean, integer, one_of
from deqmcl_gym.world.commands import Commands
from deqmcl_gym.world.config import World
from deqmcl_gym.world.course import MAX_STEPS, Course
from deqmcl_gym.world.driver import GuidedPlan
from deqmcl_gym.world.path import Point, Pose, wrapped
from deqmcl_gym.world.plan import FixedPlan, Plan
from deqmcl_gym.world.presets import WORLDS
from deqmcl_gym.world.streams import Stream, episode_stream
from deqmcl_gym.world.task import COLLISION_PENALTY, GOAL_BONUS, once_round

if TYPE_CHECKING:  # OpenCV is loaded by those only who look
    from deqmcl_gym.world.drawing import Drawing

_START_TRIES = 1000
_ARGUMENTS = ("preset", *(own.name for own in fields(World)), "horizon", "ends_at_goal")
_ARGUMENTS += ("observation", "render_mode")


@dataclass(frozen=True)
class Setting:
    """A world with its plan, and the rules of its episodes.

    Attributes:
        world: all parts of the world, as configured.
        course: the lap as planned: path, start and actions.
        plan: what ``info`` shows of the coming actions.
        ends_at_goal: end the episode when the lap is done, even if the plan has steps left.
        observation: what a step shows: "scan", or "dict" for the plan, progress and clock too.
    """

    world: World
    course: Course
    plan: Plan
    ends_at_goal: bool
    observation: str

    @classmethod
    def of(
        cls,
        *,
        preset: str = "paper",
        horizon: int | None = None,
        ends_at_goal: bool = True,
        observation: str = "scan",
        **parts: Any,
    ) -> "Setting":
        """Return the setting that the environment's arguments describe.

        Raises:
            InputError: an unknown argument or key, a bad value, or a lap that cannot be driven.
        """
        for name in parts:
            one_of("argument", name, _ARGUMENTS)
        world = WORLDS[one_of("preset", preset, WORLDS)].changed(**parts)
        course = Course.of(world)
        plan = _plan(world, course, horizon)
        one_of("observation", observation, ("scan", "dict"))
        return cls(world, course, plan, boolean("ends_at_goal", ends_at_goal), observation)

    @cached_property
    def commands(self) -> Commands:
        """What the robot can be told."""
        return Commands(self.world.robot, self.world.floor_plan.unit)

    @cached_property
    def rewards(self) -> tuple[float, float, float]:
        """The goal, what it pays, and what a contact costs, in progress along the path."""
        goal, px = once_round(self.course.path.length, self.world.robot.radius), self.world.pixel
        return goal if self.ends_at_goal else math.inf, GOAL_BONUS * px, COLLISION_PENALTY * px

    @cached_property
    def observation_space(self) -> gym.Space[Any]:
        """All scans of a room; with the plan, progress and clock if these are shown."""
        scans = scan_space(self.world.lidar)
        if self.observation == "scan":
            return scans
        actions, shape = self.commands.space, (self.plan.horizon, 1)
        return gym.spaces.Dict(
            scan=scans,
            plan=gym.spaces.Box(np.tile(actions.low, shape), np.tile(actions.high, shape)),
            progress=gym.spaces.Box(-1.0, 1.0, (1,), np.float32),
            clock=gym.spaces.Box(0.0, 1.0, (1,), np.float32),
        )

    def seen(self, scan: Singles, planned: Singles, progress: Any, share: Any) -> Any:
        """Return an observation of one room or of n, all arrays fresh.

        Args:
            scan: (B,) or (n, B).
            planned: the actions to come, (h, 2) or (n, h, 2).
            progress: along the path since reset, a number or (n,).
            share: of the steps of the plan that are done, a number or (n,).
        """
        if self.observation == "scan":
            return scan.copy()
        laps = np.clip(np.divide(progress, self.course.path.length), -1.0, 1.0)
        return {
            "scan": scan.copy(),
            "plan": planned.copy(),
            "progress": np.asarray(laps, np.float32)[..., None],
            "clock": np.asarray(share, np.float32)[..., None],
        }

    def first_arc(self, start: Point) -> float:
        """Return the arc length at which an episode begins, that of the lap's or near it."""
        course = self.course
        arc, _ = course.path.follow(course.start[:2], start, course.arc)
        return arc

    def start(self, seed: int, number: int) -> Pose:
        """Return where the ``number``-th episode after seeding begins, heading in [-π, π).

        Raises:
            InputError: no start drawn is free.
        """
        x, y, heading = self._drawn_start(seed, number)
        return x, y, heading if -np.pi <= heading < np.pi else wrapped(heading)

    def picture(self, pose: Pose, scan: Singles, step: int) -> NDArray[np.uint8]:
        """Return the world with the robot, its scan and the number of steps, (h, w, 3) RGB."""
        drawing = self.drawing().beams(pose, self.world.lidar.bearings, scan)
        return drawing.robot(pose, self.world.robot.radius).number(step).image

    def drawing(self) -> "Drawing":
        """Begin a picture: walls and lap.

        Raises:
            InputError: the room is too large for one.
        """
        from deqmcl_gym.world.drawing import LIGHT_BLUE, Drawing, View

        corners = self.course.path.corners
        return Drawing(View(self.world.floor_plan)).path([*corners, corners[0]], LIGHT_BLUE)

    def _drawn_start(self, seed: int, number: int) -> Pose:
        start, radius = self.world.start, self.world.body
        if start.sd_position == start.sd_heading == 0.0:
            return self.course.start
        x, y, heading = self.course.start
        rng = episode_stream(seed, number, Stream.START)
        sd = np.array([start.sd_position, start.sd_position, start.sd_heading])
        for _ in range(_START_TRIES):
            dx, dy, turn = (sd * rng.standard_normal(3)).tolist()
            if self.world.floor_plan.free([(x + dx, y + dy)], radius)[0]:
                return x + dx, y + dy, heading + turn
        raise InputError(
            f"none of {_START_TRIES} starts drawn around ({x:g}, {y:g}) is free: give a smaller "
            "start.sd_position."
        )


def scan_space(lidar: Lidar) -> gym.spaces.Box:
    """Return the space of all scans of a lidar."""
    return gym.spaces.Box(0.0, lidar.max_range, (lidar.beams,), np.float32)


def _plan(world: World, course: Course, horizon: int | None) -> Plan:
    if world.driver is not None:
        return GuidedPlan.of(world, world.driver, course, horizon)
    rows = len(course.actions) if horizon is None else horizon
    return FixedPlan(course.actions, integer("horizon", rows, low=1, high=MAX_STEPS))
