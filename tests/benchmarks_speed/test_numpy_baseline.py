"""The NumPy baseline computes what the kernels do, so that the ratio compares like with like."""

import math

import numpy as np
import pytest
import reference

from benchmarks.speed import numpy_baseline
from benchmarks.speed.lap import bearings_of, free_poses, recorded_lap
from benchmarks.speed.numpy_baseline import NumpyModels
from deqmcl_gym.world.paper_room import PAPER_ROOM
from localizers.inference.resampling import systematic
from localizers.models import motion_kernels as kernels
from localizers.models.scan import LidarScan

BEARINGS = bearings_of(16)
TURN = 2e-6  # rad: θ + b, sine and cosine in float32, |θ + b| ≤ 2π, are off by less

both_casters = pytest.mark.parametrize(
    "caster", [numpy_baseline.segments, numpy_baseline.slabs], ids=lambda maker: maker.__name__
)


def baseline_ranges(poses, caster):
    return caster(PAPER_ROOM)(np.ascontiguousarray(poses.T), BEARINGS).T


@both_casters
def test_ranges_are_those_of_the_reference_within_a_turn_that_float32_cannot_resolve(caster):
    poses = free_poses(PAPER_ROOM, 3_000)
    exact = reference.ranges(PAPER_ROOM.walls, poses, BEARINGS)
    turned = [reference.ranges(PAPER_ROOM.walls, poses, BEARINGS + s * TURN) for s in (-1, 1)]
    low = np.minimum.reduce([exact, *turned])
    high = np.maximum.reduce([exact, *turned])
    slack = 1e-6 * exact + 1e-4  # a product, a quotient and differences of coordinates to 350
    seen = baseline_ranges(poses, caster)
    assert ((seen >= low - slack) & (seen <= high + slack)).all()
    assert np.median(high - low) < 1e-2  # the bracket is narrow: the test can fail


@both_casters
def test_the_size_of_the_blocks_changes_no_bit(monkeypatch, caster):
    poses = free_poses(PAPER_ROOM, 1_000)
    whole = baseline_ranges(poses, caster)
    monkeypatch.setattr(numpy_baseline, "RAYS_PER_BLOCK", 16 * 37)
    assert (baseline_ranges(poses, caster) == whole).all()


@both_casters
def test_log_likelihoods_differ_by_no_more_than_the_ranges_do(caster):
    lap = recorded_lap()
    robot, beam = lap.robot, lap.robot.scan
    poses = free_poses(PAPER_ROOM, 3_000)
    poses[:200, 0] -= 400  # outside
    states = np.ascontiguousarray(poses.T)
    scan = LidarScan(floor_plan=robot.floor_plan, lidar=robot.lidar, beam=beam)
    ours = scan.log_likelihood(states, lap.scans[7].astype(float))
    seen = NumpyModels(robot, caster).log_likelihood(states, lap.scans[7])
    # slope of log(p exp(-z²/2) + f) in ô: z/σ p exp(-z²/2) / (p exp(-z²/2) + f), at most
    z = np.linspace(0, 10, 10_001)
    hit = (1 - beam.uniform) / (beam.sigma * math.sqrt(2 * math.pi)) * np.exp(-(z**2) / 2)
    slope = (z / beam.sigma * hit / (hit + beam.uniform / 400)).max()
    apart = np.abs(PAPER_ROOM.ranges(poses, BEARINGS) - baseline_ranges(poses, caster)).sum(axis=1)
    apart[:200] = 0.0
    rounding = 16 * 1e-5  # z²/2 ≤ 10 where the hit counts at all, in float32
    assert (np.abs(ours - seen) <= slope * apart + rounding).all()
    assert np.median(apart) < 1e-2
    assert ours.std() > 1


class Drawn:
    """The normal numbers that ``OdometryMotion`` makes of a seed, as NumPy's generator's."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)

    def standard_normal(self, size, dtype):
        out = np.empty(size, dtype)
        kernels.normal_pairs(self.rng.random(size[1]), 0.0, 1.0, 0.0, 1.0, out)
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
