"""The compiled sine and cosine against NumPy's in float64."""

import numpy as np
import pytest

from deqmcl_gym.numerics.elementary import cos32, sin32, sincos32

# Half a unit in the last place of a float32 below 1 is 3e-8. The polynomial, its evaluation and the
# reduction of the argument add a few more half units: 1.2e-7 is four of them (the kernel says
# "about 1e-7").
TOLERANCE = 1.2e-7


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
    assert np.abs(sines - np.sin(angles.astype(np.float64))).max() < TOLERANCE
    assert np.abs(cosines - np.cos(angles.astype(np.float64))).max() < TOLERANCE


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
