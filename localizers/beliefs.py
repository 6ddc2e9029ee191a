"""Ready-made beliefs, so that a plug-in need not write its own."""

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, array, digits
from localizers.api import Points


class PointsBelief:
    """Weighted poses of the present, such as a cloud of particles or the cells of a grid."""

    def __init__(self, poses: ArrayLike, weights: ArrayLike | None = None) -> None:
        """Copy the poses and weights.

        Args:
            poses: (n, 3); any heading.
            weights: (n,), not negative, of any positive sum; None if all are equal.

        Raises:
            InputError: another shape, no pose, NaN, a negative weight, or weights that are all 0.
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
                "but must be 0 or more, not all 0, and of finite sum."
            )
        self._weights = shares / total

    def points(self, offset: int = 0) -> Points | None:
        """Return poses (n, 3) and weights (n,) with sum 1, fresh; None but for the present."""
        return (self._poses.copy(), self._weights.copy()) if offset == 0 else None


class PoseBelief(PointsBelief):
    """A single pose of the present: all that an estimator without a distribution believes."""

    def __init__(self, pose: ArrayLike) -> None:
        """Copy the pose (x, y, heading)."""
        super().__init__(array("the belief's pose", pose, (3,))[None])
