"""The geometry of the fan; test_room_bad_worlds has the lidars that are refused."""

import math

import numpy as np
import pytest

from deqmcl_gym.maps import Lidar


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
