"""Agent: the interface of whoever drives."""

from typing import Any, Protocol

from deqmcl_gym.numerics.types import Reals
from localizers import Belief


class Agent(Protocol):
    """Chooses actions. Made anew for every episode, by ``AGENT(robot)`` with a ``RobotModel``."""

    def plan_at_reset(self, info: dict[str, Any]) -> Reals | None:
        """Return the plan that the localizer is reset with, (h, 2); None: the one the env shows.

        Args:
            info: of the env at reset, without the truth.
        """
        ...

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        """Return the next action, and the plan after it.

        Args:
            belief: what the localizer believes now.
            info: the env's latest, without the truth.

        Returns:
            action: to be carried out next, (distance px, turn rad).
            plan: actions meant to follow, (h, 2), which the localizer gets with the next scan;
                None: those that the env then shows.
        """
        ...
