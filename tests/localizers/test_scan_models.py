"""Scan models: a beam has its book's density, a scan is a product over the beams."""

import math
from functools import partial
from itertools import product

import numpy as np
import pytest
from following import density
from hypothesis import given
from hypothesis import strategies as st

from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.maps.map import scaled
from deqmcl_gym.validation import LARGEST, InputError
from localizers import BeamModel, CensoredGaussianUniform, GaussianUniform, LatentShare
from localizers.models.scan import LidarScan, Scan

MAX = 400.0
MODELS = [GaussianUniform, CensoredGaussianUniform, BeamModel]  # products over beams
ALL = [*MODELS, LatentShare]
# outside the building no scan is likelier than at any pose inside it, and each beam counts
SHARES = st.one_of(st.sampled_from([0.0, 1e-300, 1e-16, 0.05, 1.0]), st.floats(0, 1))
OF_SHARES = [(0.05, 2.0), (0.5, 0.3), (0.2, 50.0)]
NAN, INF = math.nan, math.inf
LIDAR = Lidar(beams=5, field_of_view=2.0, max_range=400.0)
SCAN = np.array([60.0, 80.0, 250.0, 80.0, 60.0])
PLACES = (50, 50, 0.1), (300, 50, 1.5), (60, 250, -1.0), (175, 150, 0.0)
POSES = np.array(PLACES, dtype=np.float32).T


def phi(z: float) -> float:
    return 0.5 * math.erfc(-z / math.sqrt(2))


@pytest.mark.parametrize("model", ALL)
def test_a_beam_with_nothing_in_its_way_is_one_whose_wall_is_far_beyond_the_limit(model):
    """At 1e6 px, 1e5 standard deviations beyond the limit, no normal is left in float64."""
    ranges, nothing = np.array([0.0, 3.0, 200.0, MAX]), np.full((2, 4), np.inf)
    beyond = np.full_like(nothing, 1e6)
    told, far = (model(sigma=5.0).log_likelihood(ranges, e, MAX) for e in (nothing, beyond))
    assert np.isfinite(told).all()
    np.testing.assert_array_equal(told, far)


def exact_density(model, o: float, expected: float) -> float:
    sigma, seen = model.sigma, min(expected, MAX)
    normal = math.exp(-0.5 * ((o - expected) / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi))
    if isinstance(model, BeamModel):
        normal = math.exp(-0.5 * ((o - seen) / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi))
        hit = normal / (phi((MAX - seen) / sigma) - phi(-seen / sigma))
        short = math.exp(-model.decay * o) / -math.expm1(-model.decay * seen) if o <= seen else 0
        other = model.max if o == MAX else model.rand / MAX
        return model.hit * hit + model.short * model.decay * short + other
    if isinstance(model, GaussianUniform):
        return (1 - model.uniform) * normal + model.uniform / MAX
    hit = (
        phi(-expected / sigma) if o == 0 else phi((expected - MAX) / sigma) if o == MAX else normal
    )
    return (1 - model.uniform) * hit + model.uniform / 402


@pytest.mark.parametrize("sigma", [0.5, 5.0, 100.0, 1000.0])
@pytest.mark.parametrize("model", MODELS)
def test_the_compiled_log_likelihood_is_the_sum_of_the_logs_of_the_formulas(model, sigma):
    rng, beam = np.random.default_rng(1), model(sigma=sigma)
    measured = rng.uniform(0, MAX, 40)  # more than one fold
    measured[::5], measured[1::5] = 0.0, MAX
    expected = rng.uniform(0.5, 500, (600, 40)).astype(np.float32)  # more than one block
    rows = expected.astype(float).tolist()
    pairs = (zip(measured, row, strict=True) for row in rows)
    exact = [sum(math.log(exact_density(beam, o, e)) for o, e in pair) for pair in pairs]
    # The share of a hit is wide by some 1e-16, in the tails to z² times that; it is under 1e-13 of
    # a density that has a floor, where z < 12. The logarithms are of some units, forty of them.
    seen = beam.log_likelihood(measured, expected, MAX)
    assert seen == pytest.approx(exact, rel=1e-12, abs=40 * 1e-13)


def test_without_a_uniform_share_what_cannot_be_has_no_likelihood_and_tails_keep_theirs():
    beam = CensoredGaussianUniform(sigma=5.0, uniform=0.0)
    expected = np.array([[400.0], [380.0], [250.0], [200.0]], np.float32)
    seen = beam.log_likelihood(np.array([MAX]), expected, MAX)
    exact = [math.log(phi((e - MAX) / 5)) for e in (400, 380, 250)]
    assert seen.tolist() == pytest.approx([*exact, -math.inf], rel=1e-12)


