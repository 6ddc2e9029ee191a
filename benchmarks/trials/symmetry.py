"""Maps that a half turn leaves as they are: two places fit every scan."""

import math

import numpy as np

from benchmarks.trials.fixes import NEAR
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Floats, Reals

_SAMPLE = 4096  # points at which a map is compared with itself
_ALIKE = 0.998  # of them: a point on a line between cells may fall to either side


def half_turned(floor_plan: Map, poses: Floats) -> Floats:
    """Return poses (n, 3) turned by 180° about the middle of a map."""
    x0, y0, x1, y1 = floor_plan.bounds
    return np.array([x0 + x1, y0 + y1, math.pi]) + np.array([-1.0, -1.0, 1.0]) * poses


def is_symmetric(floor_plan: Map) -> bool:
    """Whether a half turn about its middle gives the same map; asked at 4,096 points."""
    x0, y0, x1, y1 = floor_plan.bounds
    points = np.random.default_rng(0).uniform((x0, y0), (x1, y1), (_SAMPLE, 2))
    turned = np.array([x0 + x1, y0 + y1]) - points
    same = floor_plan.free(points) == floor_plan.free(turned)
    return float(same.mean()) >= _ALIKE


def weight_near(poses: Reals, weights: Floats, pose: Floats, metre: float) -> float:
    """Return the weight within 1 m and 30° of a pose."""
    distance, angle = NEAR["1m"]
    x, y, heading = poses.T
    dx, dy = x - pose[0], y - pose[1]
    close = np.flatnonzero(dx * dx + dy * dy <= (distance * metre) ** 2)
    turned = np.abs((heading[close] - pose[2] + math.pi) % (2 * math.pi) - math.pi)
    return float(weights[close[turned <= angle]].sum())
