"""GaussianPrior: moments of its draws, its density, and the priors that are refused."""

import math

import numpy as np
import pytest

from deqmcl_gym.validation import InputError
from localizers import GaussianPrior

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


def test_the_density_leaves_the_poses_given_alone():
    poses = np.array([(50, 40, 9.0)])
    PRIOR.log_density(poses)
    assert poses.tolist() == [[50, 40, 9.0]]


def test_a_prior_without_spread_draws_its_mean():
    draws = GaussianPrior(mean=(1, 2, 3), sd_position=0, sd_heading=0).sample(
        5, np.random.default_rng(0)
    )
    assert draws.tolist() == [[1, 2, 3]] * 5


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
