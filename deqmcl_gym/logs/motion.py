"""Odometry as actions (d, φ): turn, then drive.

An increment (Δx, Δy, Δθ) has three numbers, an action two. The heading is exact, as scans depend on
it most, and the drive is the least-squares solution: φ = Δθ, and d is the component along the new
heading. The residual is the component across: -d Δθ / 2 for a robot on an arc, plus any slip of the
wheels. Residuals of bends to the left and to the right cancel at equal speed; ``Log.residuals`` has
those of a log.
"""

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Bools, Floats


def actions_of(poses: Floats) -> tuple[Floats, Floats]:
    """Return the actions between consecutive poses (n, 3), and their residuals.

    Returns:
        (d, φ), (n - 1, 2); the residuals to the left of the new heading, (n - 1,). NaN where a
        pose is NaN.
    """
    known: Bools = np.asarray(np.isfinite(poses).all(axis=1))
    given = np.where(known[:, None], poses, 0.0)
    dx, dy, turn = np.diff(given, axis=0).T
    cosine, sine = arrays.cos(given[1:, 2]), arrays.sin(given[1:, 2])
    drive, across = dx * cosine + dy * sine, dy * cosine - dx * sine
    found = np.column_stack([drive, arrays.wrapped(turn), across])
    found[~(known[1:] & known[:-1])] = np.nan
    return found[:, :2], found[:, 2]


def dead_reckoned(actions: ArrayLike, start: ArrayLike = (0.0, 0.0, 0.0)) -> Floats:
    """Return the start and the poses after each of the actions (n, 2), (n + 1, 3)."""
    steps = np.asarray(actions, dtype=np.float64).reshape(-1, 2)
    x, y, heading = np.asarray(start, dtype=np.float64)
    headings = arrays.wrapped(np.cumsum([heading, *steps[:, 1]]))
    drives = np.zeros(len(steps) + 1)
    drives[1:] = steps[:, 0]
    xs = np.cumsum(drives * arrays.cos(headings)) + x
    ys = np.cumsum(drives * arrays.sin(headings)) + y
    return np.column_stack([xs, ys, headings])


def composed(poses: Floats, offset: Floats) -> Floats:
    """Return poses (n, 3) ⊕ offset (3,) or (n, 3): the offset is in the frame of each pose."""
    x, y, heading = poses.T
    dx, dy, turn = np.broadcast_to(offset, poses.shape).T
    cosine, sine = arrays.cos(heading), arrays.sin(heading)
    return np.column_stack(
        [
            x + cosine * dx - sine * dy,
            y + sine * dx + cosine * dy,
            arrays.wrapped(heading + turn),
        ]
    )


def relative(origins: Floats, poses: Floats) -> Floats:
    """Return poses (n, 3) in the frames of origins (n, 3): origin ⊕ relative = pose."""
    dx, dy, turn = (poses - origins).T
    cosine, sine = arrays.cos(origins[:, 2]), arrays.sin(origins[:, 2])
    return np.column_stack([cosine * dx + sine * dy, cosine * dy - sine * dx, arrays.wrapped(turn)])


def heading_of(quaternions: Floats) -> Floats:
    """Return the headings of quaternions (n, 4) x, y, z, w; NaN for quaternions of length 0."""
    x, y, z, w = quaternions.T
    size = (quaternions**2).sum(axis=1)
    heading = np.asarray(arrays.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))
    return np.where(size > 1e-12, heading, np.nan)
