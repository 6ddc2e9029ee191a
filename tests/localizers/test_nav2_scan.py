"""Nav2's scan models: weights against an independent implementation, by hand, and beam skipping."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from deqmcl_gym.maps import GridMap, Lidar, PolygonMap
from deqmcl_gym.world import Office
from localizers.models import nav2_scan
from localizers.models.nav2_scan import BeamCubes, LikelihoodField
from localizers.models.scan import Scan

LIDAR = Lidar(beams=180, field_of_view=math.pi, max_range=12.0)
FIELD = {"sigma": 0.2, "farthest": 2.0, "cell": 0.02}
# the robot at (2.025, 1.025) looks along x: beams to the right, ahead, to the left
HERE = np.array([[2.025], [1.025], [0.0]], np.float32)


@pytest.fixture(scope="module")
def building() -> GridMap:
    """A drawn office, turned and shifted, with a tenth of its cells unknown."""
    office = Office(seed=3, wings=1, corridors=1).grid
    cells = office.occupancy.copy()
    cells[np.random.default_rng(0).random(cells.shape) < 0.1] = -1
    there = {"resolution": office.resolution, "origin": (-3.0, 2.0, 0.3)}
    return GridMap(occupancy=cells, unknown="obstacle", **there)


def by_hand(building, lidar, poses, scan, *, step, farthest=2.0, sigma=0.2, hit=0.5, rand=0.5):
    """q of every used beam and pose, as Nav2's source has it, by the nearest occupied cell."""
    rows, columns = building.occupancy.shape
    at = np.argwhere(building.occupancy >= 65)[:, ::-1]
    tree = cKDTree(at)
    x0, y0, yaw = building.origin
    values = []
    for range_, bearing in list(zip(scan, lidar.bearings, strict=True))[::step]:
        if not 0 <= range_ < lidar.max_range:
            continue
        x = poses[:, 0] + range_ * np.cos(poses[:, 2] + bearing) - x0
        y = poses[:, 1] + range_ * np.sin(poses[:, 2] + bearing) - y0
        column = np.floor((x * math.cos(yaw) + y * math.sin(yaw)) / building.resolution)
        row = np.floor((y * math.cos(yaw) - x * math.sin(yaw)) / building.resolution)
        d = tree.query(np.column_stack([column, row]))[0] * building.resolution
        on = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        d = np.where(on, np.minimum(d, farthest), farthest)
        values.append(hit * np.exp(-(d**2) / (2 * sigma**2)) + rand / lidar.max_range)
    return np.array(values)


