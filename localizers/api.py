"""The interface of a localizer, its inputs and its belief; ready-made beliefs for plug-ins.

Lengths are in the map's unit (px or m), angles in rad; a pose is (x, y, heading).
"""

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.maps.clusters import Cluster, best_cluster, mean_pose
from deqmcl_gym.numerics import Floats, Reals
from deqmcl_gym.validation import InputError, array, digits, number

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
        """Draw one successor of each state, (d, n): on a map poses, with rows x, y, θ.

        The ``action`` is as in ``Localizer.update``, ``rng`` the only source of randomness.
        """


class Belief(Protocol):
    """What a localizer believes: weighted poses of the present, and of other steps if kept.

    An optional attribute ``quality`` is the confidence that the robot is not lost, in [0, 1]: no
    calibrated probability; see ``quality_of``.
    """

    def points(self, offset: int = 0) -> Points | None:
        """Return poses (n, 3) and weights (n,) of x_{t+offset}, as fresh arrays; None: not held.

        One point if the localizer estimates a single pose; cell centres if it keeps a grid.
        """


@runtime_checkable
class Localizer(Protocol):
    """Estimates a robot's pose from commands, scans and plans. Plug-ins need not inherit it.

    An optional attribute ``own_plans`` is False if a plan that the robot has made from this
    localizer's belief is not to be shown to it: in its place the plan is empty.
    """

    def reset(self, prior: Prior, plan: Reals, rng: np.random.Generator) -> Belief:
        """Start anew from p(x_0) and return the belief at t = 0.

        The planned increments, (h, 2) or (h, 3), are as ``action`` and may be empty; ``rng`` is the
        localizer's only source of randomness.
        """

    def update(self, ranges: Reals, action: Reals, plan: Reals) -> Belief:
        """Return the belief after one step and the scan taken after it, (B,), in the map's unit.

        The action is the increment carried out: the command (distance, turn rad) of a robot that
        turns, then drives ahead, (2,); or what odometry measured, (forward, left, turn rad), (3,):
        a turn, then a translation in the frame after it. (d, φ) is the same as (d, 0, φ). The plan
        has the increments after it, (h, 2) or (h, 3); h shrinks to 0 at the end.
        """


__all__ = ["Cluster", "best_cluster", "mean_pose"]


def quality_of(belief: Belief) -> float | None:
    """Return the confidence of a belief that the robot is not lost, in [0, 1]; None without one.

    It orders beliefs, and is no calibrated probability: on real logs it can be near 1 in a filter
    that is lost.
    """
    quality = getattr(belief, "quality", None)
    return None if quality is None else number("the belief's quality", quality, low=0, high=1)


class PointsBelief:
    """Weighted poses of the present, such as a cloud of particles or the cells of a grid."""

    def __init__(self, poses: ArrayLike, weights: ArrayLike | None = None) -> None:
        """Copy poses (x, y, θ rad), (n, 3), and weights, (n,), with any sum above 0; None: equal.

        Headings need not be wrapped. A wrong shape, no pose, NaN, a negative weight or only zero
        weights raise ``InputError``.
        """
        self._poses = array("the belief's poses", poses, (None, 3))
        n = len(self._poses)
        if n == 0:
            raise InputError("the belief has no poses: give one or more.")
        shares: Floats = np.ones(n)
        if weights is not None:
            shares = array("the belief's weights", weights, (n,))
        total = float(shares.sum())
        if shares.min() < 0 or not 0 < total < np.inf:
            raise InputError(
                f"the belief's weights go from {digits(shares.min())} to {digits(shares.max())}, "
                "but must be 0 or more, not all 0, with a finite sum."
            )
        self._weights = shares / total

    def points(self, offset: int = 0) -> Points | None:
        """Return poses (n, 3) and weights (n,) with sum 1, fresh; None for other offsets."""
        return (self._poses.copy(), self._weights.copy()) if offset == 0 else None


class PoseBelief(PointsBelief):
    """A single pose of the present, for an estimator without a distribution."""

    def __init__(self, pose: ArrayLike) -> None:
        """Copy the pose (x, y, heading)."""
        super().__init__(array("the belief's pose", pose, (3,))[None])
