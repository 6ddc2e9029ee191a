"""Outside the building no scan is likelier than at any pose inside it, and each beam counts."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.validation import LARGEST
from localizers import BeamModel, CensoredGaussianUniform, GaussianUniform
from localizers.models.scan import LidarScan, Scan, ScanTable

SHARES = st.one_of(st.sampled_from([0.0, 1e-300, 1e-16, 0.05, 1.0]), st.floats(0, 1))


def sizes(*usual: float):
    """The sizes given, and any between the smallest and the largest."""
    exponents = st.floats(np.log10(usual[0]), np.log10(usual[-1]))
    return st.sampled_from(usual) | exponents.map(lambda e: min(10.0**e, usual[-1]))


@st.composite
def maps(draw) -> PolygonMap:
    """A room of any proportions, with a solid rectangle in it or none."""
    width, height = draw(st.floats(5, 800)), draw(st.floats(5, 800))
    outer = [(0, 0), (width, 0), (width, height), (0, height)]
    solid = [(x * width, y * height) for x, y in [(0.3, 0.3), (0.6, 0.3), (0.6, 0.7), (0.3, 0.7)]]
    return PolygonMap(outer=outer, obstacles=draw(st.sampled_from([[], [solid]])))


@st.composite
def scan_models(draw) -> LidarScan:
    """Every model there is, at any noise, and any shares, none too."""
    floor_plan, max_range = draw(maps()), draw(sizes(1e-3, 400.0, LARGEST))
    lidar = Lidar(beams=draw(st.integers(1, 80)), field_of_view=6.0, max_range=max_range)
    sigma, share = draw(sizes(1e-30, 1.0, 100.0, LARGEST)), draw(SHARES)
    kind = draw(st.sampled_from(["gaussian", "censored", "beam"]))
    if kind == "beam":
        short, largest = share * draw(SHARES), draw(st.sampled_from([0.0, 0.5])) * (1 - share)
        rest = {"short": short, "max": largest, "rand": share - short}
        beam = BeamModel(sigma=sigma, hit=1 - sum(rest.values()), **rest)
    else:
        model = GaussianUniform if kind == "gaussian" else CensoredGaussianUniform
        beam = model(sigma=sigma, uniform=share)
    return LidarScan(floor_plan=floor_plan, lidar=lidar, beam=beam)


def scans(draw, model, pose: np.ndarray) -> np.ndarray:
    """What is seen from a pose, but for beams that are short, noisy, at the ends, or lost."""
    lidar = model.lidar
    ranges = model.floor_plan.ranges(pose[None], lidar.bearings)[0].astype(float)
    ranges = np.minimum(ranges, lidar.max_range)
    odd = [0.0, lidar.max_range, np.nan, np.inf, -1.0, 0.5 * lidar.max_range]
    which = draw(st.lists(st.sampled_from(odd), max_size=lidar.beams))
    ranges[: len(which)] = which
    return draw(st.sampled_from([ranges, ranges * 0.3, np.full_like(ranges, np.nan)]))


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data(), model=scan_models())
def test_no_pose_outside_is_likelier_than_one_inside_whatever_model_scan_and_number_of_beams(
    data, model
):
    _, _, x1, y1 = model.floor_plan.bounds
    share = st.floats(0.01, 0.99)
    truth = np.array([x1 * data.draw(share), y1 * data.draw(share), data.draw(st.floats(-3, 3))])
    inside = np.array([truth, [0.5 * x1, 0.5 * y1, 1.0], [0.05 * x1, 0.9 * y1, -2.0]])
    outside = np.array([[-0.1 * x1, y1 / 2, 0.0], [x1 / 2, 1.5 * y1, 2.0], [3 * x1, -y1, 1.0]])
    poses = np.ascontiguousarray(np.vstack([inside, outside]).T, np.float32)
    scan = Scan.of(scans(data.draw, model, truth), model.lidar.max_range)
    told = model.log_likelihood(poses, scan)
    assert not np.isnan(told).any()
    within, beyond = told[:3], told[3:]
    assert beyond.tolist() == [beyond[0]] * 3
    assert ScanTable(model, poses).log_likelihood(scan) == pytest.approx(told, rel=1e-9)
    if scan.beams == 0:
        assert told.tolist() == [0.0] * 6
        return
    assert beyond[0] <= scan.beams * -30.0
    # a sum of logarithms is right to some units of each: 1e-12 of the sum
    assert (within >= beyond[0] - 1e-12 * abs(np.nan_to_num(beyond[0], neginf=0.0))).all()


@pytest.mark.parametrize("beam", [GaussianUniform(), CensoredGaussianUniform(), BeamModel()])
@given(used=st.integers(0, 80), lost=st.integers(0, 80))
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_where_any_measurement_is_possible_each_usable_beam_counts_minus_thirty(
    room, beam, used, lost
):
    lidar = Lidar(beams=used + lost + 1, field_of_view=6.0, max_range=400.0)
    model = LidarScan(floor_plan=room, lidar=lidar, beam=beam)
    ranges = np.concatenate([np.full(used, 200.0), np.full(lost + 1, np.nan)])
    outside = np.array([[-9.0], [-9.0], [0.0]], np.float32)
    assert model.log_likelihood(outside, Scan.of(ranges, 400.0)).tolist() == [used * -30.0]