def log_w(model, poses: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    states = np.ascontiguousarray(poses, np.float32)
    return model.log_likelihood(states, Scan.of(ranges, model.lidar.max_range))


def thousand_poses(building) -> np.ndarray:
    x0, y0, x1, y1 = building.bounds
    low, high = (x0 - 1, y0 - 1, -math.pi), (x1 + 1, y1 + 1, math.pi)
    return np.random.default_rng(1).uniform(low, high, (1000, 3)).astype(np.float32)


def noisy_scan(building) -> np.ndarray:
    rng = np.random.default_rng(2)
    poses = thousand_poses(building)
    pose = poses[building.free(poses, 0.2)][:1]
    scan = building.ranges(pose, LIDAR.bearings)[0] + rng.normal(0, 0.05, LIDAR.beams)
    scan[[0, 9, 33, 60]] = [np.nan, 12.0, np.inf, 15.0]
    return scan


@pytest.mark.parametrize(
    ("product", "max_beams", "step"),
    [
        *((False, most, step) for most, step in ((60, 3), (30, 6), (200, 1), (2, 179))),
        # 180 beams by 50: this model rounds 3.6 up where the other has 179 // 49 = 3
        *((True, most, step) for most, step in ((60, 3), (50, 4), (200, 1))),
    ],
)
def test_weights_are_those_of_an_independent_implementation(building, product, max_beams, step):
    poses, scan = thousand_poses(building), noisy_scan(building)
    how = {"product": product, "max_beams": max_beams, **FIELD}
    field = LikelihoodField(floor_plan=building, lidar=LIDAR, **how)
    values = by_hand(building, LIDAR, poses.astype(float), scan, step=step)
    cubes = np.log(1 + (values**3).sum(axis=0))
    expected = np.log(values).sum(axis=0) if product else cubes
    np.testing.assert_allclose(np.exp(log_w(field, poses.T, scan) - expected), 1.0, rtol=1e-6)
    assert cubes.max() > 0.1


def three_beams(**params) -> dict:
    """A hall of 6 m x 4 m with one occupied cell at (3.025, 1.025), unknown from x = 5 m on."""
    cells = np.zeros((80, 120), np.int8)
    cells[20, 60] = 100
    cells[:, 100:] = -1
    hall = GridMap(occupancy=cells, resolution=0.05)
    lidar = Lidar(beams=3, field_of_view=math.pi, max_range=10.0)
    return {"floor_plan": hall, "lidar": lidar, **params}


def test_three_beams_of_the_beam_model_weigh_as_computed_by_hand():
    # rays: 1.025 m to the edge of the map; 0.975 m to the cell's face; 2.975 m to the edge
    scan = np.array([0.9, 1.2, 10.0])
    short, random = 0.05 * 0.1 * math.exp(-0.1 * 0.9), 0.5 / 10.0
    hits = [0.5 * math.exp(-(off**2) / 0.08) for off in (0.125, 0.225, 7.025)]
    q = [hits[0] + short + random, hits[1] + random, hits[2] + 0.05]
    told = log_w(BeamCubes(**three_beams()), HERE, scan)
    assert math.exp(told[0]) == pytest.approx(1 + sum(v**3 for v in q), rel=1e-5)
    lost = log_w(BeamCubes(**three_beams()), HERE, np.array([np.nan, 1.2, np.inf]))
    assert math.exp(lost[0]) == pytest.approx(1 + q[1] ** 3 + q[2] ** 3, rel=1e-5)


@pytest.mark.parametrize("unknown", ["free", "obstacle"])
def test_rays_stop_at_unknown_cells_whatever_the_map_says_of_them(unknown):
    setting = three_beams()
    setting["floor_plan"] = replace(setting["floor_plan"], unknown=unknown)
    at = np.array([[4.0], [2.0], [0.0]], np.float32)
    there = log_w(BeamCubes(**setting), at, np.array([np.nan, 1.0, np.nan]))  # x = 5 m
    beyond = log_w(BeamCubes(**setting), at, np.array([np.nan, 2.0, np.nan]))
    assert math.exp(there[0]) == pytest.approx(1 + 0.55**3, rel=1e-5)
    assert math.exp(beyond[0]) == pytest.approx(1 + 0.05**3, rel=1e-5)


def test_a_map_without_an_occupied_cell_is_as_far_from_walls_as_can_be():
    hall = GridMap(occupancy=np.zeros((20, 20), np.int8), resolution=0.05)
    assert np.isinf(nav2_scan.DistanceTable.of(hall, 2.0, 0.02).squares).all()


def test_the_table_of_polygons_is_the_distance_of_its_cells_centres_also_around_the_map():
    room = PolygonMap(outer=[(0, 0), (6, 0), (6, 4), (0, 4)], unit="m")
    table = nav2_scan.DistanceTable.of(room, 1.0, 0.1)
    assert table.frame == (-1.0, -1.0, 1.0, 0.0, 0.1)
    assert table.squares.shape == (60, 80)
    ys, xs = (np.indices(table.squares.shape) + 0.5) * 0.1 - 1.0
    inside = np.minimum(np.minimum(xs, 6 - xs), np.minimum(ys, 4 - ys))
    off = np.hypot(np.maximum(np.maximum(-xs, xs - 6), 0), np.maximum(np.maximum(-ys, ys - 4), 0))
    exact = np.minimum(np.where(inside > 0, inside, off), 1.0)
    told = np.minimum(0.1 * np.sqrt(table.squares.astype(float)), 1.0)
    np.testing.assert_allclose(told, exact, atol=1e-5)  # float32 of 7 m


def skipping_case(error_threshold: float):
    """Ten beams, of which three end where there is nothing for most of 20 particles."""
    cells = np.zeros((80, 120), np.int8)
    cells[:, 60] = 100
    hall = GridMap(occupancy=cells, resolution=0.05)
    lidar = Lidar(beams=10, field_of_view=0.2, max_range=10.0)
    field = LikelihoodField(floor_plan=hall, lidar=lidar, max_beams=10, product=True, **FIELD)
    scan = np.full(10, 1.0)
    scan[[2, 5, 7]] = 0.3
    states = np.zeros((3, 20), np.float32)
    states[0], states[1] = 2.025, 2.0
    limits = {"distance": 0.5, "threshold": 0.3, "error_threshold": error_threshold}
    skipping = nav2_scan.BeamSkipping(field=field, **limits)
    return skipping, states, scan


def kept(skipping, states, ranges):
    scan = Scan.of(ranges, skipping.field.lidar.max_range)
    left = skipping.kept(states, np.zeros(states.shape[1]), scan)
    assert left.beams == np.isfinite(left.ranges).sum() == left.usable.sum()
    return left.ranges


def test_beams_with_which_few_particles_agree_are_skipped_unless_too_many_would_be():
    skipping, states, scan = skipping_case(0.4)
    expected = scan.copy()
    expected[[2, 5, 7]] = np.nan
    np.testing.assert_array_equal(kept(skipping, states, scan), expected)
    states[0, :6] = 2.725  # 6 of 20, not more than 30 %, agree with the short beams
    np.testing.assert_array_equal(kept(skipping, states, scan), expected)
    states[0, 6] = 2.725  # 7 of 20 do
    np.testing.assert_array_equal(kept(skipping, states, scan), scan)
    skipping, states, scan = skipping_case(0.4)
    scan[0] = np.nan  # three disagree, one has no return: four of ten
    np.testing.assert_array_equal(kept(skipping, states, scan), scan)
    skipping, states, scan = skipping_case(0.3)  # 3 of 10 are as many as may be lost
    np.testing.assert_array_equal(kept(skipping, states, scan), scan)
