"""Place fields over the theta phase: queues whose precession is known exactly."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from benchmarks.phase.cycles import cycles_of, perfect_cycles, phase
from benchmarks.phase.fields import PlaceFields
from benchmarks.phase.page import late
from benchmarks.phase.precession import precession, right_mass
from benchmarks.sweeps.suites import paper_suite
from benchmarks.trials.episode import Moment, room_of, trial_moments
from deqmcl_gym.world.path import Path

# Once around is 6,000 px. Both fields are passed as a whole at every offset of a queue of 20.
PATH = Path(np.array([(0, 0), (2000, 0), (2000, 1000), (0, 1000)], float))
FIELDS = PlaceFields(PATH, np.array([(500.0, 0.0), (600.0, 0.0)]), 32.0)
ROUNDING = 1e-9  # of sums of some ten thousand doubles


def straight(steps, speed=5.0):
    """True poses along the bottom edge."""
    x = speed * np.arange(steps + 1)
    return np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])


@dataclass
class OnePoint:
    """Believes in the place ``x(t, k)`` on the bottom edge."""

    x: object
    step: int

    def points(self, offset=0):
        return np.array([[self.x(self.step, offset), 0.0, 0.0]]), np.ones(1)


def believed(truth, x, lag=20):
    episode = [Moment(t, pose, np.ones(1), OnePoint(x, t), 0.0) for t, pose in enumerate(truth)]
    return cycles_of(episode, FIELDS, lag)


@pytest.mark.parametrize(("lag", "speed"), [(20, 5.0), (20, 2.0), (1, 5.0), (35, 4.0)])
def test_a_perfect_queue_at_constant_speed_precesses_by_one_phase_bin_per_step(lag, speed):
    # k phases later is k steps of way earlier, and a bin of phase is 360°/(2L + 1) wide
    found = precession(perfect_cycles(straight(1100 // int(speed), speed), FIELDS, lag))
    width = 360 / (2 * lag + 1)
    assert found.slope == pytest.approx(-width / speed, rel=ROUNDING)
    assert (found.first, found.last) == pytest.approx((width / 2, 360 - width / 2))
    assert late(found) == pytest.approx(0, abs=1e-6)
    assert (found.past, found.present, found.future) == (1, 1, 1)


def test_the_correlation_of_a_perfect_queue_is_that_of_a_band():
    # u = -5 k + w with k = -20 … 20 and w = -30, -25 … 30: variances (n² - 1) / 12 of n equal steps
    found = precession(perfect_cycles(straight(220), FIELDS, 20))
    along, across = 25 * (41**2 - 1) / 12, 25 * (13**2 - 1) / 12
    assert found.correlation == pytest.approx(-math.sqrt(along / (along + across)), rel=ROUNDING)


def test_a_belief_that_stays_behind_fires_late_by_as_much_at_the_same_slope():
    truth = straight(220)
    found = precession(believed(truth, lambda t, k: 5 * (t + k) - 15))
    assert found.slope == pytest.approx(-360 / 41 / 5, rel=ROUNDING)
    assert late(found) == pytest.approx(15, abs=1e-6)


def test_the_slope_is_that_of_the_belief_not_of_the_construction():
    # a queue that thinks the robot goes twice as fast spans twice the way in the same phases
    found = precession(believed(straight(220), lambda t, k: 5 * t + 10 * k))
    assert found.slope == pytest.approx(-360 / 41 / 10, rel=ROUNDING)
    assert found.present == 1
    assert found.future < 1
    assert found.past < 1


def test_a_queue_that_says_the_present_at_every_offset_does_not_precess():
    found = precession(believed(straight(220), lambda t, k: 5 * t))
    assert np.nan_to_num(found.correlation) == pytest.approx(0, abs=1e-6)


def test_one_held_offset_is_one_phase_without_a_slope():
    (trial,) = paper_suite(localizers=["mcl"], trials=1, particles=30)
    fields = PlaceFields.along(room_of("paper").course.path, 12)
    cycles = cycles_of(list(trial_moments(trial)), fields, 20)
    found = precession(cycles)
    assert (found.first, found.last) == (180, 180)
    assert math.isnan(found.slope)
    assert math.isnan(found.past)
    assert math.isnan(found.future)
    assert not cycles.held[:, cycles.offsets != 0].any()
    assert cycles.held[:, cycles.offsets == 0].all()


def test_activity_is_the_weight_in_the_field_and_distance_that_from_the_truth():
    (trial,) = paper_suite(localizers=["deq-mcl"], trials=1, lag=5, particles=30)
    room = room_of("paper")
    fields = PlaceFields.along(room.course.path, 7, start=100.0)
    episode = list(trial_moments(trial))
    cycles = cycles_of(episode, fields, 5)
    t, k = 100, 3
    poses, weights = episode[t].belief.points(k)
    true = episode[t + k].truth
    for place, (x, y) in enumerate(fields.centres):
        inside = [w for p, w in zip(poses, weights, strict=True)
                  if math.dist(p[:2].tolist(), (x, y)) < fields.radius]  # fmt: skip
        assert cycles.activity[t, k + 5, place] == pytest.approx(sum(inside), abs=1e-12)
    square = sum(
        w * math.dist(p[:2].tolist(), true[:2]) ** 2 for p, w in zip(poses, weights, strict=True)
    )
    assert cycles.distance[t, k + 5] == pytest.approx(math.sqrt(square), rel=1e-9)


def test_the_masses_of_all_fields_are_parts_of_one():
    (trial,) = paper_suite(localizers=["deq-mcl"], trials=1, lag=5, particles=30)
    fields = PlaceFields.along(room_of("paper").course.path, 30)
    cycles = cycles_of(list(trial_moments(trial)), fields, 5)
    mass = cycles.activity[cycles.held]
    assert mass.min() >= 0
    assert mass.sum(axis=1).max() <= 1 + 1e-12  # weights sum to 1 up to rounding
    steps = np.arange(205)[:, None] + cycles.offsets
    assert (cycles.held == ((steps >= 0) & (steps <= 204))).all()  # the queue holds all of the lap
    assert np.isnan(cycles.activity[~cycles.held]).all()


@pytest.mark.parametrize("count", [2, 3, 12, 50])
def test_fields_lie_on_the_lap_at_equal_steps_and_the_two_nearest_touch(count):
    fields = PlaceFields.along(PATH, count, start=1234.0)
    arcs = [PATH.arc(tuple(centre)) for centre in fields.centres]
    expected = (1234 + 6000 * (np.arange(count) + 0.5) / count) % 6000
    assert arcs == pytest.approx(expected.tolist())
    apart = [math.dist(a, b) for i, a in enumerate(fields.centres) for b in fields.centres[:i]]
    assert min(apart) == pytest.approx(2 * fields.radius)


def test_the_phases_cut_the_cycle_into_equal_parts_with_the_present_in_the_middle():
    phases = phase(np.arange(-20, 21), 20)
    assert np.diff(phases) == pytest.approx(360 / 41)
    assert phases[20] == 180
    assert phases[0] == pytest.approx(360 / 41 / 2)


def test_a_field_that_is_visited_twice_counts_from_the_visit_that_the_offset_tells_of():
    # the queue reaches 250 px, more than half of the 400 px once around
    square = Path(np.array([(0, 0), (100, 0), (100, 100), (0, 100)], float))
    arcs = 140 + 5.0 * np.arange(201)
    truth = np.array([square.at(arc) for arc in arcs])
    fields = PlaceFields(square, np.array([(50.0, 0.0)]), 12.0)  # at arcs 450 and 850
    cycles = perfect_cycles(truth, fields, 50)
    assert cycles.progress == pytest.approx(arcs - 140)
    # both visits are seen whole from every offset: nothing is cut off
    assert precession(cycles).slope == pytest.approx(-360 / 101 / 5, rel=ROUNDING)


def test_a_lag_longer_than_the_lap_reaches_as_far_as_the_lap():
    cycles = perfect_cycles(straight(60, 20.0), FIELDS, 10**6)
    assert cycles.activity.shape == (61, 121, 2)
    x = 20 * (np.arange(61)[:, None] + cycles.offsets)
    in_a_field = (np.abs(x - 500) < 32) | (np.abs(x - 600) < 32)
    right = right_mass(cycles)
    assert (right[in_a_field] == 1).all()
    assert np.isnan(right[~in_a_field]).all()


def test_a_belief_that_is_not_finite_is_named():
    with pytest.raises(RuntimeError, match=r"t = 3 about x\[3\] is not finite"):
        believed(straight(10), lambda t, k: math.nan if t == 3 else 0.0, lag=0)
