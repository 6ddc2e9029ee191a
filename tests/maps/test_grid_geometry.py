"""GridMap against float64 geometry of its cells one by one."""

import math

import grid_cases
import numpy as np
import pytest
from grid_cases import box_distance, boxes, edge_distance, grids, in_cells, is_solid, somewhere
from hypothesis import given, settings
from hypothesis import strategies as st

from deqmcl_gym.maps import GridMap
from deqmcl_gym.maps.grid_kernels import first_contact

SEEDS = st.integers(0, 2**32 - 1)
# cells: at 6 km from (0, 0), float64 resolves 1e-12 m; single precision does positions in cells of
# a table of 14 cells to 1e-6 and directions to 2e-7
EXACT, SINGLE = 1e-6, 1e-4


def entered(at, heading, corners):
    """How far a ray from (2,) goes until it enters and until it leaves unit squares (k, 2)."""
    way = np.array([np.cos(heading), np.sin(heading)])
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = (corners - at) / way, (corners + 1 - at) / way
    enter, leave = np.minimum(one, two).max(axis=1), np.maximum(one, two).min(axis=1)
    hit = (enter <= leave) & (enter >= 0)
    return enter[hit].min(initial=np.inf), leave


def seen(grid, pose):
    """Range of one ray in cells: to a solid cell from an open one, to an open one from within."""
    at, heading = in_cells(grid, pose[None])[0], pose[2] - grid.origin[2]
    inside = bool(is_solid(grid, at[None], "beams")[0])
    nearest, _ = entered(at, heading, boxes(grid, solid=not inside, what="beams"))
    if grid.unknown == "transparent" and not inside:
        return nearest
    way, size = np.array([np.cos(heading), np.sin(heading)]), grid.occupancy.shape[::-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        return min(nearest, np.maximum(-at / way, (size - at) / way).min())  # or leaves the map


@settings(max_examples=150)
@given(grids(), SEEDS)
def test_a_ray_ends_where_it_first_enters_a_cell_of_the_other_kind(grid, seed):
    """Rays so close to a corner that rounding decides are those that turned by 1e-5 differ much."""
    rng = np.random.default_rng(seed)
    poses = np.column_stack([somewhere(grid, 20, rng), rng.uniform(-4, 4, 20)])
    bearings = rng.uniform(-np.pi, np.pi, 3)
    found = grid.ranges(poses, bearings) / grid.resolution
    assert found.dtype == np.float32
    for row, pose in zip(found, poses, strict=True):
        for ray, bearing in zip(row, bearings, strict=True):
            turned = (np.array([0, 0, bearing + turn]) for turn in (-1e-5, 0.0, 1e-5))
            beside = [seen(grid, pose + turn) for turn in turned]
            assert min(beside) - SINGLE <= ray <= max(beside) + SINGLE


def test_beams_pass_transparent_cells_and_the_edge_behind_them_and_robots_do_not():
    cells = np.array([[0, 0, -1, -1, 100], [0, 0, -1, -1, -1]], np.int8)
    grid = GridMap(occupancy=cells, resolution=1.0, unknown="transparent")
    poses = [(0.5, 0.5, 0.0), (0.5, 1.5, 0.0), (2.5, 0.5, 0.0), (0.5, 0.5, math.pi)]
    assert grid.ranges(poses, [0.0])[:, 0].tolist() == [3.5, math.inf, 1.5, math.inf]
    assert grid.free([(1.5, 0.5), (2.5, 0.5)]).tolist() == [True, False]
    assert grid.collides([(1.5, 0.5)], [(2.5, 0.5)], 0.1)[0]
    assert grid.distance([(1.25, 1.0)])[0] == 0.75
    contact = first_contact((0.5, 1.0), (3.5, 1.0), grid.cells[0], grid.cells[3], 0.25)
    assert contact == pytest.approx(1.25 / 3)
    ahead = np.array([[0, 0], [1, 0], [2, 0]], "f4")
    assert grid.collisions_along(np.array([[0.5], [1.0], [0.0]], "f4"), ahead, 0.1).tolist() == [1]
    assert grid.occupied.tolist() == (cells == 100).tolist()
    assert (grid.solid == (cells != 0)).all()


def test_no_ray_slips_between_two_cells_that_touch_by_a_corner():
    grid = GridMap(occupancy=100 * np.eye(8, dtype=np.int8), resolution=1.0)
    poses = [(7.5, k + 0.5, 3 * math.pi / 4) for k in range(7)]
    np.testing.assert_array_less(grid.ranges(poses, [0.0])[:, 0], 6)
    through = [(k + 1.5, k + 0.5, 3 * math.pi / 4) for k in range(6)]  # exactly at the corners
    np.testing.assert_allclose(grid.ranges(through, [0.0])[:, 0], math.sqrt(0.5), atol=1e-6)


def test_poses_that_are_not_on_the_map_see_nothing():
    grid = grid_cases.office()
    poses = [(math.nan, 3, 0), (0, 3, math.nan), (-50, 3, 0), (1e30, -1e30, 0), (math.inf, 0, 0)]
    assert np.isnan(grid.ranges(poses, [0.0, 1.0])).all()
    nowhere = [pose for pose in poses if not math.isnan(pose[2])]
    assert not grid.free(nowhere).any()
    assert not grid.free(nowhere, 0.1).any()
    assert grid.collides(nowhere, nowhere, 0.1).all()


@settings(max_examples=150)
@given(grids(), SEEDS, st.floats(0.0, 3.0))
def test_a_swept_disc_collides_if_a_solid_cell_or_edge_is_within_its_radius(grid, seed, radius):
    """The oracle looks at 400 places of a path, so that it overrates its distance by a little."""
    rng = np.random.default_rng(seed)
    starts = somewhere(grid, 30, rng, margin=1)
    ends = starts + rng.normal(0, 2 * grid.resolution, (30, 2)) * (rng.random((30, 1)) < 0.8)
    shares = np.linspace(0, 1, 400)[:, None]
    collides = grid.collides(starts, ends, radius * grid.resolution)
    for start, end, hit in zip(in_cells(grid, starts), in_cells(grid, ends), collides, strict=True):
        path = start + shares * (end - start)
        on_map = (path >= 0).all() and (path < grid.occupancy.shape[::-1]).all()
        cells = box_distance(path, boxes(grid))
        clear = min(cells.min(initial=np.inf), edge_distance(grid, path).min())
        overrated = (math.dist(start, end) / 399) ** 2 / 8 / max(radius, 0.1) + EXACT
        if not on_map or clear <= radius - EXACT:
            assert hit
        elif clear > radius + overrated + EXACT:
            assert not hit


@settings(max_examples=100)
@given(grids(), SEEDS, st.floats(0.0, 2.0))
def test_distance_is_that_of_the_nearest_cell_of_the_other_kind_or_the_edge(grid, seed, radius):
    """And free is what lies in an open cell and has a distance of more than the radius."""
    points = somewhere(grid, 60, np.random.default_rng(seed), margin=2)
    at = in_cells(grid, points)
    expected = edge_distance(grid, at)
    inside = (at >= 0).all(axis=1) & (at < grid.occupancy.shape[::-1]).all(axis=1)
    for k in np.flatnonzero(inside):
        other = boxes(grid, solid=not is_solid(grid, at[[k]])[0])
        expected[k] = min(expected[k], box_distance(at[[k]], other).min(initial=np.inf))
    found = grid.distance(points) / grid.resolution
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=EXACT)
    inside[inside] = ~is_solid(grid, at[inside])
    sure, free = np.abs(expected - radius) > EXACT, inside & (expected > radius)
    np.testing.assert_array_equal(grid.free(points, radius * grid.resolution)[sure], free[sure])
