"""What an agent is: whoever drives."""

from typing import Any, Protocol

from deqmcl_gym.numerics.types import Reals
from localizers import Belief


class Agent(Protocol):
    """Chooses actions. Made anew for every episode, by ``AGENT(robot)`` with a ``RobotModel``.

    One that plans by itself may have ``plan_at_reset(info)``: the plan that the localizer is reset
    with, in place of the one that the env shows.
    """

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        """Return the next action, and the plan after it.

        Args:
            belief: what the localizer believes now.
            info: what the env told last, without the truth.

        Returns:
            action: to be carried out next, (distance px, turn rad).
            plan: actions meant to follow, (h, 2), of which the localizer is told with the next
                scan; None: those that the env then shows.
        """
        ...
