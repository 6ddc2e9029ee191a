"""g(x', x) = exp(-β C): one for a free step, exp(-β) for one that collides."""

import math

import numpy as np
import pytest

from localizers.models.feasibility import FreeSpace


@pytest.mark.parametrize("beta", [0.0, 2.0, math.inf])
@pytest.mark.parametrize("radius", [0.0, 5.0, 20.0])
def test_a_step_whose_swept_disc_collides_is_charged_beta_and_a_free_one_nothing(
    room, beta, radius
):
    rng = np.random.default_rng(1)
    before = rng.uniform((0, 0, -3), (350, 300, 3), (2000, 3)).astype(np.float32).T
    after = before + rng.normal(0, 15, (3, 2000)).astype(np.float32)
    log_g = FreeSpace(floor_plan=room, radius=radius, beta=beta).log_g(before, after)
    collides = room.collides(before.T, after.T, radius)
    assert 0.1 < collides.mean() < 0.9
    assert log_g.dtype == np.float64
    assert np.array_equal(log_g, np.where(collides, -beta, 0.0))
