"""The plan that the env shows is carried out; the localizer is shown the one of the first route."""

from typing import Any

import numpy as np

from deqmcl_gym.numerics.types import Reals
from deqmcl_gym.validation import InputError
from localizers import Belief, RobotModel


class OldRoute:
    """Shows the plan for the route that there was at reset; once there is another, what is left.

    So the robot is driven by one who sees where it is, and the dispatcher who tells the localizer
    does not. What is left of his plan is counted off as if it were carried out.
    """

    def __init__(self, robot: RobotModel) -> None:
        del robot

    def plan_at_reset(self, info: dict[str, Any]) -> None:
        """Return None: the plan at reset is the env's."""
        if "route" not in info:
            raise InputError("the agent shows the plan for a route: give a world with a route.")
        self._route = info["route"]

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        """Return the next action planned by the env, and what is left of the plan shown."""
        del belief
        if np.array_equal(info["route"], self._route):
            self._shown: Reals = info["planned_actions"][: info["planned_count"]]
        self._shown = self._shown[1:]
        return info["planned_actions"][0], self._shown


AGENT = OldRoute
