"""A whole run, by which it is told whether the robot is found, found again, and arrives.

Lengths are in m; a pixel of the paper's room is 2 cm.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from benchmarks.trials.fixes import FOUND, NEAR, Fixes
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Bools, Floats, Reals

ARRIVED = 0.5  # m from the goal
_SAMPLE = 4096  # points at which a map is compared with itself
_ALIKE = 0.998  # of them: a point on a line between cells may fall to either side


@dataclass(frozen=True, kw_only=True)
class Journey:
    """A run from its start to its end. n = T + 1 states.

    Attributes:
        fixes: where the best cluster was.
        driven: by the commands until each state, (n,).
        truth: true poses, (n, 3).
        collided: whether the step to each state was stopped by a wall, (n,).
        clearance: least distance of the robot's rim to a wall.
        goal: where it was to arrive, (2,); None if nowhere.
        planned: length of the route from the start to the goal; NaN without a goal.
        masses: weight within 1 m and 30° of the truth and of its twin under a half turn of the
            map, (k, 2), at the steps of ``fixes``; None if that was not asked for.
    """

    fixes: Fixes
    driven: Floats
    truth: Floats
    collided: Bools = field(default_factory=lambda: np.zeros(0, np.bool_))
    clearance: float = math.nan
    goal: Floats | None = None
    planned: float = math.nan
    masses: Floats | None = None

    @property
    def carried(self) -> int:
        """The first state after the robot was carried off: where it moved farthest uncommanded."""
        moved = np.hypot(*np.diff(self.truth[:, :2], axis=0).T)
        return 1 + int(np.argmax(moved - np.diff(self.driven)))

    @property
    def arrived(self) -> bool:
        """Whether it ends within 0.5 m of the goal, without having touched a wall."""
        assert self.goal is not None
        off = math.hypot(*(self.truth[-1, :2] - self.goal))
        return off <= ARRIVED and not self.collided.any()

    @property
    def spl(self) -> float:
        """Success weighted by path length: S · planned / max(driven, planned).

        Anderson et al. 2018, "On evaluation of embodied navigation agents"; the route stands for
        the shortest way, which would scrape along walls.
        """
        path = float(np.hypot(*np.diff(self.truth[:, :2], axis=0).T).sum())
        longer = max(path, self.planned)
        return float(self.arrived) * (self.planned / longer if longer > 0 else 1.0)


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


def weight_near(poses: Reals, weights: Floats, pose: Floats, unit: str) -> float:
    """Return the weight within 1 m and 30° of a pose."""
    return float(weights[NEAR[FOUND](poses, pose, unit=unit)].sum())
