"""Elementary functions against the C library's, and seeds against NumPy's."""

import math

import numpy as np
import pytest

from deqmcl_gym.numerics import arrays, elementary
from deqmcl_gym.numerics.elementary import cos32, sin32, sincos32

EPS = np.finfo(float).eps
# Each function is a short polynomial, scaled: a handful of roundings, stated as 4 units in the
# last place of the result, or of 1 where the result is a sum of terms near 1.
TOLERANCE = 4 * EPS
# four half units in the last place of a float32 below 1, 3e-8 each
SINGLE = 1.2e-7


def each(function, *arguments):
    return np.array([function(*values) for values in zip(*arguments, strict=True)])


def test_sin_and_cos_are_accurate_far_from_zero_and_beside_every_quarter_turn():
    quarters = np.arange(-1000, 1001) * math.pi / 2
    spread = np.random.default_rng(0).uniform(-1, 1, (10, 5_000)) * 10.0 ** np.arange(10)[:, None]
    angles = np.concatenate([quarters, quarters + 1e-9, spread.ravel(), [-1e9, 1e9]])
    np.testing.assert_allclose(arrays.sin(angles), each(math.sin, angles), rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(arrays.cos(angles), each(math.cos, angles), rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("function", [arrays.sin, arrays.cos])
def test_beyond_a_billion_radians_there_is_no_sine_rather_than_a_wrong_one(function):
    beyond = np.nextafter(1e9, np.inf) * 10.0 ** np.arange(0, 300, 7)
    assert np.isnan(function([*beyond, *-beyond, np.inf, -np.inf, np.nan])).all()


def test_arctan2_is_accurate_in_all_quadrants_on_the_axes_and_at_all_scales():
    rng = np.random.default_rng(1)
    y, x = rng.standard_normal((2, 50_000)) * 10.0 ** rng.integers(-150, 150, (2, 50_000))
    y[:5], x[:5] = [0.0, 0.0, 1.0, -1.0, 0.0], [1.0, -1.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(arrays.arctan2(y, x), each(math.atan2, y, x), rtol=0, atol=TOLERANCE)


def test_exp_is_accurate_down_to_the_least_normal_number_and_zero_beyond():
    x = -np.concatenate([np.linspace(0, 708, 50_001), [708.5, 800.0, 1e6, np.inf]])
    expected = np.where(x > -708, np.exp(x), 0.0)
    np.testing.assert_allclose(arrays.exp(x), expected, rtol=TOLERANCE)
    assert np.isnan(arrays.exp([np.nan])[0])


def test_log_is_accurate_over_all_normal_numbers():
    x = np.exp2(np.random.default_rng(2).uniform(-1022, 1023, 50_000))
    x = np.concatenate([x, 1 + np.linspace(-1e-3, 1e-3, 2001)])
    expected = each(math.log, x)
    scale = np.maximum(np.abs(expected), 1.0)
    assert (np.abs(arrays.log(x) - expected) <= TOLERANCE * scale).all()
    assert arrays.log([0.0, np.inf]).tolist() == [-np.inf, np.inf]
    assert np.isnan(arrays.log([-1.0, np.nan])).all()


def test_normal_cdf_is_accurate_and_monotone_at_both_ends():
    z = np.linspace(-9, 9, 20_001)
    expected = each(lambda v: math.erfc(-v / math.sqrt(2)) / 2, z)
    np.testing.assert_allclose(arrays.normal_cdf(z), expected, rtol=0, atol=1e-15)
    assert arrays.normal_cdf([-np.inf, -40.0, 40.0, np.inf]).tolist() == [0.0, 0.0, 1.0, 1.0]
    assert np.isnan(arrays.normal_cdf([np.nan])[0])


@pytest.mark.parametrize("n", [0, 1, 511, 512, 513, 1300])
def test_many_logs_in_short_loops_are_the_logs_of_each_to_the_bit(n):
    x = np.exp2(np.random.default_rng(n).uniform(-1022, 1023, n))
    x[::7], x[1::7], x[2::7], x[3::7], x[4::7] = 0.0, -1.0, np.inf, np.nan, 5e-324
    found = np.full(n, 7.0)
    elementary.logs64(x, found)
    assert found.tobytes() == arrays.log(x).tobytes()


@pytest.mark.parametrize("period", [2 * math.pi, 780.0, 1e-3])
def test_the_compiled_centred_value_has_the_bits_of_pythons_remainder(period):
    near = np.random.default_rng(5).uniform(-0.6, 0.6, 2000) * period
    ends = np.arange(-4, 5) * period / 2
    values = np.concatenate([near, 1e3 * near, ends, np.nextafter(ends, -np.inf), [-0.0]])
    found = each(lambda value: elementary.centred64(value, period), values)
    expected = [(value + period / 2) % period - period / 2 for value in values.tolist()]
    assert found.tobytes() == np.array(expected).tobytes()
    assert (np.abs(found) <= period / 2).all()
    assert math.isnan(elementary.centred64(math.nan, period))


def test_a_wrapped_angle_is_the_same_direction_and_one_within_half_a_turn_keeps_its_bits():
    angles = np.random.default_rng(6).uniform(-1e3, 1e3, 20_000)
    singles = angles.astype(np.float32)
    wrapped = arrays.wrapped(angles), each(elementary.wrapped32, singles)
    for found, given in zip(wrapped, (angles, singles), strict=True):
        eps = np.finfo(given.dtype).eps
        # the angle and the turns taken off it are rounded, and so is π
        assert (np.abs(found) <= np.pi + 1e3 * eps).all()
        assert np.abs(np.exp(1j * found) - np.exp(1j * given)).max() < 4e3 * eps
        within = np.abs(given) < 3.14
        assert np.array_equal(found[within], given[within])


def test_shapes_are_kept_and_arguments_left_alone():
    x = np.full((2, 0, 3), -1.0)
    assert arrays.exp(x).shape == (2, 0, 3)
    given = -np.arange(6.0).reshape(2, 3)[:, ::2]
    before = given.copy()
    assert arrays.exp(given).shape == (2, 2)
    assert (given == before).all()
    assert arrays.sin(0.5).shape == ()


def sincos(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    sines, cosines = np.empty_like(angles), np.empty_like(angles)
    sincos32(angles, sines, cosines)
    return sines, cosines


def test_sincos_is_accurate_to_four_half_units_and_beside_every_eighth_of_a_turn():
    eighths = (np.arange(-1273, 1274) * (np.pi / 4)).astype(np.float32)
    up, down = np.nextafter(eighths, np.float32(2e3)), np.nextafter(eighths, np.float32(-2e3))
    rng = np.random.default_rng(1)
    spread = [rng.uniform(-bound, bound, 200_000) for bound in (1.0, 10.0, 100.0, 1000.0)]
    angles = np.concatenate([eighths, up, down, *spread]).astype(np.float32)
    sines, cosines = sincos(angles)
    assert np.abs(sines - np.sin(angles.astype(np.float64))).max() < SINGLE
    assert np.abs(cosines - np.cos(angles.astype(np.float64))).max() < SINGLE


def test_zero_is_exact_and_sine_is_odd_and_cosine_even():
    angles = np.linspace(0, 50, 10_001, dtype=np.float32)
    sines, cosines = sincos(angles)
    mirrored_sines, mirrored_cosines = sincos(-angles)
    assert (sines[0], cosines[0]) == (0.0, 1.0)
    assert np.array_equal(mirrored_sines, -sines)
    assert np.array_equal(mirrored_cosines, cosines)


@pytest.mark.parametrize("n", [0, 1, 511, 512, 513, 1500])
def test_an_array_has_the_bits_of_its_angles_one_by_one(n):
    angles = np.random.default_rng(n).uniform(-1000, 1000, n).astype(np.float32)
    sines, cosines = sincos(angles)
    assert sines.tolist() == [sin32(angle) for angle in angles]
    assert cosines.tolist() == [cos32(angle) for angle in angles]
