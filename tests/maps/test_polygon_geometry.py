"""Points, discs, steps and rays among polygons, steps among cells: exact to single precision."""

import math
from itertools import product

import numpy as np
import pytest
import reference
from grid_cases import grids, office, somewhere
from hypothesis import given, settings
from hypothesis import strategies as st

from deqmcl_gym.maps import GridMap, Lidar, Map, PolygonMap
from deqmcl_gym.world import PAPER_ROOM, WORLDS
from deqmcl_gym.world.course import Course

# A U-shaped hall with a C-shaped, a triangular and a tilted obstacle; orientations mixed.
HALL = PolygonMap(
    outer=[(0, 0), (400, 0), (400, 300), (250, 300), (230, 190), (150, 200), (150, 300), (0, 300)],
    obstacles=[
        [(60, 60), (120, 60), (120, 80), (80, 80), (80, 120), (120, 120), (120, 140), (60, 140)],
        [(250, 50), (270, 120), (320, 70)],
        [(170, 30), (210, 50), (190, 90), (150, 70)],
    ],
)
BAND = 1e-3  # px: coordinates of 700 px in float32, and a handful of operations on them
OFFICE = office()
# of a pose, as float32 cannot do better near a corner, and of the way along the beam
HALF_PX, HALF_RAD = 5e-4, 5e-6


def _forest() -> PolygonMap:
    """A room with many obstacles: tilted squares, and upright ones that share their lines."""
    rng = np.random.default_rng(0)
    squares = []
    for x, y in np.ndindex(8, 6):
        turns = np.arange(4) * np.pi / 2 + (np.pi / 4 if (x + y) % 3 == 0 else rng.uniform(0, 1.5))
        centre = 45 + 90 * np.array([x, y])
        squares.append(centre + 14 * np.column_stack([np.cos(turns), np.sin(turns)]))
    return PolygonMap([(0, 0), (720, 0), (720, 540), (0, 540)], [s.tolist() for s in squares])


PLANS = {"room": PAPER_ROOM, "hall": HALL, "forest": _forest()}


def corners(plan: PolygonMap) -> np.ndarray:
    return np.vstack([plan.outer, *plan.obstacles])


def anywhere(plan: PolygonMap, n: int, rng: np.random.Generator, margin: float = 0.0) -> np.ndarray:
    """Uniform points in the plan's box and ``margin`` around it, (n, 2) px."""
    x0, y0, x1, y1 = plan.bounds
    return rng.uniform((x0 - margin, y0 - margin), (x1 + margin, y1 + margin), (n, 2))


def awkward_poses(plan: PolygonMap, n: int, rng: np.random.Generator) -> np.ndarray:
    """Poses (n, 3): a third heads exactly for a corner, a sixth runs parallel to the axes."""
    points = anywhere(plan, n, rng)
    headings = rng.uniform(-np.pi, np.pi, n)
    target = rng.choice(corners(plan), n) - points
    kind = rng.integers(0, 6, n)
    headings = np.where(kind <= 1, np.arctan2(target[:, 1], target[:, 0]), headings)
    headings = np.where(kind == 2, rng.integers(-2, 3, n) * np.pi / 2, headings)
    return np.column_stack([points, headings])


@pytest.mark.parametrize("name", PLANS)
def test_a_point_is_as_far_from_walls_as_the_reference_says_and_free_iff_within_and_clear(name):
    plan = PLANS[name]
    points = anywhere(plan, 10_000, np.random.default_rng(1), margin=60)
    clearance = reference.clearance(plan.walls, points, points)
    assert plan.distance(points).dtype == np.float32
    np.testing.assert_allclose(plan.distance(points), clearance, rtol=0, atol=BAND)
    np.testing.assert_array_equal(plan.distance(np.empty((0, 2))), [])
    inside = reference.winding(plan.walls, points) == 1
    for radius in (0.0, 8.0):
        sure, expected = np.abs(clearance - radius) > BAND, inside & (clearance > radius)
        assert sure.mean() > 0.99
        assert 0.1 < expected.mean() < 0.8
        assert np.array_equal(plan.free(points, radius)[sure], expected[sure])


def test_nothing_is_free_at_nan_or_infinity():
    points = [(np.nan, 50.0), (50.0, np.nan), (np.inf, 50.0), (50.0, -np.inf)]
    assert not PLANS["room"].free(points).any()
    assert PLANS["room"].collides([(50.0, 50.0)] * 4, points, 8.0).all()


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


def test_what_is_given_is_not_kept_by_reference():
    outer, obstacle = [[0, 0], [100, 0], [100, 100], [0, 100]], [[20, 20], [40, 20], [40, 40]]
    plan = PolygonMap(outer, [obstacle])
    outer[1][0], obstacle[0][0] = 10_000, 99
    assert plan.bounds == (0.0, 0.0, 100.0, 100.0)
    assert plan.obstacles == (((20.0, 20.0), (40.0, 20.0), (40.0, 40.0)),)


MAPS = [PLANS["room"], GridMap(occupancy=np.zeros((9, 9), int), resolution=1.0)]


