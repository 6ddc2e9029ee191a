"""x_t = x_{t-1} ⊕ a_t from the prior's mean: no scan, no map, no noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics.elementary import cos64, sin64
from deqmcl_gym.numerics.types import Floats, Pose
from deqmcl_gym.validation import InputError
from localizers.api import Prior
from localizers.inference.bayes_filter import (
    checked_action,
    checked_plan,
    checked_rng,
    require_reset,
)
from localizers.models.robot import RobotModel

_KEPT = 10_000  # poses, at least


@dataclass(frozen=True)
class _Track:
    """The last poses, a list that later steps append to, and the plan from the present on."""

    driven: list[Pose]
    present: int
    plan: Floats

    def points(self, offset: int = 0) -> tuple[Floats, Floats] | None:
        index = self.present + offset
        if not 0 <= index <= self.present + len(self.plan):
            return None
        pose = self.driven[min(index, self.present)]
        for action in self.plan[: max(offset, 0)].tolist():
            pose = _moved(pose, *action)
        return np.array([pose]), np.ones(1)


class DeadReckoning:
    """Integrates the commands from the prior's mean, and the plan up to the offset asked for."""

    def __init__(self) -> None:
        self._driven: list[Pose] | None = None

    def reset(self, prior: Prior, plan: ArrayLike, rng: np.random.Generator) -> _Track:
        """Start at the prior's mean; see ``Localizer.reset``."""
        checked_rng(rng)
        if (mean := getattr(prior, "mean", None)) is None:
            raise InputError(
                f"the prior is a {type(prior).__name__} without a mean, but dead reckoning needs "
                "one to start from: give a GaussianPrior, or use another localizer."
            )
        track = _Track([mean], 0, checked_plan(plan))
        self._driven = track.driven
        return track

    def update(self, ranges: ArrayLike, action: ArrayLike, plan: ArrayLike) -> _Track:
        """Add one command; see ``Localizer.update``."""
        driven = require_reset(self._driven)
        command, ahead = checked_action(action), checked_plan(plan)
        if len(driven) >= 2 * _KEPT:
            self._driven = driven = driven[-_KEPT:]
        driven.append(_moved(driven[-1], *command.tolist()))
        return _Track(driven, len(driven) - 1, ahead)


def dead_reckoning(robot: RobotModel) -> DeadReckoning:
    """Return dead reckoning; it does not use the robot model."""
    del robot
    return DeadReckoning()


def _moved(pose: Pose, forward: float, left: float, turn: float) -> Pose:
    x, y, heading = pose
    heading += turn
    cosine, sine = cos64(heading), sin64(heading)
    return x + (forward * cosine - left * sine), y + (forward * sine + left * cosine), heading
