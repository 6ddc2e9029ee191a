"""Where a belief places the robot, against where it is: when is a lost robot localized?

Worlds and logs are both scored by this file. Lengths are in m.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from deqmcl_gym.logs.motion import lengths_of
from deqmcl_gym.maps import Map
from deqmcl_gym.maps.clusters import Near
from deqmcl_gym.numerics.types import Bools, Floats, Indices, Reals

NEAR = {"05m": Near(0.5, math.radians(10)), "1m": Near(1.0, math.radians(30))}
FOUND = "1m"  # of NEAR: the one for metres to localize
LAST = 0.25  # share of a run's steps in which a success is localized throughout
COMMITTED, FAR = 0.5, 2.0  # a belief of a larger quality commits itself; m: off by more, falsely
RECOVERED, RECOVERED_STEPS = 0.45, 20  # m; 10 s, of two scans each (Fox, Burgard & Thrun 1999)
ARRIVED = 0.5  # m from the goal
_SAMPLE = 4096  # points at which a map is compared with itself
_ALIKE = 0.998  # of them: a point on a line between cells may fall to either side


@dataclass(frozen=True, kw_only=True)
class Fixes:
    """How far off the best cluster of a belief is at the steps whose true pose is known.

    Attributes:
        steps: which steps, ascending, (k,).
        count: how many steps the run has, the one at t = 0 included.
        way: driven until each by the commands, m, (k,).
        distance: of the best cluster's mean to the truth, m, (k,).
        angle: between their headings, rad, (k,).
        quality: confidence that it is not lost, (k,); NaN where the belief gives none.
        tolerated: share of steps at which a localized robot may seem off: 0 in a world, whose truth
            is exact.
    """

    steps: Indices
    count: int
    way: Floats
    distance: Floats
    angle: Floats
    quality: Floats
    tolerated: float = 0.0

    def localized(self, near: str) -> Bools:
        """Whether the best cluster is as near to the truth as ``NEAR`` says, (k,)."""
        return NEAR[near].holds(self.distance, self.angle)

    @property
    def last(self) -> Bools:
        """Whether a step is one of the last 25 %, (k,)."""
        return self.steps >= math.floor((1 - LAST) * self.count)

    def success(self, near: str) -> float:
        """1 if localized in the steps of the last 25 %, else 0; NaN if none of them is known.

        In all of them, but for the share that is ``tolerated``.
        """
        if not self.last.any():
            return math.nan
        return float((~self.localized(near)[self.last]).mean() <= self.tolerated)

    @property
    def lost_at(self) -> int | None:
        """Index of the first step from which on it is never again localized; None: it is."""
        near = np.flatnonzero(self.localized(FOUND))
        first = int(near[-1]) + 1 if near.size else 0
        ended_well = first == self.steps.size or (near.size and self.success(FOUND) == 1.0)
        return None if ended_well else first

    @property
    def metres_to_localize(self) -> float:
        """Metres driven until it is localized for good; inf: never; NaN: nothing is known.

        For good is at all steps from there on, but for the share that is ``tolerated``.
        """
        if not self.steps.size:
            return math.nan
        first = settled(self.localized(FOUND), self.tolerated)
        return math.inf if first is None else float(self.way[first])

    @property
    def rated(self) -> Bools:
        """Whether a step t ≥ 1 has a quality, (k,)."""
        return np.isfinite(self.quality) & (self.steps >= 1)

    @property
    def false(self) -> Bools:
        """Whether the belief commits itself, quality > 0.5, while more than 2 m off, (k,)."""
        return (self.quality > COMMITTED) & (self.distance > FAR)

    def metres_to_recover(self, carried: int) -> float:
        """Metres from the first step after a kidnap to 20 within 0.45 m on end; inf: never."""
        after = np.flatnonzero(self.steps >= carried)
        near = self.distance[after] <= RECOVERED
        runs = np.convolve(near, np.ones(RECOVERED_STEPS), "valid") if near.size else near
        whole = np.flatnonzero(runs > RECOVERED_STEPS - 0.5)
        if near.size < RECOVERED_STEPS or not whole.size:
            return math.inf
        return float(self.way[after[whole[0]]] - self.way[after[0]])


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


def settled(near: Bools, tolerated: float = 0.0) -> int | None:
    """Return the first step from which on all are near, but for a share; None: there is none."""
    off = np.cumsum(~near[::-1])[::-1] / np.arange(near.size, 0, -1)
    good = np.flatnonzero(near & (off <= tolerated))
    return int(good[0]) if good.size else None


def way_driven(commands: Sequence[Reals]) -> Floats:
    """Return the way until each step, from the commands of the steps t ≥ 1, (2,) or (3,) each."""
    if not commands:
        return np.zeros(1)
    return np.concatenate([[0.0], np.cumsum(lengths_of(np.array(commands, np.float64)))])


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
