"""The plan of a driver that knows the true pose: new at every step."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, integer
from deqmcl_gym.world.config import Driver, World
from deqmcl_gym.world.course import MAX_STEPS, Course
from deqmcl_gym.world.path import Pose
from deqmcl_gym.world.path_kernels import roll_out
from deqmcl_gym.world.plan import Actions, FixedPlan, Underway
from deqmcl_gym.world.task_kernels import once_round

_LAPS = 2  # what the driver may take, in steps of the lap as planned


@dataclass(frozen=True)
class GuidedPlan:
    """What a driver would do from the true pose if there were no noise and no walls.

    The driver heads for the point of the path ``look_ahead`` beyond the one nearest to it. It is
    done when it is, along the path, once round but for the robot's radius; on an open path, when
    it is as near to the end as the world's route demands. Noise can bring it off the path, not past
    that end. Where walls hold it up it gives up, after ``limit`` steps.

    Attributes:
        course: the path to follow.
        rules: as :func:`deqmcl_gym.world.path_kernels.roll_out` takes them.
        horizon: h, actions shown ahead.
        limit: the most steps of an episode.
    """

    course: Course
    rules: tuple[float, float, float, float, float, float]
    horizon: int
    limit: int

    @classmethod
    def of(
        cls, world: World, driver: Driver, course: Course, horizon: int | None, begun: int = 0
    ) -> "GuidedPlan":
        """Let ``driver`` drive the course; without a horizon, all of the way is shown.

        Args:
            world: in which it drives.
            driver: who follows the path.
            course: the path.
            horizon: actions shown ahead.
            begun: step of the episode after which it begins.

        Raises:
            InputError: a bad horizon, or even without noise the driver meets a wall or does not
                come round.
        """
        lap, limit = world.lap, min(begun + _LAPS * len(course.actions), MAX_STEPS)
        end, near = once_round(course.path.length, world.robot.radius), -1.0
        if world.route is not None:
            end, near = math.inf, world.route.tolerance
        plan = cls(
            course=course,
            rules=(driver.look_ahead, driver.on_the_spot, lap.step, lap.turn, end, near),
            horizon=integer(
                "horizon", limit if horizon is None else horizon, low=1, high=MAX_STEPS
            ),
            limit=limit,
        )
        if world.route is None:
            _check_drivable(plan, world)
        return plan

    @cached_property
    def actions(self) -> Actions:
        """The lap from the expected start without noise, (T, 2) float32."""
        start, arc = self.course.start, self.course.arc
        planned, count = self._rolled_out(start, arc, 0.0, self.limit, self.limit)
        return planned[:count]

    def after(self, underway: Underway) -> tuple[Actions, int]:
        """Return the next h actions from where the robot truly is; see ``Plan.after``."""
        most = min(self.horizon, self.limit - underway.step)
        return self._rolled_out(underway.pose, underway.arc, underway.way, self.horizon, most)

    def left_as_it_is(self, underway: Underway) -> FixedPlan:
        """Return the whole plan as it is now, to be shown from now on whatever happens."""
        most = self.limit - underway.step
        pose, arc, way = underway.pose, underway.arc, underway.way
        planned, count = self._rolled_out(pose, arc, way, most, most)
        return FixedPlan(planned[:count], self.horizon, begun=underway.step)

    def _rolled_out(
        self, pose: Pose, arc: float, way: float, rows: int, most: int
    ) -> tuple[Actions, int]:
        path = self.course.path
        planned = np.zeros((rows, 2), np.float32)
        actions = planned[:most]
        return planned, roll_out(pose, arc, way, path.edges, path.period, self.rules, actions)


def _check_drivable(plan: GuidedPlan, world: World) -> None:
    actions = plan.actions.astype(np.float64)
    wish = "give another driver.look_ahead, or other lap.waypoints."
    if len(actions) == plan.limit:
        raise InputError(
            f"the driver does not complete the lap in {plan.limit:,} steps, even without noise: "
            f"{wish}"
        )
    points = _points(plan.course.start, actions)
    blocked = world.floor_plan.collides(points[:-1], points[1:], world.body)
    if blocked.any():
        x, y = points[blocked.argmax()]
        raise InputError(f"the driver meets a wall near ({x:g}, {y:g}), even without noise: {wish}")


def _points(start: Pose, actions: Floats) -> Floats:
    """Where a robot without noise comes by, (T + 1, 2)."""
    x, y, heading = start
    headings = heading + np.cumsum(actions[:, 1])
    ways = actions[:, :1] * np.column_stack([arrays.cos(headings), arrays.sin(headings)])
    return np.cumsum(np.vstack([(x, y), ways]), axis=0)