@pytest.mark.parametrize("owner", [*MAPS, Course.of(WORLDS["paper"])])
def test_what_a_map_or_course_hands_out_cannot_be_changed(owner):
    for name in {"walls", "solid", "occupied", "actions"} & {*dir(owner)}:
        with pytest.raises(ValueError, match="read-only"):
            getattr(owner, name)[0] = 1


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


def random_steps(plan: PolygonMap, n: int, rng, longest=(0.1, 5.0, 30.0, 400.0)):
    """Starts and ends anywhere, also in solids and outside, or near corners; some do not move."""
    starts = anywhere(plan, n, rng, margin=30)
    near = rng.choice(corners(plan), n) + rng.normal(0, 10, (n, 2))
    starts = np.where(rng.random((n, 1)) < 0.3, near, starts)
    length = rng.choice([0.0, *longest], n) * rng.random(n)
    angle = rng.uniform(-np.pi, np.pi, n)
    return starts, starts + length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("radius", [0.0, 0.01, 8.0, 25.0])
@pytest.mark.parametrize("name", PLANS)
def test_a_step_collides_iff_it_comes_near_a_wall_or_ends_outside_free_space(name, radius):
    plan = PLANS[name]
    starts, ends = random_steps(plan, 2_000, np.random.default_rng(1))

    def exact(shift: tuple[float, float]) -> np.ndarray:
        near = reference.clearance(plan.walls, starts + shift, ends + shift) <= radius
        return near | (reference.winding(plan.walls, ends + shift) != 1)

    # clear-cut are answers that no shift of the step by BAND changes
    answers = np.array([exact((sx * BAND, sy * BAND)) for sx in (-1, 1) for sy in (-1, 1)])
    clear_cut = (answers == answers[0]).all(axis=0)
    assert clear_cut.mean() > 0.99  # the band excuses next to nothing
    assert 0.05 < answers[0].mean() < 0.999  # both answers occur
    seen = plan.collides(starts, ends, radius)
    assert np.flatnonzero((seen != answers[0]) & clear_cut).tolist() == []


def test_neither_further_columns_nor_the_number_of_steps_change_an_answer():
    plan = PLANS["hall"]
    starts, ends = random_steps(plan, 200, np.random.default_rng(4))
    together = plan.collides(starts, ends, 8.0)
    headings = np.full((200, 1), 2.0)
    poses, after = np.hstack([starts, headings]), np.hstack([ends, headings])
    for n in (0, 1, 63, 64, 65, 200):
        assert plan.collides(poses[:n], after[:n], 8.0).tolist() == together[:n].tolist()


def poses_around(grid, n, rng) -> np.ndarray:
    """Poses on the map and around it, one of them lost, rows (3, n) float32."""
    points = somewhere(grid, n, rng, margin=2.0)
    poses = np.float32(np.column_stack([points, rng.uniform(-4, 4, n)])).T.copy()
    poses[:, rng.integers(n)] = np.nan
    return poses


@settings(max_examples=200)
@given(
    grid=st.one_of(grids(), st.just(OFFICE)),
    n=st.sampled_from([1, 7, 700, 2100]),
    steps=st.integers(1, 9),
    cells=st.sampled_from([0.0, 0.3, 2.0, 9.0]),
    radius=st.sampled_from([0.0, 0.2, 1.0, 3.4]),
    seed=st.integers(0, 2**32 - 1),
)
def test_both_count_the_steps_that_collide_on_a_grid(grid, n, steps, cells, radius, seed):
    rng, size = np.random.default_rng(seed), radius * grid.resolution
    poses = poses_around(grid, n, rng)
    moves = rng.normal(0, 1, (steps, 2)) * cells * grid.resolution
    path = np.vstack([np.zeros((1, 2)), np.cumsum(moves, axis=0)]).astype(np.float32)
    hits = Map.collisions_along(grid, poses, path, size)
    assert np.array_equal(grid.collisions_along(poses, path, size), hits)


@pytest.mark.parametrize("name", PLANS)
def test_each_range_is_the_exact_range_of_a_pose_nearby(name):
    plan = PLANS[name]
    poses = awkward_poses(plan, 13_000, np.random.default_rng(1))
    outer = plan.walls[: len(plan.outer)]
    clear = reference.clearance(outer, poses, poses) > 1e-3
    poses = poses[clear & (reference.winding(outer, poses[:, :2]) == 1)]
    assert len(poses) > 10_000
    seen = plan.ranges(poses, [0.0])[:, 0]
    off = np.abs(seen - reference.ranges(plan.walls, poses, [0.0])[:, 0])
    assert (off <= HALF_PX).mean() > 0.6  # all but those that pass a corner, or along a wall
    for k in np.flatnonzero(~(off <= HALF_PX)):
        turns = np.array(list(product((-1, 0, 1), repeat=3))) * (HALF_PX, HALF_PX, HALF_RAD)
        nearby = reference.ranges(plan.walls, poses[k] + turns, [0.0])
        assert nearby.min() - HALF_PX <= seen[k] <= nearby.max() + HALF_PX


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


def test_a_wall_along_the_border_of_cells_is_not_missed():
    """A grid of squares whose edges fall on multiples of the cell's side."""
    corners = product(range(20, 380, 20), repeat=2)
    boxes = [[(x, y), (x + 10, y), (x + 10, y + 10), (x, y + 10)] for x, y in corners]
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
