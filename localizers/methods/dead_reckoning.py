"""x_t = x_{t-1} ⊕ a_t from the prior's mean: no scan, no map, no noise. The baseline to beat."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError
from localizers.api import Prior, RobotModel, checked_action, checked_plan, require_reset


@dataclass(frozen=True)
class _Track:
    """One pose per step: those driven, then those planned."""

    poses: Floats
    present: int

    def points(self, offset: int = 0) -> tuple[Floats, Floats] | None:
        index = self.present + offset
        if not 0 <= index < len(self.poses):
            return None
        return self.poses[index : index + 1].copy(), np.ones(1)


class DeadReckoning:
    """Integrates the commands from the prior's mean, and the plan beyond the present."""

    def __init__(self) -> None:
        self._driven: list[tuple[float, float, float]] | None = None

    def reset(self, prior: Prior, plan: ArrayLike, rng: np.random.Generator) -> _Track:
        """Start at the prior's mean; see ``Localizer.reset``."""
        if prior.mean is None:
            raise InputError(
                f"the prior is {prior!r}, but dead reckoning needs a mean to start from: give a "
                "GaussianPrior, or another localizer."
            )
        return self._followed([prior.mean], plan)

    def update(self, ranges: ArrayLike, action: ArrayLike, plan: ArrayLike) -> _Track:
        """Add one command; see ``Localizer.update``."""
        driven = require_reset(self._driven)
        return self._followed([*driven, _moved(driven[-1], checked_action(action))], plan)

    def _followed(self, driven: list[tuple[float, float, float]], plan: ArrayLike) -> _Track:
        poses = list(driven)
        for action in checked_plan(plan):
            poses.append(_moved(poses[-1], action))
        self._driven = driven  # only now: a refused plan changes nothing
        return _Track(np.array(poses), len(driven) - 1)


def dead_reckoning(robot: RobotModel) -> DeadReckoning:
    """Return dead reckoning; it needs nothing of the robot."""
    del robot
    return DeadReckoning()


def _moved(pose: tuple[float, float, float], action: Floats) -> tuple[float, float, float]:
    x, y, heading = pose
    distance, turn = action.tolist()
    heading += turn
    return x + distance * math.cos(heading), y + distance * math.sin(heading), heading
