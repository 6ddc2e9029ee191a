"""Beliefs about states as weighted clouds of poses, and what is measured of them, many at once.

Clouds lie one after the other in memory. Compiled scores copy each, so that the compiler knows that
its rows are contiguous and overlap nothing: worth half the time.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.setup.scenario import Thresholds
from deqmcl_gym.maps import Map
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Floats, Ints, Reals, Singles
from deqmcl_gym.numerics.arrays import cholesky, fit
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import FARTHEST, atan2_64, cos64, sin64, sincos32, wrapped64
from deqmcl_gym.validation import SUM_TOLERANCE, InputError, digits

Scalar = Any  # a float64 inside a kernel

# Particles whose mutual distances stand for those of the whole cloud in the energy score. Points of
# one weight may be a designed set, of which some are no sample: of up to so many, all pairs count.
PAIRED, DESIGNED = 128, 512
_FAR_OFF = 1e15  # |x| and |y| of a pose that is far beyond any map


@compiled
def measure(
    poses: Reals,
    weights: Floats,
    ends: Ints,
    truth: Floats,
    floor: Floats,
    far: float,
    fully: bool,
    out: Floats,
) -> None:
    """Fill in a row of each cloud, (k, 15): moments; if ``fully``, scores; Σ w, unsound points.

    Unsound are points of negative weight, and poses that are not finite or huge. Moments and scores
    are those of ``belief_scores``; ``floor`` is added to the variances of x, y, θ, (3,).
    """
    start = 0
    for k in range(ends.size):
        end = ends[k]
        cloud, masses = poses[:, start:end].astype(np.float64), weights[start:end].copy()
        _measure(cloud, masses, truth[k], floor, far, fully, out[k])
        start = end


@compiled
def _measure(
    cloud: Floats,
    weights: Floats,
    truth: Floats,
    floor: Floats,
    far: float,
    fully: bool,
    out: Floats,
) -> None:
    n = weights.size
    x, y, heading = cloud[0], cloud[1], cloud[2]
    c, s, square, off = np.empty(n), np.empty(n), np.zeros(n), np.zeros(n)
    for i in range(n):
        c[i] = cos64(heading[i])
        s[i] = sin64(heading[i])
    for i in range(n if fully else 0):
        dx, dy = x[i] - truth[0], y[i] - truth[1]
        square[i] = dx * dx + dy * dy
        off[i] = weights[i] * math.sqrt(square[i])
    mx, my, mc, ms, total = 0.0, 0.0, 0.0, 0.0, 0.0  # side by side: none waits for another
    near, beyond, most = 0.0, 0.0, far * far
    for i in range(n):
        mx += weights[i] * x[i]
        my += weights[i] * y[i]
        mc += weights[i] * c[i]
        ms += weights[i] * s[i]
        total += weights[i]
        near += off[i]
        beyond += weights[i] if square[i] > most else 0.0
    vx, vy, vc, vs, unsound = 0.0, 0.0, 0.0, 0.0, 0
    for i in range(n):
        vx += weights[i] * (x[i] - mx) * (x[i] - mx)
        vy += weights[i] * (y[i] - my) * (y[i] - my)
        vc += weights[i] * (c[i] - mc) * (c[i] - mc)
        vs += weights[i] * (s[i] - ms) * (s[i] - ms)
    for i in range(n):
        near_by = (abs(x[i]) <= _FAR_OFF) & (abs(y[i]) <= _FAR_OFF) & (abs(heading[i]) <= FARTHEST)
        unsound += not (near_by & (weights[i] >= 0.0))
    out[0], out[1], out[2], out[3] = mx, my, mc, ms
    out[4], out[5], out[6], out[7] = vx, vy, vc, vs
    out[8], out[12], out[13], out[14] = near, beyond, total, unsound
    if n == 1:
        out[4:8], out[9:12] = math.nan, math.nan
    elif fully:
        designed = n <= DESIGNED and weights.min() == weights.max()
        out[8] -= _dispersion(x, y, weights) if designed else _sampled_dispersion(x, y, weights)
        out[9], out[10], out[11] = _of_spread(cloud, weights, out, truth, floor)


@compiled
def _dispersion(x: Floats, y: Floats, weights: Floats) -> Scalar:
    """½ E|X - X'| = Σ_{k<j} w_j w_k |x_j - x_k|, in (x, y), float32, good to 1e-6."""
    n = weights.size
    east, north = (x - x[0]).astype(np.float32), (y - y[0]).astype(np.float32)
    spread, weight = np.zeros(n, np.float32), weights.astype(np.float32)
    for j in range(1, n):  # one sum per k, so that the inner loop is SIMD code
        for k in range(j):
            dx, dy = east[j] - east[k], north[j] - north[k]
            spread[k] += weight[j] * np.sqrt(dx * dx + dy * dy)
    distance = 0.0
    for k in range(n):
        distance += weights[k] * spread[k]
    return distance


