"""What all episodes of an environment share, whether it runs one room or many."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

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

if TYPE_CHECKING:  # OpenCV is loaded by those only who look
    from deqmcl_gym.world.drawing import Drawing

COLLISION_PENALTY = 10.0  # px of progress

_START_TRIES = 1000


@dataclass(frozen=True)
class Setting:
    """A world with its plan, and the rules of its episodes.

    Attributes:
        world: all parts of the world, as configured.
        course: the lap as planned: path, start and actions.
        plan: what ``info`` shows of the coming actions.
        ends_at_goal: end the episode when the lap is done, even if the plan has steps left.
    """

    world: World
    course: Course
    plan: Plan
    ends_at_goal: bool

    @classmethod
    def of(
        cls,
        *,
        preset: str = "paper",
        horizon: int | None = None,
        ends_at_goal: bool = True,
        **parts: Any,
    ) -> "Setting":
        """Return the setting that the environment's arguments describe.

        Raises:
            InputError: an unknown part or key, a bad value, or a lap that cannot be driven.
        """
        world = WORLDS[one_of("preset", preset, WORLDS)].changed(**parts)
        course = Course.of(world)
        plan = _plan(world, course, horizon)
        return cls(world, course, plan, boolean("ends_at_goal", ends_at_goal))

    @cached_property
    def commands(self) -> Commands:
        """What the robot can be told."""
        return Commands(self.world.robot, self.world.floor_plan.unit)

    @cached_property
    def penalty(self) -> float:
        """What a contact costs, in progress along the path."""
        return COLLISION_PENALTY * self.world.pixel

    @cached_property
    def once_round(self) -> float:
        """Progress along the path from which on a robot back at its start has done the lap."""
        length = self.course.path.length
        return length - min(length / 2, 4 * self.world.robot.radius)

    @cached_property
    def observation_space(self) -> gym.Space[Singles]:
        """All scans of a room."""
        lidar = self.world.lidar
        return gym.spaces.Box(0.0, lidar.max_range, (lidar.beams,), np.float32)

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


def _plan(world: World, course: Course, horizon: int | None) -> Plan:
    if world.driver is not None:
        return GuidedPlan.of(world, world.driver, course, horizon)
    rows = len(course.actions) if horizon is None else horizon
    return FixedPlan(course.actions, integer("horizon", rows, low=1, high=MAX_STEPS))