@pytest.mark.parametrize("model", [model() for model in ALL])
def test_lengths_in_another_unit_are_the_same_model(model):
    measured, expected = np.array([0.0, 90.0, 399.0, 400.0]), np.array([[20, 100, 250, 500]])
    in_px = density(model, measured, expected, MAX)
    in_m = density(scaled(model, 0.015625), measured / 64, expected / 64, MAX / 64)
    densities = 1 / 64 if isinstance(model, GaussianUniform) else np.array([[1, 1 / 64, 1 / 64, 1]])
    if not isinstance(model, BeamModel):  # its mass at the end stands beside a density
        assert in_m * densities == pytest.approx(in_px, rel=1e-12)
    else:
        assert in_m[:, :3] / 64 == pytest.approx(in_px[:, :3], rel=1e-12)


@pytest.mark.parametrize("model", [model() for model in ALL])
def test_nan_in_a_scan_or_among_the_exact_ranges_is_no_likelihood(model):
    expected = np.array([[100.0, 50.0], [100.0, np.nan], [np.nan, 50.0]], np.float32)
    told = model.log_likelihood(np.array([90.0, 60.0]), expected, MAX)
    assert np.isnan(told).tolist() == [False, True, True]
    assert np.isnan(model.log_likelihood(np.array([90.0, np.nan]), expected, MAX)).all()


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("power", [1.0, 0.5, 0.1])
def test_the_power_scales_the_log_likelihood_and_widens_what_a_beam_says(model, power):
    plain, tempered = model(sigma=20.0), model(sigma=20.0, power=power)
    rng = np.random.default_rng(0)
    expected = rng.uniform(1, 500, (40, 7)).astype(np.float32)
    ranges = np.append(rng.uniform(0, MAX, 6), MAX)
    whole = plain.log_likelihood(ranges, expected, MAX)
    np.testing.assert_array_equal(tempered.log_likelihood(ranges, expected, MAX), power * whole)
    assert tempered.least_density(MAX) == plain.least_density(MAX) ** power
    variances = [one.hit_moments(np.array([[50.0]]), MAX)[1].item() for one in (plain, tempered)]
    assert variances[1] == variances[0] / power


@pytest.fixture(params=[GaussianUniform(), CensoredGaussianUniform(sigma=20.0), BeamModel()])
def scan(request, room) -> LidarScan:
    return LidarScan(floor_plan=room, lidar=LIDAR, beam=request.param)


def told(model: LidarScan, ranges: np.ndarray, poses: np.ndarray = POSES) -> np.ndarray:
    return model.log_likelihood(poses, Scan.of(ranges, LIDAR.max_range))


def only(scan: LidarScan, beam: int) -> np.ndarray:
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


class Hall:
    """A map of one's own: all walls are 80 px away."""

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


def sizes(*usual: float):
    """The sizes given, and any between the smallest and the largest."""
    exponents = st.floats(np.log10(usual[0]), np.log10(usual[-1]))
    return st.sampled_from(usual) | exponents.map(lambda e: min(10.0**e, usual[-1]))


@st.composite
def scan_models(draw, x1: float, y1: float) -> LidarScan:
    """Every model there is, at any noise, and any shares, none too."""
    room = PolygonMap(outer=[(0, 0), (x1, 0), (x1, y1), (0, y1)])
    max_range, share = draw(sizes(1e-3, 400.0, LARGEST)), draw(SHARES)
    lidar = Lidar(beams=draw(st.integers(1, 80)), field_of_view=6.0, max_range=max_range)
    sigma, model = draw(sizes(1e-30, 1.0, 100.0, LARGEST)), draw(st.sampled_from(ALL))
    if model is BeamModel:
        short, largest = share * draw(SHARES), draw(st.sampled_from([0.0, 0.5])) * (1 - share)
        rest = {"short": short, "max": largest, "rand": share - short}
        beam = BeamModel(sigma=sigma, hit=1 - sum(rest.values()), **rest)
    else:
        beam = model(sigma=sigma, uniform=share)
    return LidarScan(floor_plan=room, lidar=lidar, beam=beam)


