"""A reference at other times than the records': nearer to the truth than straight lines."""

import numpy as np
import pytest
from drives import read_and_warned
from hypothesis import given
from hypothesis import strategies as st

from deqmcl_gym import logs
from deqmcl_gym.logs.motion import composed, dead_reckoned, relative


def drive(n=60, noise=0.0, seed=0):
    """A log, and where the robot truly was: elsewhere, with noise of its own."""
    rng = np.random.default_rng(seed)
    steps = np.column_stack([rng.uniform(0.05, 0.1, n - 1), rng.normal(0.1, 0.3, n - 1)])
    odometry = dead_reckoned(steps)
    true = dead_reckoned(steps * (1 + noise * rng.standard_normal(steps.shape)), (5.0, 7.0, 1.0))
    scanner = logs.Scanner(angles=(0.0,), max_range=9.0)
    return logs.Log(scanner, np.arange(float(n)), odometry, np.ones((n, 1))), true


def off(log, true):
    return np.abs(relative(log.reference, true)).max()


@given(st.integers(2, 9))
def test_between_poses_of_the_reference_the_robot_follows_its_odometry(stride):
    log, true = drive()
    sparse = logs.Trajectory(log.times[::stride], true[::stride])
    found = logs.referenced(log, sparse)
    last = (len(log) - 1) // stride * stride
    assert np.isfinite(found.reference[: last + 1]).all()
    assert np.isnan(found.reference[last + 1 :]).all()
    assert off(found.segment(0, last + 1), true[: last + 1]) < 1e-9


def test_the_odometrys_error_is_spread_over_the_way_between_poses():
    log, true = drive(noise=0.03)
    sparse = logs.Trajectory(log.times[::6], true[::6])
    found = logs.referenced(log, sparse)
    assert off(found.of_records(slice(0, 55, 6)), true[:55:6]) < 1e-9  # as it says
    x, y = (np.interp(log.times[:55], sparse.times, column) for column in sparse.poses.T[:2])
    straight = np.hypot(x - true[:55, 0], y - true[:55, 1])
    followed = np.hypot(*(found.reference[:55] - true[:55])[:, :2].T)
    assert followed.max() < 0.3 * straight.max()


def test_poses_before_the_first_record_and_after_the_last_are_used_too():
    log, true = drive()
    part = log.segment(3, 50)
    ends = logs.Trajectory(log.times[[0, 10, 45, 59]], true[[0, 10, 45, 59]])
    found = logs.referenced(part, ends, max_gap=np.inf)
    assert np.isfinite(found.reference).all()
    inner = slice(7, 43)  # between records that the odometry reaches
    assert off(found.of_records(inner), true[3:53][inner]) < 1e-9
    first = relative(true[:1], found.reference[:1])[0]
    whole = relative(true[:1], true[10:11])[0]
    assert first == pytest.approx(0.3 * whole)  # straight, by time


def test_a_gap_of_the_reference_has_none():
    log, true = drive()
    known = np.r_[0:20, 40:60]
    found = logs.referenced(log, logs.Trajectory(log.times[known], true[known]), max_gap=0.2)
    assert found.referenced.tolist() == known.tolist()


def test_a_gap_in_which_the_robot_comes_back_to_where_it_was_has_none_either():
    there = np.column_stack([np.r_[0:30, 30:-1:-1] * 0.2, np.zeros((61, 2))])
    scanner = logs.Scanner(angles=(0.0,), max_range=5.0)
    log = logs.Log(scanner, np.arange(61.0), there, np.ones((61, 1)))
    ends = logs.Trajectory([0.0, 60.0], there[[0, 60]])
    with pytest.warns(logs.LogWarning, match="only 2 of 61"):
        assert logs.referenced(log, ends).referenced.tolist() == [0, 60]


def test_a_reference_of_few_records_is_warned_of(tmp_path):
    log, true = drive()
    logs.write(log, tmp_path / "x.npz")
    logs.Trajectory(log.times[:5], true[:5]).write(tmp_path / "x.tum")
    read, warned = read_and_warned(tmp_path / "x.npz", reference=tmp_path / "x.tum")
    assert "a pose for only 5 of 60 records" in warned
    assert "reference: at 5 of 60 records" in str(read)


@given(st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-3, 3)))
def test_a_pose_seen_from_another_leads_back_to_it(offset):
    _, poses = drive(8)
    there = composed(poses, np.array(offset))
    np.testing.assert_allclose(
        relative(poses, there), np.broadcast_to(offset, poses.shape), atol=1e-9
    )