@compiled
def _sampled_dispersion(x: Floats, y: Floats, weights: Floats) -> Scalar:
    """½ the mean distance of pairs of particles at the cumulative weights (j + ½) / PAIRED."""
    n = weights.size
    some_x, some_y, spread = np.empty(PAIRED), np.empty(PAIRED), np.zeros(PAIRED)
    total = 0.0
    for i in range(n):
        total += weights[i]
    reached, particle = weights[0], 0
    for j in range(PAIRED):
        goal = (j + 0.5) / PAIRED * total
        while reached <= goal and particle < weights.size - 1:
            particle += 1
            reached += weights[particle]
        some_x[j], some_y[j] = x[particle], y[particle]
    for j in range(1, PAIRED):
        for k in range(j):
            dx, dy = some_x[j] - some_x[k], some_y[j] - some_y[k]
            spread[k] += math.sqrt(dx * dx + dy * dy)
    distance = 0.0
    for k in range(PAIRED):
        distance += spread[k]
    return distance / (PAIRED * (PAIRED - 1))


@compiled
def _of_spread(
    cloud: Floats, weights: Floats, mean: Floats, truth: Floats, floor: Floats
) -> tuple[Scalar, Scalar, Scalar]:
    """Weight nearer to the mean than the truth is; of (x, y, θ) dᵀ P⁻¹ d, and -log N(d; 0, P)."""
    x, y, heading = cloud[0], cloud[1], cloud[2]
    n = weights.size
    mx, my, centre = mean[0], mean[1], atan2_64(mean[3], mean[2])
    turned = np.empty(n)
    for i in range(n):
        turned[i] = wrapped64(heading[i] - centre)
    pxx, pyy, ptt = floor[0], floor[1], floor[2]
    pxy, pxt, pyt = 0.0, 0.0, 0.0
    for i in range(n):
        dx, dy, dt = x[i] - mx, y[i] - my, turned[i]
        wx, wy, wt = weights[i] * dx, weights[i] * dy, weights[i] * dt
        pxx += wx * dx
        pyy += wy * dy
        ptt += wt * dt
        pxy += wx * dy
        pxt += wx * dt
        pyt += wy * dt
    covariance = np.array([[pxx, pxy, pxt], [pxy, pyy, pyt], [pxt, pyt, ptt]])
    root = cholesky(covariance, floor[2])
    off = np.array([truth[0] - mx, truth[1] - my, wrapped64(truth[2] - centre)])
    distance, nees, log_score = fit(root, off)
    g00, g10, g11 = root[0, 0], root[1, 0], root[1, 1]
    nearer = 0.0
    h00, h10, h11 = 1.0 / g00, -g10 / (g00 * g11), 1.0 / g11  # of the inverse root
    for i in range(n):
        v0 = h00 * (x[i] - mx)
        v1 = h10 * (x[i] - mx) + h11 * (y[i] - my)
        turned[i] = weights[i] if v0 * v0 + v1 * v1 < distance else 0.0
    for i in range(n):
        nearer += turned[i]
    return nearer, nees, log_score


@compiled
def steps_back(poses: Reals, moves: Floats, ends: Ints, out: Singles) -> None:
    """Fill in where a robot at each pose was before the increment that led to its state, (2, N).

    The increment turns first, so the way there had the heading of the pose: (x, y) - R(θ) (f, l).
    """
    start = 0
    for k in range(ends.size):
        end = ends[k]
        heading = poses[2, start:end].astype(np.float32)
        sine, cosine = np.empty_like(heading), np.empty_like(heading)
        sincos32(heading, sine, cosine)
        forward, left = np.float32(moves[k, 0]), np.float32(moves[k, 1])
        for i in range(end - start):
            out[0, start + i] = poses[0, start + i] - (forward * cosine[i] - left * sine[i])
            out[1, start + i] = poses[1, start + i] - (forward * sine[i] + left * cosine[i])
        start = end


