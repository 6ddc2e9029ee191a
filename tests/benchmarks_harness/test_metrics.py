"""Each score against plain arithmetic."""

import math

import numpy as np
import pytest

from benchmarks.trials import scores

PI = math.pi


def estimate(x, y, heading, length=1.0):
    """An estimate of (x, y, cos θ, sin θ), (1, 4); a mean of directions is shorter than 1."""
    return np.array([[x, y, length * math.cos(heading), length * math.sin(heading)]])


def test_the_state_error_is_the_norm_over_x_y_cosine_and_sine_of_each_state():
    # (3, 4) px off, and (1, 0) where the heading π/2 has (0, 1): 9 + 16 + 1 + 1 = 27
    means = np.array([[13.0, 24, 1, 0], [0, 0, 0, 0]])
    truth = np.array([[10, 20, PI / 2 - 2 * PI], [0, 0, 0]])
    assert scores.state_error(means, truth) == pytest.approx([math.sqrt(27), 1], rel=1e-12)


@pytest.mark.parametrize("size", [1e-300, 1e-160, 1.0, 1e160, 1e307])
def test_lengths_of_any_size_scale_without_overflow_or_loss(size):
    means = size * np.array([[3.0, 4.0, 0.0, 0.0], [0.0, -5.0, 0.0, 0.0]])
    assert scores.position_error(means, np.zeros((2, 3))) == pytest.approx([5 * size] * 2)
    assert scores.rms(size * np.array([1.0, 7.0])) == pytest.approx(5 * size)


@pytest.mark.parametrize(
    ("estimated", "true", "apart"),
    [
        (0.3, 0.1, 0.2),
        (PI - 0.1, -PI + 0.1, 0.2),  # 174° and -174° are 12° apart, not 348°
        (0.2, 0.1 + 6 * PI, 0.1),
        (PI / 2, -PI / 2, PI),
    ],
)
@pytest.mark.parametrize("length", [1.0, 0.01])
def test_the_heading_error_is_the_shorter_way_round_however_short_the_mean_is(
    estimated, true, apart, length
):
    means = estimate(0, 0, estimated, length)
    error = scores.heading_error(means, np.array([[5.0, 5.0, true]]))
    assert error == pytest.approx([apart], abs=1e-12)  # a few roundings of numbers below 20


# 4 · ½ log(2πe), by hand
FOUR = 5.6757541328


def test_entropy_does_not_fall_below_that_of_the_floors():
    # ½ log(10⁻² · 10⁻² · 10⁻⁶ · 10⁻⁶) = -8 log 10 = -18.4206807440
    for variances in ([0, 0, 0, 0], [1e-2, 1e-2, 1e-6, 1e-6], [1e-3, 0, 1e-7, 1e-30]):
        lowest = scores.entropy(np.array([variances]), "px")
        assert lowest == pytest.approx([FOUR - 18.4206807440], abs=1e-9)


def test_the_floors_of_a_room_in_metres_are_as_large_as_in_pixels():
    # a pixel is 2 cm: each of two lengths adds log 0.02
    in_pixels, in_metres = (scores.entropy(np.zeros((1, 4)), unit) for unit in ("px", "m"))
    assert in_metres - in_pixels == pytest.approx([2 * math.log(0.02)], abs=1e-12)
