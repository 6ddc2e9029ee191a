"""PolygonMap.distance against the plain NumPy reference, and against what else the map says."""

import numpy as np
import pytest
import reference
from sample_plans import PLANS, anywhere, awkward_poses

from deqmcl_gym.maps import Map

BAND = 1e-3  # px: coordinates of 700 px in float32, and a handful of operations on them


@pytest.mark.parametrize("name", PLANS)
def test_it_is_the_reference_clearance_inside_walls_and_outside_the_building_too(name):
    plan = PLANS[name]
    points = anywhere(plan, 20_000, np.random.default_rng(1), margin=60)
    expected = reference.clearance(plan.walls, points, points)
    assert plan.distance(points).dtype == np.float32
    np.testing.assert_allclose(plan.distance(points), expected, rtol=0, atol=BAND)
    np.testing.assert_array_equal(plan.distance(np.empty((0, 2))), [])


@pytest.mark.parametrize("name", PLANS)
def test_no_beam_is_shorter(name):
    plan, rng = PLANS[name], np.random.default_rng(3)
    poses = awkward_poses(plan, 20_000, rng)
    distance = plan.distance(poses)  # further columns are ignored
    seen = plan.ranges(poses, rng.uniform(-np.pi, np.pi, 8))
    inside = ~np.isnan(seen[:, 0])
    assert (seen[inside] >= distance[inside, None] - BAND).all()


def test_a_polygon_map_is_a_map():
    assert isinstance(PLANS["room"], Map)
