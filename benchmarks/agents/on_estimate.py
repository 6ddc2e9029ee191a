"""Drives the lap, and plans it, from where the localizer believes the robot is."""

from typing import Any

import numpy as np

from deqmcl_gym.numerics.types import Reals
from deqmcl_gym.world.config import WORLDS, Driver
from deqmcl_gym.world.course import Course, Pose
from deqmcl_gym.world.driver import GuidedPlan
from localizers import Belief, RobotModel, mean_pose

_HORIZON = 40  # actions planned


class OnEstimate:
    """The driver of ``guided``, on the mean of the belief instead of the true pose.

    It takes the lap in mid-corridor of the robot's map. What comes at the end of the lap is left
    to the env: where its plan is used up the episode ends.
    """

    def __init__(self, robot: RobotModel) -> None:
        world = WORLDS["guided"].changed(
            floor_plan=robot.floor_plan, robot={"radius": robot.radius}
        )
        self._path = Course.of(world).path
        self._plan = GuidedPlan.of(world, world.driver or Driver(), Course.of(world), _HORIZON)
        self.step, self.way = 0, 0.0
        self.pose: Pose = (0.0, 0.0, 0.0)
        self.arc = 0.0

    def plan_at_reset(self, info: dict[str, Any]) -> Reals:
        """Return no plan: nothing is believed yet."""
        return np.empty((0, 2), np.float32)

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        """Return the next action of a plan from the mean pose, and the rest of that plan."""
        points = belief.points()
        assert points is not None, "a belief has points of the present"
        self.pose = mean_pose(*points)
        self.arc = self._path.arc(self.pose[:2])
        planned, count = self._plan.after(self)
        return planned[0], planned[1 : max(count, 1)]


AGENT = OnEstimate
