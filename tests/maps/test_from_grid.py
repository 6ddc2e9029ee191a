"""PolygonMap.from_grid: the same building in segments."""

import numpy as np
from grid_cases import grids, in_cells, office, somewhere
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from deqmcl_gym.maps import GridMap, PolygonMap
from deqmcl_gym.maps.polygons import close_pairs, crossings

ALIKE = ("obstacle", "free")  # to beams and robots


@settings(max_examples=100, deadline=None)
@given(grids(unknown=ALIKE), st.integers(0, 2**32 - 1))
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


@settings(max_examples=100, deadline=None)
@given(grids(longest=24, unknown=ALIKE), st.sampled_from([0.3, 0.8, 1.5, 4.0, 30.0]))
def test_a_thinned_outline_is_nowhere_farther_off_than_the_tolerance(grid, cells):
    """Also where holes touch by corners; what comes out is a map, which no outline crosses."""
    exact, plan = (PolygonMap.from_grid(grid, t * grid.resolution) for t in (0.0, cells))
    assert len(plan.obstacles) == len(exact.obstacles)
    assert len(plan.walls) <= len(exact.walls)
    for one, other in zip(_outlines(plan), _outlines(exact), strict=True):
        points, far = _along(one, grid.resolution / 8), grid.resolution / 16
        near = cKDTree(points).query(_along(other, grid.resolution / 8))[0].max()
        back = cKDTree(_along(other, grid.resolution / 8)).query(points)[0].max()
        assert max(near, back) <= cells * grid.resolution + far
    walls = plan.walls
    assert not np.isfinite(crossings(walls, close_pairs(walls, 0.0))).any()


def test_a_straight_slant_of_cells_becomes_a_few_walls():
    cells = np.triu(np.full((60, 60), 100, np.int8), 1)
    grid = GridMap(occupancy=cells, resolution=0.05)
    assert len(PolygonMap.from_grid(grid).walls) > 100
    assert len(PolygonMap.from_grid(grid, 0.05).walls) <= 5


def test_rooms_that_touch_by_a_corner_are_two():
    cells = np.full((8, 8), 100, np.int8)
    cells[1:4, 1:4] = cells[4:7, 4:7] = cells[7, 6] = 0
    plan = PolygonMap.from_grid(GridMap(occupancy=cells, resolution=1.0))
    assert plan.free([(5.5, 5.5)])[0]
    assert not plan.free([(2.5, 2.5)])[0]


def _outlines(plan):
    return [np.array(polygon) for polygon in (plan.outer, *plan.obstacles)]


def _along(corners, step):
    """Points of an outline, (n, 2), no farther apart than that."""
    pieces = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        n = int(np.hypot(*(end - start)) / step) + 2
        pieces.append(start + np.linspace(0, 1, n)[:, None] * (end - start))
    return np.vstack(pieces)
