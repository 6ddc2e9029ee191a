"""Follows the dispatcher's route as shown at reset, on the localizer's estimate."""

from typing import Any

import numpy as np

from benchmarks.agents.to_goal import ToGoal
from deqmcl_gym.world.course import Course


class OnRoute(ToGoal):
    """Begins on the route that the env shows at reset; off it, it plans its own way to the goal.

    The localizer is reset with the plan of the dispatcher, who knew where the robot was; after that
    it is told what the agent plans on the estimate.
    """

    def plan_at_reset(self, info: dict[str, Any]) -> None:
        """Return None: the plan at reset is the env's."""
        super().plan_at_reset(info)
        corners = np.array(info["route"])
        self.follow(Course.along(corners, (*corners[0].tolist(), 0.0), self._world))


AGENT = OnRoute
