"""The geometry of the fan, and the lidars that are refused."""

import dataclasses
import math

import numpy as np
import pytest

from deqmcl_gym.maps import Lidar
from deqmcl_gym.validation import InputError


@pytest.mark.parametrize(
    ("field", "bad"),
    [
        *[("beams", bad) for bad in (0, 10**9)],
        *[("field_of_view", bad) for bad in (0, 2 * math.pi + 1e-6)],
        ("max_range", 0),
        ("sigma", -1),
    ],
)
def test_a_bad_lidar_is_refused_with_its_field_and_the_value_seen(field, bad):
    with pytest.raises(InputError, match=rf"^lidar\.{field} is .*, but must be .*\.$") as caught:
        Lidar(**{field: bad})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("changes", [{"beams": 1}, {"sigma": 0}, {"field_of_view": 2 * math.pi}])
def test_the_limits_themselves_are_allowed(changes):
    assert dataclasses.replace(Lidar(), **changes).bearings.shape == (1,)


@pytest.mark.parametrize("fov", [0.1, 2.0, 2 * math.pi])
def test_one_beam_looks_straight_ahead(fov):
    assert Lidar(beams=1, field_of_view=fov).bearings.tolist() == [0.0]


@pytest.mark.parametrize("beams", [2, 3, 9, 360])
def test_a_fan_is_ascending_evenly_spread_and_centred_with_its_outermost_beams_the_view_apart(
    beams,
):
    bearings = Lidar(beams=beams, field_of_view=math.pi / 2).bearings
    assert bearings.shape == (beams,)
    assert np.diff(bearings) == pytest.approx(math.pi / 2 / (beams - 1))
    assert bearings == pytest.approx(-bearings[::-1])


@pytest.mark.parametrize("beams", [2, 3, 4, 9, 360])
def test_a_full_circle_is_spread_evenly_and_has_no_twin_beam(beams):
    bearings = Lidar(beams=beams, field_of_view=2 * math.pi).bearings
    assert bearings.shape == (beams,)
    gaps = np.diff([*bearings, bearings[0] + 2 * math.pi])  # all the way round
    assert gaps == pytest.approx(2 * math.pi / beams)
