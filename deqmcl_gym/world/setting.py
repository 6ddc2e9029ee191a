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
from deqmcl_gym.world.journey import Journeys
from deqmcl_gym.world.path import Point, Pose, wrapped
from deqmcl_gym.world.plan import FixedPlan, Plan
from deqmcl_gym.world.presets import WORLDS
from deqmcl_gym.world.streams import Stream, episode_stream

if TYPE_CHECKING:  # OpenCV is loaded by those only who look
    from deqmcl_gym.world.drawing import Drawing

COLLISION_PENALTY = 10.0  # px of progress

_START_TRIES = 1000
_FREE_TRIES = 100_000


@dataclass(frozen=True)
class Setting:
    """A world, and the rules of its episodes.

    Attributes:
        world: all parts of the world, as configured.
        horizon: how many planned actions ``info`` shows; None: all.
        ends_at_goal: end the episode when lap or route is done, even if the plan has steps left.
    """

    world: World
    horizon: int | None
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
        rows = None if horizon is None else integer("horizon", horizon, low=1, high=MAX_STEPS)
        setting = cls(world, rows, boolean("ends_at_goal", ends_at_goal))
        if setting.journeys is None:
            _ = setting.plan  # refuses what cannot be driven
        else:
            setting.journeys.check()
        return setting

    @cached_property
    def journeys(self) -> Journeys | None:
        """The ways of a world with a route; None if it has a lap."""
        return None if self.world.route is None else Journeys(self.world)

    @cached_property
    def course(self) -> Course:
        """The lap as planned: path, start and actions."""
        return Course.of(self.world)

    @cached_property
    def plan(self) -> Plan:
        """What ``info`` shows of the coming actions of the lap."""
        return self.plan_for(self.course)

    def begun(self, seed: int, number: int) -> tuple[Course, Plan]:
        """Return what is planned for the ``number``-th episode after seeding.

        Raises:
            InputError: no way was found.
        """
        if self.journeys is None:
            return self.course, self.plan
        course = self.journeys.drawn(seed, number)
        return course, self.plan_for(course)

    def plan_for(self, course: Course, begun: int = 0) -> Plan:
        """Return the plan for a course that begins after the step ``begun`` of an episode."""
        world = self.world
        if world.driver is not None:
            return GuidedPlan.of(world, world.driver, course, self.horizon, begun)
        return FixedPlan(course.actions, self.horizon or len(course.actions))

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

    def first_arc(self, course: Course, start: Point) -> float:
        """Return the arc length at which an episode begins, that of the course's or near it."""
        arc, _ = course.path.follow(course.start[:2], start, course.arc)
        return arc

    def start(self, course: Course, seed: int, number: int) -> Pose:
        """Return where the ``number``-th episode after seeding begins, heading in [-π, π).

        Raises:
            InputError: no start drawn is free.
        """
        x, y, heading = self._drawn_start(course, seed, number)
        return x, y, heading if -np.pi <= heading < np.pi else wrapped(heading)

    def elsewhere(self, course: Course, rng: np.random.Generator) -> Pose:
        """Draw a free pose: anywhere on a lap, on a route as its start is drawn.

        Raises:
            InputError: none was found.
        """
        if self.journeys is not None and course.goal is not None:
            return self.journeys.elsewhere(course.goal, rng)
        x0, y0, x1, y1 = self.world.floor_plan.bounds
        for _ in range(_FREE_TRIES):
            x, y = rng.uniform((x0, y0), (x1, y1)).tolist()
            if self.world.floor_plan.free([(x, y)], self.world.body)[0]:
                return x, y, float(rng.uniform(-np.pi, np.pi))
        raise InputError(
            f"none of {_FREE_TRIES:,} poses drawn for the kidnapping is free: give it a pose."
        )

    def picture(self, course: Course, pose: Pose, scan: Singles, step: int) -> NDArray[np.uint8]:
        """Return the world with the robot, its scan and the number of steps, (h, w, 3) RGB."""
        drawing = self.drawing(course).beams(pose, self.world.lidar.bearings, scan)
        return drawing.robot(pose, self.world.robot.radius).number(step).image

    def drawing(self, course: Course | None = None) -> "Drawing":
        """Begin a picture: walls, and the path if there is one.

        Raises:
            InputError: the room is too large for one.
        """
        from deqmcl_gym.world.drawing import LIGHT_BLUE, Drawing, View

        drawing = Drawing(View(self.world.floor_plan))
        if course is None:
            return drawing
        drawing.path(course.path.outline, LIGHT_BLUE)
        return drawing if course.goal is None else drawing.points([course.goal], LIGHT_BLUE, 9)

    def _drawn_start(self, course: Course, seed: int, number: int) -> Pose:
        start, radius = self.world.start, self.world.body
        if start.sd_position == start.sd_heading == 0.0:
            return course.start
        x, y, heading = course.start
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
