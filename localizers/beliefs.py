"""Ready-made beliefs for plug-ins; what is asked of any: mean pose, best cluster, quality."""

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.maps.clusters import Cluster, best_cluster, mean_pose
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, array, digits, number
from localizers.api import Belief, Points

__all__ = ["Cluster", "PointsBelief", "PoseBelief", "best_cluster", "mean_pose", "quality_of"]


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
        """Copy the poses and weights.

        Args:
            poses: (x, y, θ rad), (n, 3); headings need not be wrapped.
            weights: (n,), 0 or more, with any sum above 0; None: all equal.

        Raises:
            InputError: a wrong shape, no pose, NaN, a negative weight, or only zero weights.
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
