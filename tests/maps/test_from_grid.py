"""PolygonMap.from_grid: the same building in segments."""

import numpy as np
from grid_cases import grids, in_cells, office, somewhere
from hypothesis import given, settings
from hypothesis import strategies as st

from deqmcl_gym.maps import GridMap, PolygonMap


@settings(max_examples=100, deadline=None)
@given(grids(), st.integers(0, 2**32 - 1))
def test_what_is_free_in_it_is_open_in_the_grid_and_seen_alike(grid, seed):
    """Points on lines between cells apart; rays past corners apart, which are seen or not."""
    plan, rng = PolygonMap.from_grid(grid), np.random.default_rng(seed)
    poses = np.column_stack([somewhere(grid, 300, rng), rng.uniform(-3, 3, 300)])
    at = in_cells(grid, poses)
    step = np.spacing(np.float32(max(map(abs, grid.bounds)))) / grid.resolution
    poses = poses[(np.abs(at - np.rint(at)) > 1e-3 + 4 * step).all(axis=1)]
    free = plan.free(poses)
    assert grid.free(poses)[free].all()
    near, far = plan.distance(poses[free]), grid.distance(poses[free])
    assert (near >= far - 1e-3 - 8 * step * grid.resolution).all()
    one, other = (form.ranges(poses[free], [0.0])[:, 0] for form in (plan, grid))
    assert (np.abs(one - other) > 1e-3 + 100 * step).sum() <= 2


def test_all_of_one_region_is_kept_with_what_stands_in_it():
    grid = office()
    plan, rng = PolygonMap.from_grid(grid), np.random.default_rng(0)
    assert len(plan.obstacles) > 5
    free = plan.free(somewhere(grid, 20_000, rng)).mean()
    assert abs(free - (~grid.solid).mean()) < 0.05


def test_a_room_within_a_wall_is_no_part_of_it_and_what_stands_there_neither():
    cells = np.zeros((20, 20), np.int8)
    cells[5:16, 5:16] = 100
    cells[7:14, 7:14] = 0
    cells[10, 10] = 100
    plan = PolygonMap.from_grid(GridMap(occupancy=cells, resolution=1.0))
    assert len(plan.outer) == 4
    assert [len(obstacle) for obstacle in plan.obstacles] == [4]
    assert not plan.free([(8.5, 8.5)])[0]
