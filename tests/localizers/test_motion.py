"""Priors, and the motion model: exact without noise; with it two normals, each as told."""

import math

import numpy as np
import pytest
from following import STILL, wrapped

from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.validation import InputError
from localizers import GaussianPrior, OdometryMotion, RobotModel, UniformPrior, make
from localizers.checks import default_robot
from localizers.models import motion as kernels

N = 100_000
START = (120.0, -40.0, 0.7)
STARTS = np.repeat(np.float32(START)[:, None], N, axis=1)
ACTIONS = [(20.0, 0.0), (20.0, 0.5), (-15.0, -1.0), (3.0, 2.0), (8.0, -3.0)]
MOTIONS = [
    OdometryMotion(drive=0.2, turn=0.1, drift=0.01),
    OdometryMotion(drive=0.05, turn=0.1, drift=0.02),
]


def z(samples: np.ndarray, expected: float) -> float:
    """(Mean - expected) in standard errors."""
    return (samples.mean() - expected) / (samples.std(ddof=1) / math.sqrt(samples.size))


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("motion", MOTIONS)
def test_both_noises_are_normal_and_independent(motion, action):
    """θ' ~ N(θ + φ, (turn |φ| + drift |d|)²), then D ~ N(d, (drive |d|)²) along θ'."""
    distance, turn = action
    after = motion.sample(STARTS, np.array(action), np.random.default_rng(2))
    assert after.dtype == np.float32
    x, y, heading = after.astype(np.float64)
    s = motion.turn * abs(turn) + motion.drift * abs(distance)
    along = (x - START[0]) * np.cos(heading) + (y - START[1]) * np.sin(heading)
    across = (y - START[1]) * np.cos(heading) - (x - START[0]) * np.sin(heading)
    assert np.abs(across).max() < 1e-4  # float32 of 160 px
    noise_d = (along - distance) / (motion.drive * abs(distance))
    noise_turn = wrapped(heading - START[2] - turn) / s
    for noise in (noise_d, noise_turn):
        for bound in (-2, -1, 0, 0.5, 1.5):  # 100 shares at 5 standard errors: 6e-5
            assert abs(z(noise <= bound, (1 + math.erf(bound / math.sqrt(2))) / 2)) < 5
    assert abs(z(noise_d * noise_turn, 0.0)) < 5
    assert abs(z(noise_d**2 * noise_turn**2, 1.0)) < 5


def test_standing_still_changes_no_bit_even_where_the_noise_is_large():
    rng = np.random.default_rng(3)
    poses = rng.uniform((0, 0, -3.14), (350, 300, 3.14), (1000, 3)).astype(np.float32).T
    after = OdometryMotion(drive=9, turn=9, drift=9).sample(poses, np.zeros(2), rng)
    assert np.array_equal(after, poses)


@pytest.mark.parametrize("turns", [-3, -1, 0, 1, 3])
def test_the_heading_comes_back_to_within_half_a_turn_and_means_the_same_direction(turns):
    headings = np.linspace(-math.pi, math.pi, 2001, dtype=np.float32)
    poses = np.stack([np.zeros_like(headings), np.zeros_like(headings), headings])
    turn = turns * 2 * math.pi + 0.3
    after = STILL.sample(poses, np.array([0.0, turn]), np.random.default_rng(0))[2]
    assert np.abs(after).max() <= np.float32(math.pi)
    # sums up to 22 rad are resolved to 2e-6 by float32
    assert np.abs(wrapped(after.astype(float) - headings - turn)).max() < 4e-6


def test_two_normal_numbers_are_drawn_per_particle_whatever_the_action():
    states = []
    for action in [(0.0, 0.0), *ACTIONS]:
        rng = np.random.default_rng(5)
        MOTIONS[0].sample(STARTS[:, :10], np.array(action), rng)
        states.append(rng.bit_generator.state)
    assert all(state == states[0] for state in states)


def test_the_least_and_the_largest_uniform_number_make_finite_pairs():
    ends = np.empty((2, 2), np.float32)
    kernels.normal_pairs(np.array([0.0, 1 - 2**-53]), 0.0, 1.0, 0.0, 1.0, ends[0], ends[1])
    assert ends[0, 0] == pytest.approx(np.sqrt(2 * np.log(2**25)), rel=1e-6)
    assert np.isfinite(ends).all()


def test_the_gaussian_of_a_kalman_filter_has_the_moments_of_a_uniform_prior(robot):
    prior = UniformPrior(floor_plan=robot.floor_plan)
    poses, _ = make("ekf", robot).reset(prior, [], np.random.default_rng(0)).points()
    # symmetric about (175, 150); 10,000 draws: 5 standard errors of sds of about 100 px
    assert np.abs(poses.mean(axis=0)[:2] - (175, 150)).max() < 5 * 110 / 100
    drawn = prior.sample(10_000, np.random.default_rng(1))[:, :2]
    assert np.abs(poses.std(axis=0)[:2] / drawn.std(axis=0) - 1).max() < 10 / math.sqrt(20_000)


@pytest.mark.parametrize("name", ["mcl", "deq-mcl", "ekf", "grid", "amcl"])
def test_a_spread_of_10_px_by_default_is_refused_on_a_map_in_metres(name):
    hall = PolygonMap(outer=[(0, 0), (9, 0), (9, 6), (0, 6)], unit="m")
    localizer = make(name, RobotModel(floor_plan=hall, lidar=Lidar(max_range=9.0)))
    plan, rng = np.zeros((0, 2)), np.random.default_rng(0)
    with pytest.raises(InputError, match="give sd_position in m"):
        localizer.reset(GaussianPrior(mean=(4.0, 3.0, 0.0)), plan, rng)
    localizer.reset(GaussianPrior(mean=(4.0, 3.0, 0.0), sd_position=10.0), plan, rng)


def test_a_spread_that_is_not_given_is_10_px_in_a_room():
    assert GaussianPrior(mean=(1.0, 2.0, 0.0)) == GaussianPrior(mean=(1, 2, 0), sd_position=10.0)
    robot = default_robot()
    plan, rng = np.zeros((0, 2)), np.random.default_rng(0)
    make("mcl", robot).reset(GaussianPrior(mean=(50.0, 50.0, 0.0)), plan, rng)
