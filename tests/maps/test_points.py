"""free, bounds, what lies outside and inside, and the orientation of the polygons given."""

import numpy as np
import pytest
import reference
from sample_plans import PLANS, anywhere, awkward_poses

from deqmcl_gym.maps import PolygonMap


@pytest.mark.parametrize("radius", [0.0, 8.0])
@pytest.mark.parametrize("name", PLANS)
def test_a_disc_is_free_iff_it_is_inside_the_outer_wall_in_no_obstacle_and_clear(name, radius):
    plan = PLANS[name]
    points = anywhere(plan, 10_000, np.random.default_rng(1), margin=50)
    clearance = reference.clearance(plan.walls, points, points)
    sure = np.abs(clearance - radius) > 1e-3
    expected = (clearance > radius) & (reference.winding(plan.walls, points) == 1)
    assert sure.mean() > 0.99
    assert 0.1 < expected.mean() < 0.8
    assert np.array_equal(plan.free(points, radius)[sure], expected[sure])


def test_nothing_is_free_at_nan_or_infinity():
    points = [(np.nan, 50.0), (50.0, np.nan), (np.inf, 50.0), (50.0, -np.inf)]
    assert not PLANS["room"].free(points).any()
    assert PLANS["room"].collides([(50.0, 50.0)] * 4, points, 8.0).all()


def test_bounds_are_the_smallest_box_around_the_outer_wall():
    assert PLANS["hall"].bounds == (0.0, 0.0, 400.0, 300.0)


@pytest.mark.parametrize("name", ["hall", "forest"])  # few walls, and many
def test_ranges_are_nan_outside_the_outer_wall_and_nowhere_else(name):
    plan = PLANS[name]
    rng = np.random.default_rng(4)
    points = anywhere(plan, 10_000, rng, margin=50)
    outer = plan.walls[: len(plan.outer)]
    points = points[reference.clearance(outer, points, points) > 1e-3]
    poses = np.column_stack([points, rng.uniform(-np.pi, np.pi, len(points))])
    nan = np.isnan(plan.ranges(poses, [-0.3, 0.3]))
    outside = reference.winding(outer, points) != 1
    assert 0.2 < outside.mean() < 0.8
    assert np.array_equal(nan, np.column_stack([outside, outside]))


@pytest.mark.parametrize("turned", ["outer", "obstacles"])
@pytest.mark.parametrize("name", PLANS)
def test_the_orientation_in_which_polygons_are_given_does_not_matter(name, turned):
    plan = PLANS[name]
    outer = plan.outer[::-1] if turned == "outer" else plan.outer
    solid = [o[::-1] if turned == "obstacles" else o for o in plan.obstacles]
    other = PolygonMap(outer, tuple(solid))
    rng = np.random.default_rng(5)
    poses = awkward_poses(plan, 5_000, rng)
    ends = anywhere(plan, 5_000, rng, margin=20)
    # The same walls in another order, from the other end: float32 rounds differently by a few
    # units in the last place, so answers near a decision may differ; ranges away from corners
    # and grazing must be the same to 1e-3 px.
    sure = np.abs(reference.clearance(plan.walls, poses, ends) - 8) > 1e-3
    assert np.array_equal(
        plan.collides(poses, ends, 8.0)[sure], other.collides(poses, ends, 8.0)[sure]
    )
    off_walls = reference.clearance(plan.walls, ends, ends) > 1e-3
    assert np.array_equal(plan.free(ends)[off_walls], other.free(ends)[off_walls])
    fan = np.random.default_rng(6).uniform(-np.pi, np.pi, 3)
    apart = np.abs(plan.ranges(poses, fan) - other.ranges(poses, fan))
    assert np.nanmedian(apart) < 1e-4
    assert np.nanmean(apart > 1e-3) < 0.01


@pytest.mark.parametrize("name", PLANS)
def test_walls_have_free_space_on_their_left(name):
    plan = PLANS[name]
    start, along = plan.walls[:, :2], plan.walls[:, 2:] - plan.walls[:, :2]
    left = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    middle = start + along / 2
    assert plan.free(middle + 0.1 * left).all()
    assert not plan.free(middle - 0.1 * left).any()


def test_what_is_given_is_not_kept_by_reference():
    outer, obstacle = [[0, 0], [100, 0], [100, 100], [0, 100]], [[20, 20], [40, 20], [40, 40]]
    plan = PolygonMap(outer, [obstacle])
    outer[1][0], obstacle[0][0] = 10_000, 99
    assert plan.bounds == (0.0, 0.0, 100.0, 100.0)
    assert plan.obstacles == (((20.0, 20.0), (40.0, 20.0), (40.0, 40.0)),)


@pytest.mark.parametrize("name", ["room", "hall", "forest"])  # a box, few walls, many
@pytest.mark.parametrize("poses", [1, 20])  # lanes over beams, over poses
def test_a_heading_that_is_not_finite_sees_nothing(name, poses):
    plan = PLANS[name]
    point = anywhere(plan, 2_000, np.random.default_rng(2), margin=0)
    point = point[plan.free(point, 1.0)][0]
    for heading in (np.nan, np.inf, -np.inf):
        found = plan.ranges([(*point, heading)] * poses, [0.0, 1.0])
        assert np.isnan(found).all()
    assert np.isfinite(plan.ranges([(*point, 0.0)] * poses, [0.0, 1.0])).all()
