"""A room scaled by 0.02 and called metres: every localizer, without a parameter, does the same."""

import math

import numpy as np
import pytest
from following import follow, robot_of

import localizers
from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.maps.map import scaled

M = 0.02  # to the px
STEPS = 48
# float32 weights differ by 1e-6: means are CLOSE until resampling takes another particle, before
# step EARLY never with these seeds; then half a standard deviation is allowed. Of amcl one: where
# KLD-sampling takes a particle more, all later draws are others.
EARLY, CLOSE = 10, 0.001  # steps, px


@pytest.fixture(scope="module")
def lap(room):
    """A robot, a prior, actions round the block and what is seen on the way, in px."""
    lidar = Lidar(beams=4, field_of_view=2 * math.pi, max_range=400.0, sigma=10.0)
    robot = robot_of(room, lidar, (0.1, 0.1, 0.005), sigma=20.0)
    prior = localizers.GaussianPrior(mean=(50.0, 50.0, 0.0))
    actions, poses = [], [np.array(prior.mean)]
    for length in (250, 200, 250, 200):
        side = [(20.0, 0.0)] * (length // 20 - 1) + [(length % 20 + 20.0, 0.0), (0.0, math.pi / 2)]
        actions.extend(side)
        for distance, turn in side:
            x, y, heading = poses[-1]
            x, y = x + distance * math.cos(heading), y + distance * math.sin(heading)
            poses.append(np.array([x, y, heading + turn]))
    exact = room.ranges(poses[1:], robot.lidar.bearings)
    scans = exact + np.random.default_rng(0).normal(0, 10.0, exact.shape)
    assert len(actions) == STEPS
    return robot, prior, np.array(actions), np.clip(scans, 0, 400).astype(np.float64)


def in_metres(robot, prior, actions, scans):
    plan = robot.floor_plan
    walls = [[(x * M, y * M) for x, y in polygon] for polygon in (plan.outer, *plan.obstacles)]
    there = localizers.RobotModel(
        floor_plan=PolygonMap(outer=walls[0], obstacles=walls[1:], unit="m"),
        lidar=scaled(robot.lidar, M),
        motion=scaled(robot.motion, M),
        scan=scaled(robot.scan, M),
    )
    return there, scaled(prior, M), actions * (M, 1), scans * M


def history(name, robot, prior, actions, scans):
    """Beliefs along the lap, as mean positions and standard deviations at each step, (2,) each."""
    localizer = localizers.make(name, robot)
    for belief in follow(localizer, prior, (actions, scans)):
        poses, weights = belief.points()
        mean = np.array(localizers.mean_pose(poses, weights))[:2]
        yield mean, np.sqrt(weights @ np.square(poses[:, :2] - mean))


@pytest.mark.parametrize("name", localizers.names())
def test_a_room_in_metres_is_the_same_room(lap, name):
    others = 1.0 if name == "amcl" else 0.5
    runs = zip(history(name, *lap), history(name, *in_metres(*lap)), strict=True)
    for t, ((mean, spread), (in_m, _)) in enumerate(runs):
        allowed = CLOSE if t < EARLY else CLOSE + others * spread
        assert (np.abs(in_m / M - mean) <= allowed).all(), t


def test_the_robot_is_as_large_in_metres(lap):
    assert in_metres(*lap)[0].radius == pytest.approx(8 * M)
