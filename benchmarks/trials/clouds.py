"""Beliefs about states as weighted clouds of poses, and what is measured of them, many at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.trials import kernels
from deqmcl_gym.maps import Map
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics.elementary import FARTHEST
from deqmcl_gym.numerics.types import Floats, Ints, Reals
from deqmcl_gym.validation import InputError, digits

_SUM_TOLERANCE = 1e-3  # of weights: a million of float32 add up to 1 within this
_EXACT = 1e-9  # weights whose sum is farther from 1 are divided by it
_LARGEST = np.array([1e15, 1e15, FARTHEST])  # |x|, |y| and |θ| of a pose: far beyond any map


@dataclass(frozen=True, kw_only=True)
class Task:
    """What must be known of a world to measure beliefs about it.

    Attributes:
        floor_plan: the map; it names the unit of all lengths.
        radius: of the robot's disc.
        max_range: of the lidar.
    """

    floor_plan: Map
    radius: float
    max_range: float


class Cloud(NamedTuple):
    """A belief at t = state - offset about x_state: poses, rows x, y, θ (3, n), weights (n,)."""

    state: int
    offset: int
    poses: Reals
    weights: Floats


@dataclass(frozen=True, kw_only=True)
class Clouds:
    """Clouds one after the other in memory, for passes over all of them.

    Attributes:
        each: the clouds.
        poses: rows x, y, θ of all, (3, N).
        weights: of all, (N,).
        ends: where each cloud ends, (k,).
        truth: the true pose of each state, (k, 3).
    """

    each: Sequence[Cloud]
    poses: Reals
    weights: Floats
    ends: Ints
    truth: Floats


def cloud_of(state: int, offset: int, points: Any) -> Cloud:
    """Return a copy of what ``Belief.points(offset)`` gave about a state.

    A copy, because a localizer may write into its arrays at the next step.

    Raises:
        InputError: other than numbers, poses (n, 3) and weights (n,), or no pose.
    """
    what = f"its belief of state {state} at offset {offset}"
    if not (isinstance(points, tuple | list) and len(points) == 2):
        raise InputError(
            f"{what} is of type {type(points).__name__}, but must be (poses, weights) or None."
        )
    poses, weights = (
        _numbers(f"{what} has {name}", given)
        for name, given in zip(("poses", "weights"), points, strict=True)
    )
    if weights.ndim != 1 or not weights.size or poses.shape != (weights.size, 3):
        raise InputError(
            f"{what} has poses of shape {poses.shape} and weights of shape {weights.shape}, "
            "but must be poses (n, 3) and weights (n,) of one point or more."
        )
    kept: type[np.floating[Any]] = np.float32 if poses.dtype == np.float32 else np.float64
    return Cloud(state, offset, np.array(poses, kept, order="F").T, np.array(weights, np.float64))


def _numbers(what: str, given: Any) -> NDArray[Any]:
    """Return an array of real numbers, else refuse it."""
    if isinstance(given, np.ma.MaskedArray) and np.ma.is_masked(given):
        raise InputError(f"{what} that are masked, but they must be an array of numbers.")
    try:
        numbers = np.asarray(given)
    except ValueError:  # ragged
        numbers = np.empty(0, object)
    if numbers.dtype.kind not in "fiu":  # "1.5", True and 1j are no real numbers
        raise InputError(f"{what} of type {numbers.dtype}, but they must be an array of numbers.")
    return numbers


def joined(clouds: Sequence[Cloud], truth: Sequence[Reals]) -> Clouds:
    """Put clouds together; ``truth``: the true pose of the state of each, (3,)."""
    weights = [cloud.weights for cloud in clouds]
    return Clouds(
        each=clouds,
        poses=np.concatenate([cloud.poses for cloud in clouds], axis=1),
        weights=np.concatenate(weights),
        ends=np.cumsum([own.size for own in weights]),
        truth=np.array(truth, np.float64),
    )


def moments(clouds: Clouds) -> Floats:
    """Weighted mean and variance of (x, y, cos θ, sin θ), (k, 8); NaN variance of one point.

    Weights that add up to 1 but for rounding are divided by their sum first, in place.

    Raises:
        InputError: weights that are negative or do not add up to 1, or a pose that is not finite
            or huge.
    """
    out = np.empty((len(clouds.each), 10))
    kernels.moments(clouds.poses, clouds.weights, clouds.ends, out)
    total, below = out[:, 8], out[:, 9]
    starts = np.concatenate([[0], clouds.ends[:-1]])
    largest = np.maximum.reduceat(np.abs(clouds.poses), starts, axis=1).T  # NaN if one is
    sound = (np.abs(total - 1) <= _SUM_TOLERANCE) & (below == 0)
    sound &= (largest <= _LARGEST).all(axis=1)
    if not sound.all():
        raise _unsound(clouds.each[int(np.argmin(sound))])
    if (np.abs(total - 1) > _EXACT).any():  # NumPy's sums are good to 1e-13
        clouds.weights[:] /= np.repeat(total, clouds.ends - starts)
        return moments(clouds)
    return out[:, :8]


def calibration(clouds: Clouds, means: Floats, unit: str) -> Floats:
    """Energy score, rank of the truth and NEES of each cloud, (k, 3); NaN is not available.

    With X, X' drawn from the belief and z the truth, in (x, y):

    - energy score E|X - z| - ½ E|X - X'| (Gneiting & Raftery 2007). The first term is that of all
      particles; the second of the pairs of ``kernels.PAIRED`` of them, at equal steps of the
      cumulative weight: of one cloud it is right to a few per cent, its mean over a lap to 1 %. Of
      one point the score is its distance to the truth.
    - rank P(D(X) < D(z)), D the Mahalanobis distance to the belief's mean under its covariance. The
      credible region of level p, the p of the weight nearest to the mean, covers the truth if
      rank ≤ p. No shape is assumed: the distances are ranked among the belief's own.
    - NEES dᵀ P⁻¹ d, d = truth - estimate in (x, y, θ), θ about the direction of the mean and
      wrapped, P the second moments of the belief about the estimate. On average 3 if the truth is
      a draw from the belief.

    Args:
        clouds: the beliefs.
        means: of their (x, y, cos θ, sin θ), (k, 4).
        unit: of lengths.
    """
    out = np.empty((len(clouds.each), 3))
    means = np.ascontiguousarray(means)
    kernels.calibration(
        clouds.poses, clouds.weights, clouds.ends, means, clouds.truth, covariance_floor(unit), out
    )
    return out


def covariance_floor(unit: str) -> Floats:
    """Variances added to those of x, y and θ: a collapsed cloud shall not divide by zero, (3,)."""
    position = 1e-2 * pixel(unit) ** 2  # (0.1 px)²
    return np.array([position, position, 1e-6])


def _unsound(cloud: Cloud) -> InputError:
    """Say what is wrong with a cloud."""
    what = f"its belief of state {cloud.state} at offset {cloud.offset}"
    total, low = cloud.weights.sum(), cloud.weights.min()
    if low >= 0 and abs(total - 1) <= _SUM_TOLERANCE:
        return InputError(
            f"{what} has poses that are not finite or huge: x and y must be from -1e15 to 1e15, "
            "headings from -1e9 to 1e9 rad."
        )
    return InputError(
        f"{what} has weights of sum {digits(total)}, the smallest {digits(low)}, but they "
        "must be 0 or more and add up to 1: divide them by their sum."
    )
