"""Carries out the plan that the env shows, whatever the belief."""

from typing import Any

from deqmcl_gym.numerics.types import Reals
from localizers import Belief, RobotModel


class OpenLoop:
    """Takes the first of the planned actions."""

    def __init__(self, robot: RobotModel) -> None:
        del robot

    def plan_at_reset(self, info: dict[str, Any]) -> None:
        """Return None: the plan is the env's."""
        del info

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        """Return the next planned action; the plan is the env's."""
        del belief
        return info["planned_actions"][0], None


AGENT = OpenLoop
