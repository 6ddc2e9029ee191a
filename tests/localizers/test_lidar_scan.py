"""LidarScan: a product over the usable beams; what is not usable is left out."""

import math

import numpy as np
import pytest

from deqmcl_gym.maps import Lidar
from deqmcl_gym.validation import InputError
from localizers import BeamModel, CensoredGaussianUniform, GaussianUniform
from localizers.models.scan import LidarScan, Scan

NAN, INF = math.nan, math.inf
LIDAR = Lidar(beams=5, field_of_view=2.0, max_range=400.0)
SCAN = np.array([60.0, 80.0, 250.0, 80.0, 60.0])
POSES = np.array(
    [(50, 50, 0.1), (300, 50, 1.5), (60, 250, -1.0), (175, 150, 0.0)], dtype=np.float32
).T


@pytest.fixture(params=[GaussianUniform(), CensoredGaussianUniform(sigma=20.0), BeamModel()])
def scan(request, room) -> LidarScan:
    return LidarScan(floor_plan=room, lidar=LIDAR, beam=request.param)


def told(model: LidarScan, ranges: np.ndarray, poses: np.ndarray = POSES) -> np.ndarray:
    return model.log_likelihood(poses, Scan.of(ranges, LIDAR.max_range))


def only(scan: LidarScan, beam: int) -> np.ndarray:
    """The likelihood of one beam, all others being unusable."""
    ranges = np.full(5, NAN)
    ranges[beam] = SCAN[beam]
    return told(scan, ranges)


@pytest.mark.parametrize("bad", [NAN, INF, -INF, -1e-9, 400.001, 1e9])
def test_a_scan_is_the_product_of_its_beams_but_for_those_that_are_no_number_in_range(scan, bad):
    # sums of five logs in another order: some units of float64
    each = np.array([only(scan, beam) for beam in range(5)])
    together = told(scan, SCAN)
    assert together == pytest.approx(each.sum(axis=0), rel=1e-12)
    assert np.ptp(together) > 0.1
    for beam in range(5):
        spoilt = SCAN.copy()
        spoilt[beam] = bad
        others = np.delete(each, beam, axis=0).sum(axis=0)
        assert told(scan, spoilt) == pytest.approx(others, rel=1e-12)
        assert Scan.of(spoilt, 400.0).usable.tolist() == [i != beam for i in range(5)]


@pytest.mark.parametrize("limit", [0.0, 400.0])
def test_zero_and_the_maximum_range_are_measurements(scan, limit):
    ranges = np.full(5, NAN)
    ranges[2] = limit
    assert Scan.of(ranges, 400.0).beams == 1
    assert np.ptp(told(scan, ranges)) > 0


@pytest.mark.parametrize("bad", [NAN, INF, -5.0, 401.0])
def test_a_scan_without_a_usable_beam_says_nothing(scan, bad):
    outside_too = np.hstack([POSES, np.array([[-50], [50], [0]], dtype=np.float32)])
    assert told(scan, np.full(5, bad), outside_too).tolist() == [0.0] * 5


def test_inside_the_solid_rectangle_its_own_walls_are_what_is_seen(scan):
    # At (175, 150, 0), in the solid: 75 px to the right. As published, feasibility is g's business.
    one = np.full(5, NAN)
    one[2] = 75.0
    likelihoods = told(scan, one)
    assert likelihoods.argmax() == 3


def test_many_poses_are_looked_at_block_by_block_each_by_itself(scan):
    poses = np.random.default_rng(2).uniform((-30, -30, -4), (380, 330, 4), (10_000, 3)).T
    together = told(scan, SCAN, poses)
    assert together[8200:8300].tolist() == told(scan, SCAN, poses[:, 8200:8300]).tolist()


class Hall:
    """A map of one's own: all walls are 80 px away."""

    @property
    def caster(self):
        return self

    def cast(self, poses, bearings, out):
        out[:] = 80.0


def test_any_map_and_any_beam_model_will_do():
    class Flat:
        def log_likelihood(self, ranges, expected, max_range):
            return (expected - 79.0).sum(axis=1).astype(float)

        def least_density(self, max_range):
            return 1.0

    scan = LidarScan(floor_plan=Hall(), lidar=LIDAR, beam=Flat())
    assert told(scan, SCAN).tolist() == [5.0] * 4
    del Flat.least_density
    for beam, lacking in ((Flat(), "least_density"), (None, "log_likelihood and least_density")):
        kind = type(beam).__name__
        with pytest.raises(InputError, match=rf"of type {kind}, without {lacking}: [^.]*\.$"):
            LidarScan(floor_plan=Hall(), lidar=LIDAR, beam=beam)
