"""``mcl`` against Monte-Carlo localization written from the book in plain loops (textbook_mcl)."""

import math
import random

import numpy as np
import pytest
import textbook_mcl as book
from following import STILL

import localizers
from deqmcl_gym.maps import Lidar
from localizers.models.scan import LidarScan, Scan

PARTICLES = 25
ACTIONS = [(20.0, 0.0), (20.0, 0.3), (25.0, -0.2), (30.0, 0.0), (15.0, 0.5)]
SCANS = [[270.0], [150.0], [230.0], [200.0], [90.0]]


def textbook_robot(robot: localizers.RobotModel, **changes) -> book.Robot:
    assumed = {
        "outer": robot.floor_plan.outer,
        "obstacles": robot.floor_plan.obstacles,
        "bearings": robot.lidar.bearings.tolist(),
        "max_range": robot.lidar.max_range,
        "sigma": robot.scan.sigma,
        "uniform": robot.scan.uniform,
        "drive": robot.motion.drive,
        "turn": robot.motion.turn,
        "drift": robot.motion.drift,
    }
    return book.Robot(**{**assumed, **changes})


def summary(poses: np.ndarray, weights: np.ndarray) -> list[float]:
    """Estimates (x, y, cos, sin), spread and effective sample size of one cloud."""
    w = weights / weights.sum()
    x, y, heading = poses.T
    mean = [w @ x, w @ y, w @ np.cos(heading), w @ np.sin(heading)]
    return [*mean, w @ (x - w @ x) ** 2, 1 / (w @ w)]


@pytest.fixture(scope="module")
def ours(robot, prior) -> np.ndarray:
    """(filters, steps, 6)."""
    localizer, rows = localizers.make("mcl", robot, particles=PARTICLES), []
    for seed in range(1_200):
        localizer.reset(prior, [], np.random.default_rng(seed))
        beliefs = [
            localizer.update(scan, action, []) for action, scan in zip(ACTIONS, SCANS, strict=True)
        ]
        rows.append([summary(*belief.points()) for belief in beliefs])
    return np.array(rows)


def theirs(robot: book.Robot, prior, filters: int) -> np.ndarray:
    rows = []
    for seed in range(filters):
        rng = random.Random(seed)
        sd = (prior.sd_position, prior.sd_position, prior.sd_heading)
        start = [
            tuple(rng.gauss(m, s) for m, s in zip(prior.mean, sd, strict=True))
            for _ in range(PARTICLES)
        ]
        clouds = book.mcl(robot, start, ACTIONS, SCANS, rng)
        rows.append([summary(np.array(poses), np.array(weights)) for poses, weights in clouds])
    return np.array(rows)


def worst_z(a: np.ndarray, b: np.ndarray) -> float:
    """Largest Welch statistic over steps and columns."""
    error = np.sqrt(a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b))
    return float(np.abs((a.mean(axis=0) - b.mean(axis=0)) / error).max())


def test_mcl_has_the_textbooks_means_over_many_filters(ours, robot, prior):
    # Both are the same algorithm with the same resampling scheme, so the two laws are equal but
    # for float32: no allowance. 30 statistics; |z| > 5 fails: false alarms 2e-5 altogether.
    assert worst_z(ours, theirs(textbook_robot(robot), prior, 500)) < 5


@pytest.mark.parametrize(
    "changes", [{"sigma": 40.0}, {"drive": 0.5}, {"drift": 0.04}, {"uniform": 0.5}]
)
def test_a_textbook_filter_that_assumes_something_else_is_told_apart(ours, robot, prior, changes):
    other = textbook_robot(robot, **changes)
    assert worst_z(ours, theirs(other, prior, 150)) > 5


def test_the_log_likelihood_of_a_scan_is_the_textbooks(robot, room):
    lidar = Lidar(beams=7, field_of_view=2.5, max_range=400.0)
    ours_at = LidarScan(floor_plan=room, lidar=lidar, beam=robot.scan)
    other = textbook_robot(robot, bearings=lidar.bearings.tolist())
    rng = np.random.default_rng(1)
    poses = rng.uniform((-30, -30, -3), (380, 330, 3), (3_000, 3)).astype(np.float32)
    scan = np.array([20.0, 310.0, math.nan, 100.0, 399.0, -1.0, 60.0])
    expected = np.array([book.log_likelihood(other, pose, scan) for pose in poses.tolist()])
    seen = ours_at.log_likelihood(np.ascontiguousarray(poses.T), Scan.of(scan, 400.0))
    # d log p / d ô = (o - ô) / σ² at most, here ≤ 400 / 30² = 0.44 per px and beam. Ranges are off
    # by some units of float32 at 400 px (3e-5) over the sine of the angle of incidence: 5 beams x
    # 0.44 x 1e-3 = 2e-3, except where a ray that passes a corner takes the other wall, or a pose
    # lies on the outer wall: fewer than 1 in 200.
    off = np.abs(seen - expected) > 2e-3
    assert off.mean() < 0.005
    assert (seen == -150.0).sum() == (expected == -150.0).sum() > 300


def test_motion_without_noise_is_the_textbooks():
    robot = book.Robot([], [], [], 0, 1, 0, 0.0, 0.0, 0.0)
    rng = np.random.default_rng(2)
    poses = rng.uniform((0, 0, -np.pi), (350, 300, np.pi), (500, 3)).astype(np.float32)
    for distance, turn in rng.uniform((-30, -np.pi), (30, np.pi), (20, 2)).tolist():
        seen = STILL.sample(poses.T, np.array([distance, turn]), np.random.default_rng(0))
        moved = (book.moved(robot, p, distance, turn, random.Random(0)) for p in poses.tolist())
        exact = np.array(list(moved))
        # float32: positions up to 400 are resolved to 3e-5; headings up to 2π to 5e-7, times a
        # distance of 30 another 1.5e-5.
        assert np.abs(seen[:2].T - exact[:, :2]).max() < 1e-4
        apart = np.angle(np.exp(1j * (seen[2] - exact[:, 2])))
        assert np.abs(apart).max() < 2e-6
