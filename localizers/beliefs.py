"""Ready-made beliefs for plug-ins; what is asked of any: mean pose, best cluster, quality."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Reals
from deqmcl_gym.validation import InputError, array, digits, number
from localizers.api import Belief, Points

CELL = 50.0  # px: 1 m
SECTORS = 12  # of 30°
_COUNTED = 2**20  # cells whose weights are counted in one table


def mean_pose(poses: Reals, weights: Floats) -> tuple[float, float, float]:
    """Weighted mean of poses (n, 3), the heading as the direction of the mean (cos θ, sin θ)."""
    x, y, heading = np.asarray(poses, dtype=np.float64).T
    sine, cosine = (weights * arrays.sin(heading)).sum(), (weights * arrays.cos(heading)).sum()
    return (
        float((weights * x).sum()),
        float((weights * y).sum()),
        float(arrays.arctan2(sine, cosine)),
    )


def quality_of(belief: Belief) -> float | None:
    """Return P(not lost | o_{1:t}) of a belief, in [0, 1]; None if it has none."""
    quality = getattr(belief, "quality", None)
    return None if quality is None else number("the belief's quality", quality, low=0, high=1)


@dataclass(frozen=True)
class Cluster:
    """Neighbouring points of a belief.

    Attributes:
        mean: their mean pose (x, y, θ rad).
        share: their share of the belief's weight.
    """

    mean: tuple[float, float, float]
    share: float


def best_cluster(poses: Reals, weights: Floats, *, unit: str) -> Cluster:
    """Return the points in the heaviest cell, 1 m × 1 m × 30°, and in the 26 around it.

    The mean of two distant places is neither, so every method is scored by this rule as well. Of
    equally heavy cells the first in the order of x, y, heading is taken.

    Args:
        poses: (n, 3).
        weights: (n,), with sum 1.
        unit: of the map, "px" or "m"; 1 m is 50 px.
    """
    at = np.ascontiguousarray(np.asarray(poses).T, dtype=np.float64)
    metre = CELL * pixel(unit)
    column, row = np.floor(at[0] / metre), np.floor(at[1] / metre)  # whole, as float64
    turned = (arrays.wrapped(at[2]) + np.pi) * (SECTORS / (2 * np.pi))
    sector = np.floor(turned).astype(np.int64) % SECTORS
    column -= column.min()
    row -= row.min()
    if (column.max() + 1) * (row.max() + 1) * SECTORS <= _COUNTED:
        cell = (column * (row.max() + 1) + row).astype(np.int64) * SECTORS + sector
    else:  # too far apart for a table, as points of a plug-in may be
        cells = np.stack([column, row, sector])
        cell = np.unique(cells, axis=1, return_inverse=True)[1].reshape(-1)
    heaviest = (cell == np.bincount(cell, weights).argmax()).argmax()
    apart = (sector - sector[heaviest] + 1) % SECTORS
    near = (abs(column - column[heaviest]) <= 1) & (abs(row - row[heaviest]) <= 1) & (apart <= 2)
    share = float(weights[near].sum())
    return Cluster(mean_pose(at[:, near].T, weights[near] / share), share)


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
