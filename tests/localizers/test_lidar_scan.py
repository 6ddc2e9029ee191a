"""LidarScan: a product over the usable beams; what is not usable is left out."""

import math

import numpy as np
import pytest

from deqmcl_gym.maps import Lidar, PolygonMap
from localizers import BeamModel, CensoredGaussianUniform, GaussianUniform
from localizers.models import scan_kernels
from localizers.models.scan import OUTSIDE, LidarScan, usable_beams

NAN, INF = math.nan, math.inf
LIDAR = Lidar(beams=5, field_of_view=2.0, max_range=400.0)
SCAN = np.array([60.0, 80.0, 250.0, 80.0, 60.0])
POSES = np.array(
    [(50, 50, 0.1), (300, 50, 1.5), (60, 250, -1.0), (175, 150, 0.0)], dtype=np.float32
).T


@pytest.fixture(params=[GaussianUniform(), CensoredGaussianUniform(sigma=20.0), BeamModel()])
def scan(request, room) -> LidarScan:
    return LidarScan(floor_plan=room, lidar=LIDAR, beam=request.param)


def only(scan: LidarScan, beam: int) -> np.ndarray:
    """The likelihood of one beam, all others being unusable."""
    ranges = np.full(5, NAN)
    ranges[beam] = SCAN[beam]
    return scan.log_likelihood(POSES, ranges)


def test_a_scan_is_the_product_of_its_beams(scan):
    together = scan.log_likelihood(POSES, SCAN)
    assert together.dtype == np.float64
    # sums of five logs in another order: some units of float64
    assert together == pytest.approx(sum(only(scan, beam) for beam in range(5)), rel=1e-12)
    assert np.ptp(together) > 0.1


def test_a_beams_likelihood_is_its_density_at_the_exact_range(scan, room):
    expected = room.ranges(POSES.T, LIDAR.bearings).astype(np.float64)
    density = scan.beam.density(SCAN, expected, 400.0)
    assert scan.log_likelihood(POSES, SCAN) == pytest.approx(np.log(density).sum(axis=1), rel=1e-12)


@pytest.mark.parametrize("bad", [NAN, INF, -INF, -1e-9, 400.001, 1e9])
@pytest.mark.parametrize("beam", range(5))
def test_a_beam_that_is_no_number_within_the_range_is_skipped(scan, beam, bad):
    spoilt = SCAN.copy()
    spoilt[beam] = bad
    seen = scan.log_likelihood(POSES, spoilt)
    others = sum(only(scan, other) for other in range(5) if other != beam)
    assert seen == pytest.approx(others, rel=1e-12)
    assert usable_beams(spoilt, 400.0).tolist() == [i != beam for i in range(5)]


@pytest.mark.parametrize("limit", [0.0, 400.0])
def test_zero_and_the_maximum_range_are_measurements(scan, limit):
    ranges = np.full(5, NAN)
    ranges[2] = limit
    assert usable_beams(ranges, 400.0).sum() == 1
    assert np.ptp(scan.log_likelihood(POSES, ranges)) > 0


@pytest.mark.parametrize("bad", [NAN, INF, -5.0, 401.0])
def test_a_scan_without_a_usable_beam_says_nothing(scan, bad):
    outside_too = np.hstack([POSES, np.array([[-50], [50], [0]], dtype=np.float32)])
    assert scan.log_likelihood(outside_too, np.full(5, bad)).tolist() == [0.0] * 5


def test_a_pose_outside_the_outer_wall_gets_minus_thirty_for_the_whole_scan(scan):
    outside = np.array([(-50, 50, 0), (400, 150, 3), (50, 301, 1), (50, 50, 0)], dtype=np.float32).T
    seen = scan.log_likelihood(outside, SCAN)
    assert seen[:3].tolist() == [OUTSIDE] * 3 == [-30.0] * 3
    assert seen[3] != OUTSIDE


def test_inside_the_solid_rectangle_its_own_walls_are_what_is_seen(scan):
    # At (175, 150, 0), in the solid: 75 px to the right. As published, feasibility is g's business.
    one = np.full(5, NAN)
    one[2] = 75.0
    likelihoods = scan.log_likelihood(POSES, one)
    assert likelihoods.argmax() == 3


def test_what_is_given_is_left_alone(scan):
    poses, ranges = POSES.copy(), np.array([60.0, NAN, 250.0, INF, -1.0])
    before = ranges.copy()
    scan.log_likelihood(poses, ranges)
    assert np.array_equal(poses, POSES)
    assert np.array_equal(ranges, before, equal_nan=True)


HALL = PolygonMap(
    outer=[(0, 0), (350, 0), (350, 300), (100, 300), (0, 200)],
    obstacles=(
        [(100, 100), (150, 100), (150, 200), (100, 200)],
        [(200, 150), (300, 150), (300, 260), (200, 260)],
        [(200, 50), (300, 50), (250, 90)],
    ),
)


@pytest.mark.parametrize("beam", [GaussianUniform(sigma=20.0), CensoredGaussianUniform(sigma=20.0)])
@pytest.mark.parametrize("n", [1, 7, 8, 512, 1001, 8192, 10_000])
@pytest.mark.parametrize("hall", [False, True])
def test_one_pass_gives_the_bits_of_step_by_step(room, hall, beam, n):
    rng = np.random.default_rng(n)
    scan = LidarScan(floor_plan=HALL if hall else room, lidar=LIDAR, beam=beam)
    poses = rng.uniform((-30, -30, -4), (380, 330, 4), (n, 3)).astype(np.float32).T
    ends = np.array([0.0, 80.0, 400.0, 80.0, 60.0])
    for ranges in (SCAN, ends) if type(beam) is GaussianUniform else (SCAN,):
        seen = np.empty(n)
        rows = np.ascontiguousarray(poses)
        assert scan_kernels.scan_mixture(rows, ranges, seen, *scan._one_pass)
        assert seen.tolist() == scan._of_usable_beams(poses, ranges).tolist()
        assert seen.tolist() == scan.log_likelihood(poses, ranges).tolist()


def test_one_pass_is_for_all_beams_usable_and_none_at_an_end_that_is_an_atom(room):
    poses = np.ascontiguousarray(POSES)
    out = np.empty(4)
    for beam, ends in ((GaussianUniform(), True), (CensoredGaussianUniform(), False)):
        scan = LidarScan(floor_plan=room, lidar=LIDAR, beam=beam)
        for value, taken in ((60.0, True), (0.0, ends), (400.0, ends), (NAN, False), (-1.0, False)):
            ranges = SCAN.copy()
            ranges[2] = value
            assert scan_kernels.scan_mixture(poses, ranges, out, *scan._one_pass) == taken
        assert not scan_kernels.scan_mixture(poses, SCAN[:4], out, *scan._one_pass)
    assert LidarScan(floor_plan=room, lidar=LIDAR, beam=BeamModel())._one_pass is None


def test_a_beam_model_that_weighs_in_its_own_way_is_asked(room):
    class Flat(GaussianUniform):
        def log_likelihood(self, ranges, expected, max_range):
            return np.zeros(len(expected))

    scan = LidarScan(floor_plan=room, lidar=LIDAR, beam=Flat())
    assert scan.log_likelihood(POSES, SCAN).tolist() == [0.0] * 4
