"""What becomes of a log: actions of its odometry, records apart, fewer beams."""

import math

import numpy as np
import pytest
from drives import real
from hypothesis import given
from hypothesis import strategies as st

from deqmcl_gym.envs.log import spacing
from deqmcl_gym.logs.motion import composed, dead_reckoned, increments_of, relative, sideways_of
from deqmcl_gym.validation import InputError


@given(
    steps=st.lists(
        st.tuples(st.floats(-1, 1), st.floats(-3, 3), st.floats(-1, 1)), min_size=1, max_size=20
    )
)
def test_increments_lead_from_each_pose_to_the_next(steps):
    poses = [np.array([[1.0, 2.0, 3.0]])]
    for step in steps:
        poses.append(composed(poses[-1], np.array([step])))
    track = np.concatenate(poses)
    found = increments_of(track)
    gone = [dead_reckoned([one], start)[1] for one, start in zip(found, track[:-1], strict=True)]
    np.testing.assert_allclose(relative(track[1:], np.array(gone)), 0, atol=1e-9)
    np.testing.assert_allclose(relative(track, dead_reckoned(found, track[0])), 0, atol=1e-8)


@given(st.floats(-2, 2), st.floats(-3, 3), st.floats(-1, 1))
def test_what_is_sideways_is_nothing_on_an_arc_and_all_of_a_strafe(length, turn, aside):
    chord = length * (math.sin(turn / 2) / (turn / 2) if turn else 1.0)
    arc = composed(
        np.zeros((1, 3)), np.array([chord * math.cos(turn / 2), chord * math.sin(turn / 2), turn])
    )
    increments = increments_of(
        np.vstack([np.zeros(3), arc, composed(arc, np.array([0, aside, 0]))])
    )
    np.testing.assert_allclose(sideways_of(increments), [0.0, aside], atol=1e-12)


sizes = st.one_of(st.just(0.0), st.floats(2**-13, 10.0, width=32))


@given(st.lists(st.tuples(sizes, st.floats(0.0, 3.0, width=32)), min_size=1, max_size=30))
def test_actions_come_back_to_the_bit_zeros_included(steps):
    actions = np.float32([(d, turn if turn > 2**-13 else 0.0) for d, turn in steps])
    found = increments_of(dead_reckoned(actions))
    np.testing.assert_array_equal(found[:, [0, 2]].astype(np.float32), actions)
    np.testing.assert_allclose(found[:, 1], 0, atol=1e-12)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_records_are_played_as_far_apart_as_every_says(distance, angle):
    log = real(60)
    kept = log.spaced(distance, angle)
    chosen = np.searchsorted(log.times, kept.times)
    expected, last = [0], log.odometry[0]
    for index, pose in enumerate(log.odometry[1:], start=1):
        turn = abs(math.remainder(pose[2] - last[2], 2 * math.pi))
        if math.hypot(*(pose - last)[:2]) >= distance or turn >= angle:
            expected.append(index)
            last = pose
    assert chosen.tolist() == expected


@given(st.integers(1, 60), st.integers(1, 70))
def test_beams_are_thinned_evenly_and_keep_the_ends(beams, most):
    log = real(3, beams).with_beams(most)
    assert log.scanner.beams == min(beams, most)
    whole = real(3, beams)
    kept = [whole.scanner.angles.index(angle) for angle in log.scanner.angles]
    np.testing.assert_array_equal(log.ranges, whole.ranges[:, kept])
    if 1 < most < beams:
        assert (kept[0], kept[-1]) == (0, beams - 1)
        assert np.ptp(np.diff(kept)) <= 1


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("0.2m,5deg", (0.2, math.radians(5))),
        ("5°, 0.2 m", (0.2, math.radians(5))),
        ("0.2m", (0.2, math.inf)),
        (".5rad", (math.inf, 0.5)),
        ((0.2, 0.1), (0.2, 0.1)),
    ],
)
def test_every_is_a_distance_and_an_angle(text, meant):
    assert spacing("every", text, "m") == pytest.approx(meant)


@pytest.mark.parametrize(
    "bad", ["", "0.2", "0.2m,0.3m", "0.2m;5deg", "-1m", "nanm", "9px", 3, None, (1,)]
)
def test_anything_else_is_refused(bad):
    with pytest.raises(InputError, match="every"):
        spacing("every", bad, "m")
