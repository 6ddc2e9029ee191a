"""The interface of a localizer: its inputs and its belief.

Lengths are in the map's unit (px or m), angles in rad; a pose is (x, y, heading).
"""

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics.types import Floats, Reals

Points = tuple[Reals, Floats]


class Prior(Protocol):
    """p(x_0), what is known of the pose before the first step."""

    @property
    def mean(self) -> tuple[float, float, float] | None:
        """Expected pose (x, y, θ rad); None if no single pose is representative."""

    def sample(self, n: int, rng: np.random.Generator) -> Floats:
        """Draw n poses, (n, 3)."""

    def log_density(self, poses: Floats) -> Floats:
        """Log-density of poses (n, 3), (n,)."""


class Motion(Protocol):
    """p(x_t | x_{t-1}, a_t)."""

    def sample(
        self, states: NDArray[Any], action: Floats, rng: np.random.Generator
    ) -> NDArray[Any]:
        """Draw one successor of each state.

        Args:
            states: columns, (d, n): poses with rows x, y, θ on a map.
            action: as in ``Localizer.update``.
            rng: the only source of randomness.

        Returns:
            (d, n).
        """


class Belief(Protocol):
    """What a localizer believes: weighted poses of the present, and of other steps if kept.

    An optional attribute ``quality`` is the confidence that the robot is not lost, in [0, 1]: no
    calibrated probability; see ``quality_of``.
    """

    def points(self, offset: int = 0) -> Points | None:
        """Return poses (n, 3) and weights (n,) of x_{t+offset}, as fresh arrays.

        One point if the localizer estimates a single pose; cell centres if it keeps a grid. None
        for an offset it does not hold.
        """


@runtime_checkable
class Localizer(Protocol):
    """Estimates a robot's pose from commands, scans and plans. Plug-ins need not inherit it.

    An optional attribute ``own_plans`` is False if a plan that the robot has made from this
    localizer's belief is not to be shown to it: in its place the plan is empty.
    """

    def reset(self, prior: Prior, plan: Reals, rng: np.random.Generator) -> Belief:
        """Start anew and return the belief at t = 0.

        Args:
            prior: p(x_0).
            plan: the planned increments, (h, 2) or (h, 3), as ``action``; may be empty.
            rng: the localizer's only source of randomness.
        """

    def update(self, ranges: Reals, action: Reals, plan: Reals) -> Belief:
        """Return the belief after one step.

        Args:
            ranges: the scan taken after the step, (B,), in the map's unit.
            action: the increment carried out: the command (distance, turn rad) of a robot that
                turns, then drives ahead, (2,); or what odometry measured, (forward, left, turn
                rad), (3,): a turn, then a translation in the frame after it. (d, φ) is the same
                as (d, 0, φ).
            plan: the increments planned after it, (h, 2) or (h, 3); h shrinks to 0 at the end.
        """
