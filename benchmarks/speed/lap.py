"""The work that is timed: rays in the paper's room, and a recorded lap to follow."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import count

import numpy as np

from benchmarks.speed.timing import Job
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.numerics.types import Reals, Singles
from localizers import GaussianPrior, GaussianUniform, OdometryMotion, RobotModel

BEAMS = 16
SIGMA = 10.0  # px
PLANNED = 100  # actions that a localizer is shown: the mean over a lap that counts down

Update = Callable[[Reals, Reals, Reals], object]  # one step on, by scan, action and plan


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


def bearings_of(beams: int) -> Singles:
    """Return the bearings of such a lidar, (beams,) rad."""
    return fan(beams).bearings.astype(np.float32)


@dataclass(frozen=True, kw_only=True)
class RecordedLap:
    """A lap of the paper's room without motion noise: it ends where it starts and can go on.

    Attributes:
        robot: what localizers are made for.
        prior: p(x_0).
        scans: (T, B) px.
        plan: the actions, (T, 2).
    """

    robot: RobotModel
    prior: GaussianPrior
    scans: Reals
    plan: Reals

    def following(self, update: Update, warm_up: int = 0) -> Job:
        """Return the job of updating a filter along the lap, over and over; one step a call."""
        laps = np.tile(self.plan, (2 + PLANNED // len(self.plan), 1))
        steps = count()

        def step() -> None:
            t = next(steps) % len(self.plan)
            update(self.scans[t], self.plan[t], laps[t + 1 : t + 1 + PLANNED])

        for _ in range(warm_up):
            step()
        return Job(step)


@cache
def recorded_lap(beams: int = BEAMS) -> RecordedLap:
    """Drive the lap and record it."""
    lidar = fan(beams)
    noiseless = {"drive": 0.0, "turn": 0.0, "drift": 0.0}
    room = RoomEnv(lidar=lidar, noise=noiseless, ends_at_goal=False)
    room.reset(seed=0)
    return RecordedLap(
        robot=RobotModel(
            floor_plan=room.floor_plan,
            lidar=lidar,
            motion=OdometryMotion(drive=0.1, turn=0.1, drift=0.01),
            scan=GaussianUniform(sigma=SIGMA),
        ),
        prior=GaussianPrior(mean=room.course.start),
        scans=np.array([room.step(action)[0] for action in room.plan]),
        plan=room.plan.astype(np.float64),
    )
