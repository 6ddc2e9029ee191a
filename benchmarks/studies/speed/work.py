"""The work that is timed: maps to cast rays in, poses to cast from, and laps to follow."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import count
from typing import Any

import numpy as np

from benchmarks.setup.changes import NOTHING
from benchmarks.studies.speed.figure import Job
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps import GridMap, Lidar, Map, PolygonMap
from deqmcl_gym.numerics.types import Reals, Singles
from localizers import GaussianPrior, GaussianUniform, OdometryMotion, Prior, RobotModel

BEAMS = 16
SIGMA = 10.0  # px
PLANNED = 100  # actions that a localizer is shown: the mean over a lap that counts down


def free_poses(floor_plan: Map, n: int, radius: float = 0.1) -> Singles:
    """Draw poses uniformly from where a robot of ``radius`` fits, always the same ones, (n, 3)."""
    rng = np.random.default_rng(0)
    x0, y0, x1, y1 = floor_plan.bounds
    found = np.empty((0, 2))
    while len(found) < n:
        points = rng.uniform((x0, y0), (x1, y1), (2 * n, 2))
        found = np.vstack([found, points[floor_plan.free(points, radius=radius)]])
    headings = rng.uniform(-math.pi, math.pi, n)
    return np.column_stack([found[:n], headings]).astype(np.float32)


def fan(beams: int) -> Lidar:
    """Return a lidar that looks all around."""
    return Lidar(beams=beams, field_of_view=2 * math.pi, max_range=400.0, sigma=SIGMA)


def pillared_room(segments: int) -> PolygonMap:
    """Return a square room of 400 px with oblique square pillars: 4 walls each and 4 around."""
    pillars = segments // 4 - 1
    side = math.ceil(math.sqrt(pillars))
    spacing = 400 / side
    corners = np.deg2rad(17 + 90 * np.arange(4))
    square = spacing / 4 * np.column_stack([np.cos(corners), np.sin(corners)])
    centres = [(spacing * (i % side + 0.5), spacing * (i // side + 0.5)) for i in range(pillars)]
    return PolygonMap(
        outer=((0, 0), (400, 0), (400, 400), (0, 400)),
        obstacles=tuple((square + centre).tolist() for centre in centres),
    )


def office_floor(side: int = 1000) -> GridMap:
    """Return offices with doors along corridors, and 400 things in them: side² cells of 5 cm."""
    rng, cells = np.random.default_rng(1), np.zeros((side, side), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    for wall in range(140, side, 180):
        for beside in (wall, wall + 40):  # a corridor of 2 m, a door in each office
            cells[beside : beside + 2] = 100
            for door in range(30, side, 100):
                cells[beside : beside + 2, door : door + 18] = 0
    for office in range(0, side, 180):
        for wall in range(100, side, 100):
            cells[office + (42 if office else 0) : office + 140, wall : wall + 2] = 100
    for row, column in rng.integers(5, side - 15, (400, 2)).tolist():
        cells[row : row + rng.integers(3, 12), column : column + rng.integers(3, 12)] = 100
    return GridMap(occupancy=cells, resolution=0.05)


@dataclass(frozen=True, kw_only=True)
class Lap:
    """A recorded lap as a localizer sees it.

    Attributes:
        robot, prior: what filters assume.
        first: the plan shown at reset, (h, 2).
        steps: scan (B,), action (2,) and the plan (h, 2) after it, of each step.
    """

    robot: RobotModel
    prior: Prior
    first: Reals
    steps: tuple[tuple[Any, ...], ...]

    def following(
        self, update: Callable[..., object], restart: Callable[[], None] = lambda: None
    ) -> Job:
        """Return the job of one step: ``restart()`` where a lap begins, ``update(*step)``."""
        numbers = count()

        def step() -> None:
            t = next(numbers) % len(self.steps)
            if t == 0:
                restart()
            update(*self.steps[t])

        return Job(step)


@cache
def recorded_lap(beams: int = BEAMS) -> Lap:
    """Drive a lap of the paper's room without motion noise: it ends where it starts."""
    lidar = fan(beams)
    noiseless = {"drive": 0.0, "turn": 0.0, "drift": 0.0}
    room = RoomEnv(lidar=lidar, noise=noiseless, ends_at_goal=False)
    room.reset(seed=0)
    scans = [room.step(action)[0] for action in room.plan]
    plan = room.plan.astype(np.float64)
    laps = np.tile(plan, (2 + PLANNED // len(plan), 1))
    return Lap(
        robot=RobotModel(
            floor_plan=room.floor_plan,
            lidar=lidar,
            motion=OdometryMotion(drive=0.1, turn=0.1, drift=0.01),
            scan=GaussianUniform(sigma=SIGMA),
        ),
        prior=GaussianPrior(mean=room.course.start),
        first=laps[:PLANNED],
        steps=tuple((scan, plan[t], laps[t + 1 : t + 1 + PLANNED]) for t, scan in enumerate(scans)),
    )


@cache
def replanned_lap() -> Lap:
    """Drive a lap of scenario ``guided``, whose plan is another one at every step."""
    stage = Stage.of(
        Trial(scenario="guided", localizer="dead-reckoning", params=NOTHING, lag=0, seed=0, trial=0)
    )
    first, *steps = stage.moments()
    assert first.plan is not None, "a driver shows its plan"
    return Lap(
        robot=stage.robot,
        prior=stage.prior(),
        first=first.plan,
        steps=tuple((moment.ranges, moment.action, moment.plan) for moment in steps),
    )
