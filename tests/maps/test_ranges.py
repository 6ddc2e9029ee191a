"""PolygonMap.ranges: each is the exact range of some pose within 1e-3 px and 1e-5 rad."""

import math
from itertools import product

import numpy as np
import pytest
import reference
from sample_plans import PLANS, awkward_poses, corners

from deqmcl_gym.maps import Lidar, PolygonMap

# half is for the pose, as float32 cannot do better near a corner, half for the way along the beam
HALF_PX, HALF_RAD = 5e-4, 5e-6


def by_reference(plan: PolygonMap, poses: np.ndarray) -> tuple[np.ndarray, list]:
    """Ranges straight ahead and the walls they end at."""
    each = [reference.ranges(wall[None], poses, [0.0])[:, 0] for wall in plan.walls]
    return np.min(each, axis=0), np.argmin(each, axis=0).tolist()


def poses_nearby(plan: PolygonMap, pose: np.ndarray) -> np.ndarray:
    steps = np.array(list(product((-1, 0, 1), repeat=3))) * (HALF_PX, HALF_PX, HALF_RAD)
    moved = pose + steps
    to_corner = corners(plan)[None] - moved[:, None, :2]
    passing = np.arctan2(to_corner[..., 1], to_corner[..., 0])[..., None] + (-1e-10, 1e-10)
    turns = np.angle(np.exp(1j * (passing - pose[2])))
    row, corner, side = np.nonzero(np.abs(turns) <= HALF_RAD)
    past_corners = moved[row]
    past_corners[:, 2] = pose[2] + turns[row, corner, side]
    return np.vstack([moved, past_corners])


def is_range_of_a_pose_nearby(seen: float, plan: PolygonMap, pose: np.ndarray) -> bool:
    spread: dict[object, list[float]] = {}
    for exact, wall in zip(*by_reference(plan, poses_nearby(plan, pose)), strict=True):
        spread.setdefault(wall, []).append(exact)
    return any(min(r) - HALF_PX <= seen <= max(r) + HALF_PX for r in spread.values())


def violations(seen: np.ndarray, plan: PolygonMap, poses: np.ndarray) -> list[np.ndarray]:
    """Poses whose range is not the exact one of any pose nearby."""
    suspects = np.flatnonzero(~(np.abs(seen - by_reference(plan, poses)[0]) <= HALF_PX))
    return [
        poses[i] for i in suspects if not is_range_of_a_pose_nearby(float(seen[i]), plan, poses[i])
    ]


def inside_the_outer_wall(plan: PolygonMap, poses: np.ndarray) -> np.ndarray:
    """Poses (k, 3) inside the outer wall, clear of it by more than float32 resolves."""
    outer = plan.walls[: len(plan.outer)]
    clear = reference.clearance(outer, poses, poses) > 1e-3
    return poses[clear & (reference.winding(outer, poses[:, :2]) == 1)]


@pytest.mark.parametrize("name", PLANS)
def test_each_range_is_the_exact_range_of_a_pose_nearby(name):
    plan = PLANS[name]
    poses = inside_the_outer_wall(plan, awkward_poses(plan, 13_000, np.random.default_rng(1)))
    assert len(poses) > 10_000
    seen = plan.ranges(poses, [0.0])[:, 0]
    assert violations(seen, plan, poses) == []


def test_a_pose_has_the_same_bits_in_every_block():
    plan, bearings = PLANS["room"], Lidar(beams=3).bearings
    poses = awkward_poses(plan, 200, np.random.default_rng(5))
    one_by_one = np.vstack([plan.ranges(pose[None], bearings) for pose in poses])
    for n in (0, 1, 63, 64, 65, 200):
        np.testing.assert_array_equal(plan.ranges(poses[:n], bearings), one_by_one[:n])


def test_a_rectangular_room_is_blind_from_where_its_wall_does_not_wind_around_on_the_wall_too():
    rng = np.random.default_rng(5)
    for left, bottom, width, height in rng.uniform((-50, -50, 1, 1), (50, 50, 400, 400), (50, 4)):
        low = np.float32([left, bottom])
        high = np.float32([left + width, bottom + height])
        x0, y0, x1, y1 = map(float, (*low, *high))
        plan = PolygonMap(outer=((x0, y0), (x1, y0), (x1, y1), (x0, y1)))
        beside = np.nextafter((low, low, high, high), np.float32([[-1e9], [1e9], [-1e9], [1e9]]))
        xs, ys = np.vstack([low, high, beside, rng.uniform(low - 9, high + 9, (6, 2))]).T
        poses = np.array([(x, y, 1.0) for x, y in product(xs, ys)], np.float32)
        blind = np.isnan(plan.ranges(poses, [0.0])[:, 0])
        assert (blind == ~plan.free(poses)).all()  # ``free`` counts windings
        assert set(blind) == {True, False}


def squares(side: int, xs: range, ys: range) -> list:
    return [[(x, y), (x + side, y), (x + side, y + side), (x, y + side)] for x in xs for y in ys]


def test_a_wall_along_the_border_of_cells_is_not_missed():
    """A grid of squares whose edges fall on multiples of the cell's side."""
    boxes = squares(10, range(20, 380, 20), range(20, 380, 20))
    plan = PolygonMap([(0, 0), (400, 0), (400, 400), (0, 400)], boxes)
    between = np.arange(15.0, 390.0, 20.0)  # lanes without obstacles
    east = np.column_stack([np.full(between.size, 5.0), between, np.zeros(between.size)])
    assert plan.ranges(east, [0.0])[:, 0] == pytest.approx([395.0] * 19, abs=1e-3)
    blocked = east + np.array([0.0, 10.0, 0.0])
    assert plan.ranges(blocked[:-1], [0.0])[:, 0] == pytest.approx([15.0] * 18, abs=1e-3)


@pytest.mark.parametrize("beams", [1, 2, 9, 360])
@pytest.mark.parametrize("view", [0.1, math.pi / 2, 2 * math.pi])
def test_a_fan_is_spread_evenly_over_its_view_ahead_and_a_full_circle_has_no_twin_beam(beams, view):
    bearings = Lidar(beams=beams, field_of_view=view).bearings
    assert bearings.shape == (beams,)
    if view == 2 * math.pi:
        gaps = np.diff([*bearings, bearings[0] + view])  # all the way round
        assert gaps == pytest.approx(view / beams)
    else:
        assert np.diff(bearings) == pytest.approx(view / max(beams - 1, 1))
        assert bearings == pytest.approx(-bearings[::-1])
    assert beams > 1 or bearings.tolist() == [0.0]
