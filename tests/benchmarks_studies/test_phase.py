"""Place fields over the theta phase: queues whose precession is known exactly."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from benchmarks.studies.phase.cycles import PlaceFields, cycles_of, perfect_cycles
from deqmcl_gym.world.course import Path

# Once around is 6,000 px. Both fields are passed as a whole at every offset of a queue of 20.
PATH = Path(np.array([(0, 0), (2000, 0), (2000, 1000), (0, 1000)], float))
FIELDS = PlaceFields(PATH, np.array([(500.0, 0.0), (600.0, 0.0)]), 32.0)
ROUNDING = 1e-9  # of sums of some ten thousand doubles


def straight(steps, speed=5.0):
    """True poses along the bottom edge."""
    x = speed * np.arange(steps + 1)
    return np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])


@dataclass
class Places:
    """Holds places ``x(step, offset)`` on the bottom edge, if any, with weights as 1 : 2 : 3 …"""

    x: object
    step: int

    def points(self, offset=0):
        x = np.array(self.x(self.step, offset), float, ndmin=1)
        weights = np.arange(1, x.size + 1) / np.arange(x.size + 1).sum()
        return (np.array([x, 0 * x, 0 * x]).T, weights) if x.size else None


def believed(x, steps=220, lag=20):
    """The cycles of a lap at 5 px per step."""
    lap = ((pose, Places(x, t)) for t, pose in enumerate(straight(steps)))
    return cycles_of(lap, FIELDS, lag, most=2 * steps)


@pytest.mark.parametrize(("lag", "speed"), [(20, 5.0), (20, 2.0), (1, 5.0), (35, 4.0)])
def test_a_perfect_queue_at_constant_speed_precesses_by_one_phase_bin_per_step(lag, speed):
    # k phases later is k steps of way earlier, and a bin of phase is 360°/(2L + 1) wide
    found = perfect_cycles(straight(1100 // int(speed), speed), FIELDS, lag).precession
    width = 360 / (2 * lag + 1)
    assert found.slope == pytest.approx(-width / speed, rel=ROUNDING)
    assert (found.first, found.last) == pytest.approx((width / 2, 360 - width / 2))
    assert found.late == pytest.approx(0, abs=1e-6)
    assert (found.past, found.present, found.future) == (1, 1, 1)


def test_the_correlation_of_a_perfect_queue_is_that_of_a_band():
    # u = -5 k + w with k = -20 … 20 and w = -30, -25 … 30: variances (n² - 1) / 12 of n equal steps
    found = perfect_cycles(straight(220), FIELDS, 20).precession
    along, across = 25 * (41**2 - 1) / 12, 25 * (13**2 - 1) / 12
    assert found.correlation == pytest.approx(-math.sqrt(along / (along + across)), rel=ROUNDING)


@pytest.mark.parametrize(
    ("x", "speed", "behind"),
    [
        (lambda t, k: 5 * (t + k) - 15, 5, 15),
        (lambda t, k: [] if k > 0 else 5 * (t + k) - 15, 5, 15),
        (lambda t, k: 5 * t + 10 * k, 10, 0),
    ],
)
def test_slope_and_lateness_are_those_of_the_belief_not_of_the_construction(x, speed, behind):
    found = believed(x).precession
    assert found.slope == pytest.approx(-360 / 41 / speed, rel=ROUNDING)
    assert found.late == pytest.approx(behind, abs=1e-6)
    assert found.past < 1


def test_a_queue_that_says_the_present_at_every_offset_does_not_precess():
    found = believed(lambda t, k: 5 * t).precession
    assert np.nan_to_num(found.correlation) == pytest.approx(0, abs=1e-6)
    assert found.present == 1


def test_one_held_offset_is_one_phase_without_a_slope():
    cycles = believed(lambda t, k: [] if k else 5 * t + 7)
    assert (cycles.held == (cycles.offsets == 0)).all()
    found = cycles.precession
    assert (found.first, found.last) == (180, 180)
    assert found.late == pytest.approx(-7.5)  # the robot is -35, -30 … 20 px past the centre
    assert all(map(math.isnan, (found.slope, found.past, found.future)))


def test_activity_is_the_weight_in_the_field_and_distance_that_from_the_truth():
    cycles = believed(lambda t, k: 5 * (t + k) + np.array([0.0, 10.0, 400.0, 90.0]))
    now = (100, 20)  # step, column of k = 0: the robot is at 500 px
    assert cycles.activity[now] == pytest.approx([0.3, 0.4])
    assert cycles.right[now] == pytest.approx(0.3)
    assert cycles.error[now] == pytest.approx(2 + 120 + 36)
    assert cycles.distance[now] == pytest.approx(
        math.sqrt(0.2 * 10**2 + 0.3 * 400**2 + 0.4 * 90**2)
    )


@pytest.mark.parametrize("count", [2, 3, 12, 50])
def test_fields_lie_on_the_lap_at_equal_steps_and_the_two_nearest_touch(count):
    fields = PlaceFields.along(PATH, count, start=1234.0)
    expected = (1234 + 6000 * (np.arange(count) + 0.5) / count) % 6000
    assert fields.arcs(fields.centres) == pytest.approx(expected.tolist())
    apart = [math.dist(a, b) for i, a in enumerate(fields.centres) for b in fields.centres[:i]]
    assert min(apart) == pytest.approx(2 * fields.radius)


def test_a_field_that_is_visited_twice_counts_from_the_visit_that_the_offset_tells_of():
    # the queue reaches 250 px, more than half of the 400 px once around
    square = Path(np.array([(0, 0), (100, 0), (100, 100), (0, 100)], float))
    truth = np.array([square.at(140 + 5.0 * t) for t in range(201)])
    fields = PlaceFields(square, np.array([(50.0, 0.0)]), 12.0)  # at arcs 450 and 850
    # both visits are seen whole from every offset: nothing is cut off
    found = perfect_cycles(truth, fields, 50).precession
    assert found.slope == pytest.approx(-360 / 101 / 5, rel=ROUNDING)


def test_a_lag_longer_than_the_lap_reaches_as_far_as_the_lap():
    cycles = perfect_cycles(straight(60, 20.0), FIELDS, 10**6)
    x = 20 * (np.arange(61)[:, None] + cycles.offsets)
    assert cycles.activity.shape == (*x.shape, 2) == (61, 121, 2)
    in_a_field = (np.abs(x - 500) < 32) | (np.abs(x - 600) < 32)
    assert np.array_equal(cycles.right, np.where(in_a_field, 1, np.nan), equal_nan=True)


def test_a_belief_that_is_not_finite_is_named():
    with pytest.raises(RuntimeError, match=r"t = 3 about x\[3\] is not finite"):
        believed(lambda t, k: math.nan if t == 3 else 0.0, steps=10, lag=0)