# of ``measured``, beside the moments: (k,) each, NaN not available
COLUMNS = ("energy", "rank", "nees", "log_score", "outlier_share", "wall_share", "wall_step_share")


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """What must be known of a world to measure beliefs about it."""

    floor_plan: Map  # the map; it names the unit of all lengths
    radius: float  # of the robot's disc
    max_range: float  # of the lidar
    thresholds: Thresholds  # what is far off, and lost


class Cloud(NamedTuple):
    """A belief at t = state - offset about x_state: poses, rows x, y, θ (3, n), weights (n,)."""

    state: int
    offset: int
    poses: Reals
    weights: Floats


@dataclass(frozen=True, kw_only=True)
class Clouds:
    """Clouds one after the other in memory, for passes over all of them."""

    each: Sequence[Cloud]  # the clouds
    poses: Reals  # rows x, y, θ of all, (3, N)
    weights: Floats  # of all, (N,)
    ends: Ints  # where each cloud ends, (k,)
    truth: Floats  # the true pose of each state, (k, 3)
    moves: Floats  # the increments (forward, left, turn) commanded on the way to each state, (k, 3)


def cloud_of(state: int, offset: int, points: Any) -> Cloud:
    """Return a copy of what ``Belief.points(offset)`` gave; its arrays may be written to later."""
    what = f"its belief of state {state} at offset {offset}"
    if not (isinstance(points, tuple | list) and len(points) == 2):
        raise InputError(
            f"{what} is of type {type(points).__name__}, but must be (poses, weights) or None."
        )
    poses, weights = points
    plain = type(poses) is type(weights) is np.ndarray
    if not (plain and poses.dtype.kind == weights.dtype.kind == "f"):
        poses, weights = _numbers(what, "poses", poses), _numbers(what, "weights", weights)
    if weights.ndim != 1 or not weights.size or poses.shape != (weights.size, 3):
        raise InputError(
            f"{what} has poses of shape {poses.shape} and weights of shape {weights.shape}, "
            "but must be poses (n, 3) and weights (n,) of one point or more."
        )
    dtype: type[np.floating[Any]] = np.float32 if poses.dtype == np.float32 else np.float64
    return Cloud(state, offset, np.array(poses, dtype, order="F").T, np.array(weights, np.float64))


def _numbers(what: str, name: str, given: Any) -> NDArray[Any]:
    """Return an array of real numbers, else refuse it."""
    if isinstance(given, np.ma.MaskedArray) and np.ma.is_masked(given):
        raise InputError(
            f"{what} has {name} that are masked, but they must be an array of numbers."
        )
    try:
        numbers = np.asarray(given)
    except ValueError:  # ragged
        numbers = np.empty(0, object)
    if numbers.dtype.kind not in "fiu":  # "1.5", True and 1j are no real numbers
        raise InputError(
            f"{what} has {name} of type {numbers.dtype}, but they must be an array of numbers."
        )
    return numbers


def joined(clouds: Sequence[Cloud], truth: Sequence[Reals], moves: Floats | None = None) -> Clouds:
    """Put clouds together, with the truth of each state and the increment on the way, (k, 3)."""
    return Clouds(
        each=clouds,
        poses=np.concatenate([cloud.poses for cloud in clouds], axis=1),
        weights=np.concatenate([cloud.weights for cloud in clouds]),
        ends=np.cumsum([cloud.weights.size for cloud in clouds]),
        truth=np.array(truth, np.float64),
        moves=np.zeros((len(clouds), 3)) if moves is None else moves,
    )


def belief_moments(clouds: Clouds) -> Floats:
    """Weighted mean and variance of (x, y, cos θ, sin θ), (k, 8); NaN variance of one point.

    Weights that add up to 1 but for rounding are divided by their sum first, in place.
    """
    return _measured(clouds, "px", 0.0, fully=False)[:, :8]