@given(data=st.data(), x1=st.floats(5, 800), y1=st.floats(5, 800))
def test_no_pose_outside_is_likelier_than_one_inside_whatever_the_scan(data, x1, y1):
    model, share = data.draw(scan_models(x1, y1)), st.floats(0.01, 0.99)
    most = model.lidar.max_range
    truth = np.array([x1 * data.draw(share), y1 * data.draw(share), data.draw(st.floats(-3, 3))])
    ranges = model.floor_plan.ranges(truth[None], model.lidar.bearings)[0].astype(float)
    ranges = np.minimum(ranges, most) * data.draw(st.sampled_from([1.0, 0.3, np.nan]))
    odd = st.sampled_from([0.0, most, np.nan, np.inf, -1.0, 0.5 * most])
    which = data.draw(st.lists(odd, max_size=model.lidar.beams))
    ranges[: len(which)] = which
    inside = np.array([truth, [0.5 * x1, 0.5 * y1, 1.0], [0.05 * x1, 0.9 * y1, -2.0]])
    outside = np.array([[-0.1 * x1, y1 / 2, 0.0], [x1 / 2, 1.5 * y1, 2.0], [3 * x1, -y1, 1.0]])
    poses = np.ascontiguousarray(np.vstack([inside, outside]).T, np.float32)
    scan = Scan.of(ranges, most)
    seen = model.log_likelihood(poses, scan)
    assert not np.isnan(seen).any()
    within, beyond = seen[:3], seen[3:]
    assert beyond.tolist() == [beyond[0]] * 3
    assert model.at(poses)(scan) == pytest.approx(seen, rel=1e-9)
    if scan.beams == 0:
        assert seen.tolist() == [0.0] * 6
        return
    assert beyond[0] <= scan.beams * -30.0
    # a sum of logarithms is right to some units of each: 1e-12 of the sum
    assert (within >= beyond[0] - 1e-12 * abs(np.nan_to_num(beyond[0], neginf=0.0))).all()


@pytest.mark.parametrize("beam", [model() for model in ALL])
@given(used=st.integers(0, 80), lost=st.integers(0, 80))
def test_outside_the_walls_each_usable_beam_counts_minus_thirty(room, beam, used, lost):
    lidar = Lidar(beams=used + lost + 1, field_of_view=6.0, max_range=400.0)
    model = LidarScan(floor_plan=room, lidar=lidar, beam=beam)
    ranges = np.concatenate([np.full(used, 200.0), np.full(lost + 1, np.nan)])
    outside = np.array([[-9.0], [-9.0], [0.0]], np.float32)
    assert model.log_likelihood(outside, Scan.of(ranges, 400.0)).tolist() == [used * -30.0]


def parts(model, ranges, expected):
    one = partial(CensoredGaussianUniform, sigma=model.sigma)
    return [density(one(uniform=share), ranges, expected, MAX) for share in (0.0, 1.0)]


def log_beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)


@pytest.mark.parametrize("power", [1.0, 0.3])
@pytest.mark.parametrize(("uniform", "concentration"), OF_SHARES)
def test_it_is_the_sum_over_which_beams_are_unexplained(uniform, concentration, power):
    model = LatentShare(sigma=20.0, uniform=uniform, concentration=concentration, power=power)
    a, b = concentration * uniform, concentration * (1 - uniform)
    ranges = np.array([50.0, 0.0, MAX, 200.0, 120.0, 119.0])
    expected = np.random.default_rng(0).uniform(0.5, 500, (130, 6)).astype(np.float32)
    hit, other = parts(model, ranges, expected)
    total = np.zeros(130)
    for unexplained in product((False, True), repeat=6):
        k = sum(unexplained)
        moment = math.exp(log_beta(a + k, b + 6 - k) - log_beta(a, b))  # E[u^k (1 - u)^(6 - k)]
        total += moment * np.where(unexplained, other, hit).prod(axis=1)
    seen = model.log_likelihood(ranges, expected, MAX)
    # logs of some tens, from densities right to some 1e-13
    np.testing.assert_allclose(seen, power * np.log(total), rtol=1e-12, atol=1e-11)


def test_hundreds_of_beams_neither_under_nor_overflow():
    rng = np.random.default_rng(2)
    for uniform, sigma in ((0.05, 1e-6), (1e-300, 5.0), (0.9, 1e6)):
        model = LatentShare(sigma=sigma, uniform=uniform)
        expected = rng.uniform(1, 400, (3, 700)).astype(np.float32)
        for ranges in (expected[0].astype(np.float64), rng.uniform(0, MAX, 700)):
            seen = model.log_likelihood(ranges, expected, MAX)
            assert np.isfinite(seen).all()
            assert (seen >= 700 * math.log(model.least_density(MAX))).all()
