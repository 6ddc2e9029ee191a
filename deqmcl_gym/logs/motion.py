"""Odometry as increments (forward, left, turn): a turn, then a translation in the frame after it.

Two consecutive poses have three numbers between them, and an increment keeps all three. It is in
the frame after the turn, so that (d, 0, φ) is a room's action (d, φ): turn by φ, drive d ahead.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics import Bools, Floats, Indices, Pose, arrays


def increments_of(poses: Floats) -> Floats:
    """Return the increments between consecutive poses (n, 3), (n - 1, 3); NaN where a pose is."""
    known: Bools = np.asarray(np.isfinite(poses).all(axis=1))
    finite = np.where(known[:, None], poses, 0.0)
    dx, dy, turn = np.diff(finite, axis=0).T
    cosine, sine = arrays.cos(finite[1:, 2]), arrays.sin(finite[1:, 2])
    forward, left = dx * cosine + dy * sine, dy * cosine - dx * sine
    increments = np.column_stack([forward, left, arrays.wrapped(turn)])
    increments[~(known[1:] & known[:-1])] = np.nan
    return increments


def has_moved(last: Pose | Floats, pose: Pose | Floats, distance: float, angle: float) -> bool:
    """Whether a pose is at least so far from the last one or turned by so much: one is enough."""
    turn = abs(math.remainder(pose[2] - last[2], 2 * math.pi))
    return math.hypot(pose[0] - last[0], pose[1] - last[1]) >= distance or turn >= angle


def lengths_of(increments: Floats) -> Floats:
    """Return the lengths of increments (n, 3), or of actions (d, φ), (n, 2), (n,)."""
    if increments.shape[1] == 2:
        return np.abs(increments[:, 0])
    lengths: Floats = np.sqrt(increments[:, 0] ** 2 + increments[:, 1] ** 2)
    return lengths


def sideways_of(increments: Floats) -> Floats:
    """Return the components of increments (n, 3) to the left of the mean heading, (n,).

    The mean of the headings before and after: 0 for a robot on an arc of a circle.
    """
    forward, left, turn = increments.T
    cosine, sine = arrays.cos(turn / 2), arrays.sin(turn / 2)
    aside: Floats = left * cosine + forward * sine
    return aside


def dead_reckoned(increments: ArrayLike, start: ArrayLike = (0.0, 0.0, 0.0)) -> Floats:
    """Return the start and the poses after each increment (n, 3) or action (n, 2), (n + 1, 3)."""
    moves = np.asarray(increments, dtype=np.float64)
    moves = moves.reshape(len(moves), -1 if moves.size else 3)
    forward, turn = moves[:, 0], moves[:, -1]
    left = moves[:, 1] if moves.shape[1] == 3 else np.zeros(len(moves))
    x, y, heading = np.asarray(start, dtype=np.float64)
    headings = arrays.wrapped(np.cumsum([heading, *turn]))
    cosine, sine = arrays.cos(headings[1:]), arrays.sin(headings[1:])
    xs = np.cumsum([0.0, *(forward * cosine - left * sine)]) + x
    ys = np.cumsum([0.0, *(forward * sine + left * cosine)]) + y
    return np.column_stack([xs, ys, headings])


def composed(poses: Floats, offset: Floats) -> Floats:
    """Return poses (n, 3) ⊕ offset (3,) or (n, 3): the offset is in the frame of each pose."""
    x, y, heading = poses.T
    dx, dy, turn = np.broadcast_to(offset, poses.shape).T
    cosine, sine = arrays.cos(heading), arrays.sin(heading)
    return np.column_stack(
        [x + cosine * dx - sine * dy, y + sine * dx + cosine * dy, arrays.wrapped(heading + turn)]
    )


def relative(origins: Floats, poses: Floats) -> Floats:
    """Return poses (n, 3) in the frames of origins (n, 3): origin ⊕ relative = pose."""
    dx, dy, turn = (poses - origins).T
    cosine, sine = arrays.cos(origins[:, 2]), arrays.sin(origins[:, 2])
    return np.column_stack([cosine * dx + sine * dy, cosine * dy - sine * dx, arrays.wrapped(turn)])


def one_pose(poses: Floats) -> Pose:
    """Return the first of poses (n, 3) as three numbers."""
    x, y, heading = poses[0].tolist()
    return x, y, heading


def between(times: Floats, poses: Floats, at: Floats) -> Floats:
    """Return poses at times (n,), on straight lines between the poses before and after, (n, 3).

    Before the first pose and after the last it is that one; headings turn the shorter way. Times of
    poses (k, 3) do not decrease, (k,) s.
    """
    x, y, heading = poses.T
    columns = [np.interp(at, times, column) for column in (x, y, np.unwrap(heading))]
    return np.column_stack([*columns[:2], arrays.wrapped(columns[2])])


def heading_of(quaternions: Floats) -> Floats:
    """Return the headings of quaternions (n, 4) x, y, z, w; NaN for quaternions of length 0."""
    x, y, z, w = quaternions.T
    size = (quaternions**2).sum(axis=1)
    heading = np.asarray(arrays.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))
    return np.where(size > 1e-12, heading, np.nan)


def nearest_in_time(times: Floats, at: Floats) -> tuple[Indices, Floats]:
    """Return which of ascending ``times`` (k,) is nearest to each of ``at``, and how far, (n,)."""
    after = np.clip(np.searchsorted(times, at), 1, max(times.size - 1, 1))
    pair = np.minimum(np.stack([after - 1, after]), times.size - 1)
    off = np.abs(times[pair] - at)
    return pair[off.argmin(axis=0), np.arange(at.size)], off.min(axis=0)
