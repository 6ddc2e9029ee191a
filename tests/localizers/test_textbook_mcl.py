"""``mcl`` against Monte-Carlo localization written from the book (textbook_mcl)."""

import math
from dataclasses import replace

import numpy as np
import pytest
import textbook_mcl as book

import localizers
from deqmcl_gym.maps import Lidar
from localizers.models.scan import LidarScan, Scan

PARTICLES = 25
ACTIONS = [(20.0, 0.0), (20.0, 0.3), (25.0, -0.2), (30.0, 0.0), (15.0, 0.5)]
SCANS = [[270.0], [150.0], [230.0], [200.0], [90.0]]


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


def theirs(robot: localizers.RobotModel, prior, filters: int) -> np.ndarray:
    rows, sds = [], [prior.sd_position, prior.sd_position, prior.sd_heading]
    for seed in range(filters):
        rng = np.random.default_rng((1, seed))
        start = rng.normal(prior.mean, sds, (PARTICLES, 3))
        rows.append([summary(*cloud) for cloud in book.mcl(robot, start, ACTIONS, SCANS, rng)])
    return np.array(rows)


def worst_z(a: np.ndarray, b: np.ndarray) -> float:
    """Largest Welch statistic over steps and columns."""
    error = np.sqrt(a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b))
    return float(np.abs((a.mean(axis=0) - b.mean(axis=0)) / error).max())


def test_mcl_has_the_textbooks_means_over_many_filters(ours, robot, prior):
    # Both are the same algorithm with the same resampling scheme, so the two laws are equal but
    # for float32: no allowance. 30 statistics; |z| > 5 fails: false alarms 2e-5 altogether.
    assert worst_z(ours, theirs(robot, prior, 500)) < 5


@pytest.mark.parametrize(
    ("part", "change"),
    [
        ("scan", {"sigma": 40.0}),
        ("scan", {"uniform": 0.5}),
        ("motion", {"drive": 0.5}),
        ("motion", {"drift": 0.04}),
    ],
)
def test_a_textbook_filter_that_assumes_something_else_is_told_apart(
    ours, robot, prior, part, change
):
    other = replace(robot, **{part: replace(getattr(robot, part), **change)})
    assert worst_z(ours, theirs(other, prior, 150)) > 5


def test_the_log_likelihood_of_a_scan_is_the_textbooks(robot, room):
    lidar = Lidar(beams=7, field_of_view=2.5, max_range=400.0)
    ours_at = LidarScan(floor_plan=room, lidar=lidar, beam=robot.scan)
    rng = np.random.default_rng(1)
    poses = rng.uniform((-30, -30, -3), (380, 330, 3), (3_000, 3)).astype(np.float32)
    scan = np.array([20.0, 310.0, math.nan, 100.0, 399.0, -1.0, 60.0])
    expected = book.log_likelihood(replace(robot, lidar=lidar), poses.astype(float), scan)
    seen = ours_at.log_likelihood(np.ascontiguousarray(poses.T), Scan.of(scan, 400.0))
    # d log p / d ô = (o - ô) / σ² at most, here ≤ 400 / 30² = 0.44 per px and beam. Ranges are off
    # by some units of float32 at 400 px (3e-5) over the sine of the angle of incidence: 5 beams x
    # 0.44 x 1e-3 = 2e-3, except where a ray that passes a corner takes the other wall, or a pose
    # lies on the outer wall: fewer than 1 in 200.
    off = np.abs(seen - expected) > 2e-3
    assert off.mean() < 0.005
    assert (seen == -150.0).sum() == (expected == -150.0).sum() > 300
