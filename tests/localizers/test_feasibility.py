"""g(x', x) = exp(-β C): one for a free step, exp(-β) for one that collides."""

import math

import numpy as np
import pytest

from deqmcl_gym.validation import InputError
from localizers.models.feasibility import FreeSpace

BEFORE = np.array([(50, 50, 0), (50, 150, 0), (50, 50, 0), (95, 150, 0)], dtype=np.float32).T
AFTER = np.array([(60, 50, 9), (300, 150, 0), (-5, 50, 0), (96, 150, 0)], dtype=np.float32).T


@pytest.mark.parametrize("beta", [0.0, 1.0, 10.0, math.inf])
def test_a_step_that_collides_is_charged_beta_and_a_free_one_nothing(room, beta):
    log_g = FreeSpace(floor_plan=room, radius=8.0, beta=beta).log_g(BEFORE, AFTER)
    assert log_g.dtype == np.float64
    assert log_g.tolist() == [0.0, -beta, -beta, -beta]


def test_collision_is_the_floor_plans_for_the_swept_disc(room):
    rng = np.random.default_rng(1)
    before = rng.uniform((0, 0, -3), (350, 300, 3), (2000, 3)).astype(np.float32).T
    after = before + rng.normal(0, 15, (3, 2000)).astype(np.float32)
    log_g = FreeSpace(floor_plan=room, radius=5.0, beta=2.0).log_g(before, after)
    collides = room.collides(before.T, after.T, 5.0)
    assert 0.2 < collides.mean() < 0.9
    assert np.array_equal(log_g, np.where(collides, -2.0, 0.0))


@pytest.mark.parametrize("beta", [-1, math.nan])
def test_a_negative_beta_or_nan_is_refused(room, beta):
    with pytest.raises(InputError, match=r"^beta is .* of 0 or more\.$"):
        FreeSpace(floor_plan=room, radius=8.0, beta=beta)
