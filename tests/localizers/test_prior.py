"""Priors: moments of their draws, their densities, and those that are refused."""

import math

import numpy as np
import pytest

from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.validation import InputError
from localizers import GaussianPrior, RobotModel, UniformPrior, make
from localizers.checks.subject import default_robot

HALL = PolygonMap(outer=[(0, 0), (9, 0), (9, 6), (0, 6)], unit="m")
PRIOR = GaussianPrior(mean=(50.0, 40.0, 3.0), sd_position=15.0, sd_heading=0.2)


def test_draws_have_the_priors_mean_and_standard_deviations():
    # 100,000 draws, 9 statistics at 5 standard errors: false alarms 5e-6 together
    n, sd = 100_000, np.array([15.0, 15.0, 0.2])
    off = (PRIOR.sample(n, np.random.default_rng(1)) - PRIOR.mean) / sd
    assert np.abs(off.mean(axis=0) * math.sqrt(n)).max() < 5
    assert np.abs(((off**2).mean(axis=0) - 1) * math.sqrt(n / 2)).max() < 5
    correlations = (off.T @ off / n)[np.triu_indices(3, k=1)]
    assert np.abs(correlations * math.sqrt(n)).max() < 5


def test_the_log_density_is_that_of_three_normals():
    poses = np.array([(50, 40, 3.0), (65, 40, 3.0), (50, 10, 3.2)])
    peak = -3 / 2 * math.log(2 * math.pi) - math.log(15 * 15 * 0.2)
    assert PRIOR.log_density(poses) == pytest.approx([peak, peak - 0.5, peak - 2 - 0.5])


def test_headings_a_full_turn_apart_have_the_same_density():
    poses = np.array([(50, 40, 3.1), (50, 40, 3.1 - 2 * math.pi), (50, 40, 3.1 + 4 * math.pi)])
    density = PRIOR.log_density(poses)
    assert density == pytest.approx(np.full(3, density[0]), abs=1e-9)


@pytest.mark.parametrize(
    "bad",
    [
        {"mean": (1, 2)},
        {"mean": (1, 2, 90)},
        {"mean": (math.nan, 2, 0)},
        {"mean": "abc"},
        {"sd_position": -1},
        {"sd_heading": math.nan},
    ],
)
def test_a_bad_prior_is_refused_on_one_line(bad):
    with pytest.raises(InputError, match=r"prior.*\.$") as caught:
        GaussianPrior(**{"mean": (1, 2, 0), **bad})
    assert "\n" not in str(caught.value)


def test_draws_of_a_uniform_prior_are_free_and_even_over_space_and_headings(room):
    prior = UniformPrior(floor_plan=room, radius=8.0)
    poses = prior.sample(4000, np.random.default_rng(0))
    assert prior.mean is None
    assert room.free(poses, 8.0).all()
    # share of a quarter of the area or of the turns: sd √(¼ ¾ / 4000) = 0.0068; 5 sd
    for quarter in ((poses[:, 0] < 175) & (poses[:, 1] < 150), poses[:, 2] < -np.pi / 2):
        assert quarter.mean() == pytest.approx(0.25, abs=0.034)


def test_the_density_of_a_uniform_prior_is_one_over_free_space_and_turns(room):
    prior = UniformPrior(floor_plan=room)
    poses = np.array([(50, 50, 0.0), (300, 250, 9.0), (175, 150, 0.0), (-1, 50, 0.0)])
    level = -math.log((350 * 300 - 150 * 100) * 2 * math.pi)
    # free space is counted at 16,384 even points: to a percent
    assert prior.log_density(poses)[:2] == pytest.approx([level, level], abs=0.01)
    assert prior.log_density(poses)[2:].tolist() == [-math.inf, -math.inf]


def test_a_uniform_prior_for_a_robot_too_wide_is_refused():
    narrow = PolygonMap(outer=[(0, 0), (10, 0), (10, 300), (0, 300)])
    with pytest.raises(InputError, match=r"prior\.radius is 8, but a disc that wide does not fit"):
        UniformPrior(floor_plan=narrow, radius=8)


def test_the_gaussian_of_a_kalman_filter_has_the_moments_of_a_uniform_prior(robot):
    prior = UniformPrior(floor_plan=robot.floor_plan)
    poses, _ = make("ekf", robot).reset(prior, [], np.random.default_rng(0)).points()
    # symmetric about (175, 150); 10,000 draws: 5 standard errors of sds of about 100 px
    assert np.abs(poses.mean(axis=0)[:2] - (175, 150)).max() < 5 * 110 / 100
    drawn = prior.sample(10_000, np.random.default_rng(1))[:, :2]
    assert np.abs(poses.std(axis=0)[:2] / drawn.std(axis=0) - 1).max() < 10 / math.sqrt(20_000)


@pytest.mark.parametrize("name", ["mcl", "deq-mcl", "ekf", "grid", "amcl"])
def test_a_spread_of_10_px_by_default_is_refused_on_a_map_in_metres(name):
    localizer = make(name, RobotModel(floor_plan=HALL, lidar=Lidar(max_range=9.0)))
    plan, rng = np.zeros((0, 2)), np.random.default_rng(0)
    with pytest.raises(InputError, match="give sd_position in m"):
        localizer.reset(GaussianPrior(mean=(4.0, 3.0, 0.0)), plan, rng)
    localizer.reset(GaussianPrior(mean=(4.0, 3.0, 0.0), sd_position=10.0), plan, rng)


def test_a_spread_that_is_not_given_is_10_px_in_a_room():
    assert GaussianPrior(mean=(1.0, 2.0, 0.0)) == GaussianPrior(mean=(1, 2, 0), sd_position=10.0)
    robot = default_robot()
    plan, rng = np.zeros((0, 2)), np.random.default_rng(0)
    make("mcl", robot).reset(GaussianPrior(mean=(50.0, 50.0, 0.0)), plan, rng)
