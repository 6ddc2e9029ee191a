"""Filters of others compute what ours do, so that the ratios compare like with like."""

import math
from importlib import import_module

import numpy as np
import pytest

from benchmarks.speed import numpy_baseline
from benchmarks.speed.lap import bearings_of, free_poses, recorded_lap
from benchmarks.speed.numpy_baseline import NumpyModels
from deqmcl_gym.world.config import PAPER_ROOM
from localizers import make
from localizers.inference.resampling import systematic
from localizers.models import motion as kernels
from localizers.models.scan import LidarScan

PARTICLES, RUNS, STEPS = 500, 12, 30


def our_mcl(robot, particles, prior, rng):
    localizer = make("mcl", robot, particles=particles)
    localizer.reset(prior, recorded_lap().plan, rng)
    return lambda *step: localizer.update(*step).points()


def estimates(mcl):
    """Mean (x, y, cos θ, sin θ) at the end of each of some runs along the lap."""
    lap, ends = recorded_lap(), []
    for seed in range(RUNS):
        np.random.seed(seed)  # noqa: NPY002 (peers draw from the global generator)
        update = mcl(lap.robot, PARTICLES, lap.prior, np.random.default_rng(seed))
        for t in range(STEPS):
            poses, weights = update(lap.scans[t], lap.plan[t], lap.plan[t + 1 :])
        x, y, heading = np.asarray(poses, dtype=float).T
        ends.append(np.average([x, y, np.cos(heading), np.sin(heading)], axis=1, weights=weights))
    return np.array(ends)


@pytest.fixture(scope="module")
def ours():
    return estimates(our_mcl)


@pytest.mark.parametrize("name", ["numpy_baseline", "particles", "pfilter", "stonesoup"])
def test_estimates_are_ours_within_their_scatter(name, ours):
    filtering = numpy_baseline
    if name != "numpy_baseline":
        pytest.importorskip(name)
        filtering = import_module(f"benchmarks.speed.peers.{name}")
    theirs = estimates(filtering.mcl)
    error = np.sqrt((ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / RUNS)
    # Welch's t with some 15 to 22 degrees of freedom; |t| > 5 in 4 components: below 1 in 1,000
    assert (np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) < 5 * error).all()
    assert error[:2].max() < 2.0  # px: agreement means something


def test_log_likelihoods_are_ours_at_the_same_ranges_and_outside():
    lap, poses = recorded_lap(), free_poses(PAPER_ROOM, 3_000)
    states = np.ascontiguousarray(poses.T)
    scan = LidarScan(floor_plan=PAPER_ROOM, lidar=lap.robot.lidar, beam=lap.robot.scan)
    expected = numpy_baseline.segments(PAPER_ROOM)(states, bearings_of(16))
    ours = scan.weighed(lap.scans[7].astype(float), expected)
    models = NumpyModels(lap.robot)
    seen = models.log_likelihood(states, lap.scans[7])
    assert np.abs(seen - ours).max() < 16 * 1e-5  # z²/2 ≤ 10 where the hit counts, in float32
    assert ours.std() > 1
    states[0] -= 400
    outside = models.log_likelihood(states, lap.scans[7])
    assert outside.tolist() == scan.log_likelihood(states, lap.scans[7].astype(float)).tolist()


class Drawn:
    """The normal numbers that ``OdometryMotion`` makes of a seed, as NumPy's generator's."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)

    def standard_normal(self, size, dtype):
        out = np.empty(size, dtype)
        kernels.normal_pairs(self.rng.random(size[1]), 0.0, 1.0, 0.0, 1.0, out[0], out[1])
        return out


@pytest.mark.parametrize("action", [(5.0, 0.0), (0.0, 0.26), (-3.0, 3.0)])
def test_steps_are_those_of_the_motion_model_from_the_same_normal_numbers(action):
    robot = recorded_lap().robot
    states = np.ascontiguousarray(free_poses(PAPER_ROOM, 1_000).T)
    ours = robot.motion.sample(states, np.array(action), np.random.default_rng(3))
    apart = ours - NumpyModels(robot).moved(states, np.array(action), Drawn(3))
    apart[2] -= 2 * np.pi * np.rint(apart[2] / (2 * np.pi))
    assert np.abs(apart).max() < 2e-4  # float32 of coordinates up to 350 and of angles up to 6


@pytest.mark.parametrize("n", [1, 7, 1000])
def test_systematic_resampling_takes_the_same_ancestors(n):
    weights = np.random.default_rng(n).exponential(size=n) ** 6
    weights /= weights.sum()
    for seed in range(20):
        ours = systematic(weights, np.random.default_rng(seed))
        seen = numpy_baseline.systematic(weights, np.random.default_rng(seed))
        assert (ours == seen).all()


def test_the_recorded_lap_ends_where_it_starts():
    lap = recorded_lap()
    x, y, heading = lap.prior.mean
    for distance, turn in lap.plan:
        heading += turn
        x, y = x + distance * math.cos(heading), y + distance * math.sin(heading)
    assert math.hypot(x - lap.prior.mean[0], y - lap.prior.mean[1]) < 1e-2
    assert abs(heading - lap.prior.mean[2] - 2 * math.pi) < 1e-4
