"""A robot, and a short random drive on its floor plan with the scans it would take."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deqmcl_gym.maps import GridMap, Lidar, Map, PolygonMap
from deqmcl_gym.maps.units import pixel
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError
from localizers.api import RobotModel
from localizers.models.beams import GaussianUniform
from localizers.models.motion import OdometryMotion
from localizers.models.prior import GaussianPrior

STEPS = 12
_TRIES = 100
_LONGEST = 20.0  # px, of a step: 0.4 m


@dataclass(frozen=True, kw_only=True)
class Drive:
    """The input of a localizer for T steps.

    Attributes:
        prior: p(x_0).
        actions: carried out, (T, 2); the first of those planned.
        scans: taken after them, (T, B).
        plans: at t = 0 … T, each (h, 2).
    """

    prior: GaussianPrior
    actions: Floats
    scans: Floats
    plans: Sequence[Floats]


def default_robot() -> RobotModel:
    """Return a robot with eight beams in a rectangular corridor."""
    return robot_on(
        PolygonMap(
            outer=[(0, 0), (350, 0), (350, 300), (0, 300)],
            obstacles=([(100, 100), (250, 100), (250, 200), (100, 200)],),
        )
    )


def robot_on_cells() -> RobotModel:
    """Return the same robot in a hall of 9 m by 7 m with a pillar, in cells of 0.1 m."""
    cells = np.zeros((70, 90), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[28:40, 28:60] = 100
    return robot_on(GridMap(occupancy=cells, resolution=0.1))


def robot_on(floor_plan: Map) -> RobotModel:
    """Return a robot with eight beams of 400 px, or 8 m, on a map."""
    px = pixel(floor_plan.unit)
    return RobotModel(
        floor_plan=floor_plan,
        lidar=Lidar(beams=8, field_of_view=2 * np.pi, max_range=400.0 * px, sigma=10.0 * px),
        motion=OdometryMotion(drive=0.2, turn=0.3, drift=0.01 / px),
        scan=GaussianUniform(sigma=20.0 * px),
    )


def random_drive(robot: RobotModel, rng: np.random.Generator) -> Drive:
    """Drive from a free pose, turning where a wall is near; only half of the plan is driven.

    The noise is small and not that which the robot assumes: a check tests whether a localizer
    keeps the laws, not how accurate it is.
    """
    longest = _LONGEST * pixel(robot.floor_plan.unit)
    stride = min(size_of(robot.floor_plan) / 30, longest)
    poses = [_free_pose(robot, rng)]
    actions = []
    for _ in range(2 * STEPS):
        action, pose = _free_step(robot, poses[-1], stride, rng)
        actions.append(action)
        poses.append(pose)
    lidar = robot.lidar
    exact = np.asarray(
        robot.floor_plan.ranges(lidar.origins(np.array(poses[1 : STEPS + 1]).T).T, lidar.bearings),
        np.float64,
    )
    noisy = exact + rng.normal(0.0, 0.01 * stride, exact.shape)
    x, y, heading = poses[0].tolist()
    return Drive(
        prior=GaussianPrior(mean=(x, y, heading), sd_position=0.5 * stride, sd_heading=0.1),
        actions=np.array(actions[:STEPS]),
        scans=np.clip(noisy, 0.0, lidar.max_range),
        plans=[np.array(actions[t:]) for t in range(STEPS + 1)],
    )


def size_of(floor_plan: Map) -> float:
    """Return the shorter side of the box around a floor plan, in its unit."""
    x0, y0, x1, y1 = floor_plan.bounds
    return min(x1 - x0, y1 - y0)


def _free_pose(robot: RobotModel, rng: np.random.Generator) -> Floats:
    """Draw a pose where the robot fits and sees far, heading about along the x axis.

    Slightly below 0: it can be written 2π higher, and half a turn from it lies ±π.
    """
    x0, y0, x1, y1 = robot.floor_plan.bounds
    for _ in range(_TRIES):
        poses = rng.uniform((x0, y0, -0.1), (x1, y1, 0.0), (_TRIES, 3))
        free = robot.floor_plan.free(poses, robot.radius)
        if free.any():
            room_ahead = np.where(free, robot.floor_plan.ranges(poses, [0.0])[:, 0], -1.0)
            pose: Floats = poses[room_ahead.argmax()]
            return pose
    raise InputError(
        f"the robot's radius is {robot.radius:g} {robot.floor_plan.unit}, but a disc that wide "
        "does not fit into its floor plan: give a smaller radius or another floor plan."
    )


def _free_step(
    robot: RobotModel, pose: Floats, stride: float, rng: np.random.Generator
) -> tuple[tuple[float, float], Floats]:
    """Draw a step that touches no wall; a turn on the spot if there is none.

    As long as there is room the heading stays about 0.
    """
    sd = np.linspace(0.1, 2.0, _TRIES)
    for distance, spread in zip(
        (*rng.uniform(0.5, 1.0, _TRIES - 1) * stride, 0.0), sd, strict=True
    ):
        turn = rng.normal(-0.5 * pose[2], spread)
        heading = pose[2] + turn
        ahead = pose + np.array([distance * np.cos(heading), distance * np.sin(heading), turn])
        if distance == 0.0 or not robot.floor_plan.collides(pose[None], ahead[None], robot.radius):
            break
    return (float(distance), float(turn)), ahead