def belief_scores(clouds: Clouds, unit: str, far: float = math.inf) -> Floats:
    """Moments as of ``belief_moments``, then scores of clouds, (k, 13); NaN: not available.

    With X, X' drawn from the belief and z the truth, in (x, y):

    - energy score E|X - z| - ½ E|X - X'| (Gneiting & Raftery 2007). The first term is that of all
      particles; the second of all pairs of up to ``DESIGNED`` of equal weight, else of the pairs of
      ``PAIRED`` of them, at equal steps of the cumulative weight: of one cloud it is right to a few
      per cent, its mean over a lap to 1 %. Of one point the score is its distance to the truth.
    - rank P(D(X) < D(z)), D the Mahalanobis distance to the belief's mean under its covariance. The
      credible region of level p, the p of the weight nearest to the mean, covers the truth if
      rank ≤ p. No shape is assumed: the distances are ranked among the belief's own.
    - NEES dᵀ P⁻¹ d, d = truth - estimate in (x, y, θ), θ about the direction of the mean and
      wrapped, P the second moments of the belief about the estimate. On average 3 if the truth is
      a draw from the belief.
    - log score -log N(d; 0, P), nats: ½ (NEES + log det 2πP), with the same d and P. The score of
      Dawid & Sebastiani (1999): proper, and only mean and covariance count.
    - weight farther than ``far`` from the truth.
    """
    return _measured(clouds, unit, far, fully=True)[:, :13]


def measured(clouds: Clouds, task: Surroundings) -> Floats:
    """Moments of beliefs, then their ``COLUMNS``, (k, 15).

    The last two are weight on poses where the robot does not fit, and on those whose last step, as
    commanded along their heading, passed a wall.
    """
    floor_plan, poses = task.floor_plan, clouds.poses.T
    rows = belief_scores(clouds, floor_plan.unit, task.thresholds.far)
    before = np.empty((2, clouds.weights.size), np.float32)
    steps_back(clouds.poses, clouds.moves, clouds.ends, before)
    in_walls = ~floor_plan.free(poses, task.radius)
    through = floor_plan.collides(before.T, poses, task.radius)
    those, n = np.flatnonzero(np.concatenate([in_walls, through])), clouds.weights.size
    starts = np.concatenate([[0], clouds.ends[:-1]])
    begins = np.searchsorted(those, np.concatenate([starts, starts + n]))
    # each sum begins with 0: none is empty
    padded = np.insert(clouds.weights[those % n], begins, 0.0)
    sums = np.add.reduceat(padded, begins + np.arange(begins.size)).reshape(2, -1)
    return np.hstack([rows, sums.T])


def _measured(clouds: Clouds, unit: str, far: float, *, fully: bool) -> Floats:
    """Return what ``measure`` fills in, of sound clouds only."""
    poses, weights, ends = clouds.poses, clouds.weights, clouds.ends
    out = np.empty((len(clouds.each), 15))
    measure(poses, weights, ends, clouds.truth, covariance_floor(unit), far, fully, out)
    total, unsound = out[:, 13], out[:, 14]
    sound = (np.abs(total - 1) <= SUM_TOLERANCE) & (unsound == 0)
    if not sound.all():
        raise _unsound(clouds.each[int(np.argmin(sound))])
    if (np.abs(total - 1) > 1e-9).any():  # NumPy's sums are good to 1e-13
        weights[:] /= np.repeat(total, np.diff(ends, prepend=0))
        return _measured(clouds, unit, far, fully=fully)
    return out


def covariance_floor(unit: str) -> Floats:
    """Variances added to those of x, y and θ: a collapsed cloud shall not divide by zero, (3,)."""
    position = 1e-2 * pixel(unit) ** 2  # (0.1 px)²
    return np.array([position, position, 1e-6])


def _unsound(cloud: Cloud) -> InputError:
    """Say what is wrong with a cloud."""
    what = f"its belief of state {cloud.state} at offset {cloud.offset}"
    total, low = cloud.weights.sum(), cloud.weights.min()
    if low >= 0 and abs(total - 1) <= SUM_TOLERANCE:
        return InputError(
            f"{what} has poses that are not finite or huge: x and y must be from -1e15 to 1e15, "
            "headings from -1e9 to 1e9 rad."
        )
    return InputError(
        f"{what} has weights of sum {digits(total)}, the smallest {digits(low)}, but they "
        "must be 0 or more and add up to 1: divide them by their sum."
    )
