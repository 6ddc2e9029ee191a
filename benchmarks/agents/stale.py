"""The plan that the env shows is carried out; the localizer is shown that of another start."""

from typing import Any

import numpy as np

from deqmcl_gym.numerics.types import Reals
from localizers import Belief, RobotModel

_AHEAD = 8  # the other start is an eighth of the plan ahead


class Stale:
    """Shows the plan of the start as one would who had started farther on, and never anew."""

    def __init__(self, robot: RobotModel) -> None:
        del robot

    def plan_at_reset(self, info: dict[str, Any]) -> Reals:
        """Return the plan from the other start, all of it."""
        planned = info["planned_actions"][: info["planned_count"]]
        self._rest: Reals = np.roll(planned, -(len(planned) // _AHEAD), axis=0)
        return self._rest

    def act(self, belief: Belief, info: dict[str, Any]) -> tuple[Reals, Reals | None]:
        """Return the next action planned by the env, and what is left of the other plan."""
        del belief
        self._rest = self._rest[1:]
        return info["planned_actions"][0], self._rest


AGENT = Stale
