"""The grid of clearances decides as the walls themselves do."""

import numpy as np
import pytest
import reference
from sample_plans import PLANS, anywhere, corners

from deqmcl_gym.maps import drive_kernels


@pytest.mark.parametrize("radius", [0.0, 0.01, 8.0, 25.0])
@pytest.mark.parametrize("name", PLANS)
def test_a_step_collides_by_the_grid_iff_it_does_by_all_walls(name, radius):
    plan, rng, n = PLANS[name], np.random.default_rng(3), 100_000
    near = rng.choice(corners(plan), n) + rng.normal(0, 10, (n, 2))
    starts = np.where(rng.random((n, 1)) < 0.3, near, anywhere(plan, n, rng, margin=30))
    length = rng.choice([0.0, 0.1, 5.0, 30.0, 400.0, 1e6], n) * rng.random(n)
    angle = rng.uniform(-np.pi, np.pi, n)
    ends = starts + length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    before, after = (np.ascontiguousarray(p.T, dtype=np.float32) for p in (starts, ends))
    square, windings = np.empty(n, np.float32), np.empty(n, np.int32)
    walls = plan.walls.astype(np.float32)
    drive_kernels.sweep(before, after, walls, square)
    drive_kernels.wind(after, walls, windings)
    expected = (square <= np.float32(radius) * np.float32(radius)) | (windings != 1)
    assert np.array_equal(plan.collides(starts, ends, radius), expected)


@pytest.mark.parametrize("name", PLANS)
def test_no_point_is_nearer_to_a_wall_than_its_square_says(name):
    plan = PLANS[name]
    corner, per_side, bounds = plan._clearance
    points = anywhere(plan, 20_000, np.random.default_rng(4))
    column, row = ((points - corner) * per_side).astype(int).T
    bound = bounds[row, column]
    assert (reference.clearance(plan.walls, points, points) >= np.abs(bound)).all()
    free = reference.winding(plan.walls, points) == 1
    assert free[bound > 0].all()
    assert not free[bound < 0].any()
