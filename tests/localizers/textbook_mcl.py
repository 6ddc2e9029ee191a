"""Monte-Carlo localization as the book has it (Thrun, Burgard & Fox 2005), with ``reference``."""

import math
from collections.abc import Sequence

import numpy as np
import reference

from localizers import RobotModel

OUTSIDE = -30.0  # of each usable beam


def segments(polygon: Sequence[tuple[float, float]]) -> np.ndarray:
    corners = np.array(polygon)
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def log_likelihood(robot: RobotModel, poses: np.ndarray, scan: Sequence[float]) -> np.ndarray:
    """Log Π over usable beams of (1 - u) N(o; ô, σ²) + u / r_max (section 6.3), (n,)."""
    plan, lidar, beam, measured = robot.floor_plan, robot.lidar, robot.scan, np.array(scan)
    usable = (measured >= 0) & (measured <= lidar.max_range)
    walls = np.vstack([segments(polygon) for polygon in (plan.outer, *plan.obstacles)])
    z = (measured - reference.ranges(walls, poses, lidar.bearings))[:, usable] / beam.sigma
    hit = np.exp(-0.5 * z**2) / (beam.sigma * math.sqrt(2 * math.pi))
    logs = np.log((1 - beam.uniform) * hit + beam.uniform / lidar.max_range).sum(axis=1)
    inside = reference.winding(segments(plan.outer), poses[:, :2]) != 0
    return np.where(inside, logs, OUTSIDE * usable.sum())


def mcl(robot: RobotModel, poses: np.ndarray, actions, scans, rng) -> list[tuple]:
    """Table 8.2: the weighted particles of each step, before the low variance sampler (4.4)."""
    motion, n, clouds = robot.motion, len(poses), []
    for (distance, turn), scan in zip(actions, scans, strict=True):
        sd = motion.turn * abs(turn) + motion.drift * abs(distance)
        heading = poses[:, 2] + rng.normal(turn, sd, n)
        driven = rng.normal(distance, motion.drive * abs(distance), n)
        x, y = poses[:, 0] + driven * np.cos(heading), poses[:, 1] + driven * np.sin(heading)
        poses = np.column_stack([x, y, heading])
        weights = np.exp(log_likelihood(robot, poses, scan))
        clouds.append((poses, weights))
        pointers = (rng.random() + np.arange(n)) / n * weights.sum()
        poses = poses[np.searchsorted(np.cumsum(weights), pointers).clip(max=n - 1)]
    return clouds
