"""When a robot counts as localized, falsely committed and found again, against hand-made runs."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.trials.fixes import NEAR, RECOVERED_STEPS, Fixes, driven, metre

NEVER = math.inf


def fixes(distance, angle=0.0, quality=math.nan, *, steps=None, count=None, stride=0.5):
    """Fixes of a run that drives ``stride`` metres a step."""
    off = np.array(distance, np.float64)
    at = np.arange(off.size) if steps is None else np.array(steps)
    return Fixes(
        steps=at,
        count=count or off.size,
        way=stride * at,
        distance=off,
        angle=np.broadcast_to(np.array(angle, np.float64), off.shape),
        quality=np.broadcast_to(np.array(quality, np.float64), off.shape),
    )


@pytest.mark.parametrize(
    ("distance", "metres"),
    [
        ([0, 0, 0, 0], 0.0),
        ([5, 5, 0.9, 1.0], 1.0),
        ([5, 0, 0, 5, 5, 0, 0, 0], 2.5),  # lost again: from where on it stays so
        ([0, 0, 0, 1.001], NEVER),  # lost in the last step
        ([5, 5, 5], NEVER),
    ],
)
def test_metres_to_localize_are_those_from_where_on_it_stays_localized(distance, metres):
    assert fixes(distance).metres_to_localize == metres


def test_both_the_distance_and_the_angle_must_be_near():
    half_right = [[0.4, 0.6, 1.0, 1.1], np.radians([9, 9, 30, 0])]
    assert fixes(*half_right).localized("05m").tolist() == [True, False, False, False]
    assert fixes(*half_right).localized("1m").tolist() == [True, True, True, False]


def test_success_is_judged_in_every_step_of_the_last_quarter_and_in_no_other():
    assert fixes([9, 9, 9, 9, 9, 9, 0, 0]).success("1m") == 1
    assert fixes([0, 0, 0, 0, 0, 0, 9, 0]).success("1m") == 0
    # the reference of a log ends early: nothing is known of its last quarter
    assert math.isnan(fixes([0, 0], steps=[0, 1], count=8).success("1m"))


@given(st.lists(st.floats(0, 3), min_size=1, max_size=30))
def test_a_success_is_localized_before_the_last_quarter_begins(distance):
    run = fixes(distance)
    assert math.isfinite(run.metres_to_localize) == (distance[-1] <= NEAR["1m"][0])
    if run.success("1m"):
        assert run.metres_to_localize <= run.way[run.last][0]


def test_a_commitment_is_false_above_one_half_and_beyond_two_metres():
    run = fixes([3, 3, 2, 3, 3], quality=[0.9, 0.5, 0.9, 0.51, math.nan])
    assert run.false.tolist() == [True, False, False, True, False]
    assert run.rated.tolist() == [False, True, True, True, False]  # nothing was seen at t = 0


def test_a_kidnapped_robot_is_found_where_twenty_good_steps_on_end_begin():
    bad, good = [9.0], [0.45]
    short = good * (RECOVERED_STEPS - 1)
    before = good * 10
    found = before + bad * 4 + short + bad + good * RECOVERED_STEPS + bad
    assert fixes(found).metres_to_recover(10) == 0.5 * (4 + len(short) + 1)
    assert fixes(before + bad * 4 + short).metres_to_recover(10) == NEVER
    assert fixes(before + good * 30).metres_to_recover(10) == 0
    assert fixes(before).metres_to_recover(10) == NEVER  # carried off in the last step


def test_the_way_is_what_was_commanded_and_a_metre_is_fifty_pixels():
    assert driven([[1.0, 9.0], [-2.0, 0.0]]).tolist() == [0, 1, 3]
    assert driven([[-2.0, 0.0, 9.0], [0.3, 0.4, 7.0]]).tolist() == [0, 2, 2.5]
    assert (metre("px"), metre("m")) == (50.0, 1.0)


@pytest.mark.parametrize(
    ("distance", "lost_at"),
    [([0, 0, 5, 0], None), ([0, 5, 0, 5, 5], 3), ([5, 5], 0), ([0, 0, 1.001], 2), ([], None)],
)
def test_it_is_lost_from_the_first_step_after_which_it_is_never_again_localized(distance, lost_at):
    assert fixes(distance).lost_at == lost_at
