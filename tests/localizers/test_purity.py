"""What is given is not changed, what is returned is not shared, the rng given is the only one."""

import math
import random

import numpy as np
import pytest
from following import FAMILY, follow, same, small

import localizers

NAMES = localizers.names()


def make(name: str, robot, particles: int):
    return localizers.make(name, robot, **small(name, particles))


@pytest.mark.parametrize("name", NAMES)
def test_the_arrays_given_are_not_changed_and_not_kept(robot, prior, drive, name):
    actions, scans = drive
    undisturbed = follow(make(name, robot, particles=30), prior, drive)
    localizer = make(name, robot, particles=30)
    plan = actions.copy()
    beliefs = [localizer.reset(prior, plan, np.random.default_rng(0))]
    assert np.array_equal(plan, actions)
    plan[:] = 99.0
    for t, (action, scan) in enumerate(zip(actions, scans, strict=True), start=1):
        given = (scan.copy(), action.copy(), actions[t:].copy())
        beliefs.append(localizer.update(*given))
        for seen, expected in zip(given, (scan, action, actions[t:]), strict=True):
            assert np.array_equal(seen, expected)
            seen[:] = 99.0
    assert same(beliefs, undisturbed, offsets=range(-12, 13))


@pytest.mark.parametrize("name", NAMES)
def test_read_only_arrays_and_plain_lists_are_taken(robot, prior, drive, name):
    actions, scans = (array.copy() for array in drive)
    actions.flags.writeable = scans.flags.writeable = False
    beliefs = follow(make(name, robot, particles=30), prior, (actions, scans))
    lists = [actions[t:].tolist() for t in range(len(actions) + 1)]
    listed = follow(
        make(name, robot, particles=30), prior, (actions.tolist(), scans.tolist()), plans=lists
    )
    assert same(beliefs, listed)


@pytest.mark.parametrize("name", NAMES)
def test_points_are_fresh_so_writing_into_them_changes_no_belief(robot, prior, drive, name):
    undisturbed = follow(make(name, robot, particles=30), prior, drive)
    localizer = make(name, robot, particles=30)
    actions, scans = drive
    beliefs = [localizer.reset(prior, actions, np.random.default_rng(0))]
    for t, (action, scan) in enumerate(zip(actions, scans, strict=True), start=1):
        for offset in range(-12, 13):
            if (points := beliefs[-1].points(offset)) is not None:
                points[0][:] = 99.0
                points[1][:] = 99.0
        beliefs.append(localizer.update(scan, action, actions[t:]))
    assert same(beliefs, undisturbed, offsets=range(-12, 13))


@pytest.mark.parametrize("name", NAMES)
def test_a_belief_stays_what_it_was_when_the_localizer_goes_on(robot, prior, drive, name):
    localizer = make(name, robot, particles=30)
    beliefs = follow(localizer, prior, drive)
    before = [belief.points()[0].copy() for belief in beliefs]
    localizer.reset(prior, drive[0], np.random.default_rng(5))
    localizer.update(drive[1][0], drive[0][0], drive[0][1:])
    assert all(np.array_equal(b.points()[0], p) for b, p in zip(beliefs, before, strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_the_global_random_states_are_left_alone(robot, prior, drive, name):
    before = np.random.get_state(legacy=False), random.getstate()  # noqa: NPY002
    follow(make(name, robot, particles=30), prior, drive)
    after = np.random.get_state(legacy=False), random.getstate()  # noqa: NPY002
    assert before[0]["state"]["pos"] == after[0]["state"]["pos"]
    assert np.array_equal(before[0]["state"]["key"], after[0]["state"]["key"])
    assert before[1] == after[1]


@pytest.mark.parametrize("name", NAMES)
def test_points_have_poses_in_rows_and_weights_of_sum_one(robot, prior, drive, name):
    counts = {"dead-reckoning": {1}, "ekf": {512}, "grid": range(1, 9 * 10 * 12 + 1)}
    for belief in follow(make(name, robot, particles=30), prior, drive):
        poses, weights = belief.points()
        n = len(poses)
        assert n in counts.get(name, {30})
        assert poses.shape == (n, 3)
        assert weights.shape == (n,)
        assert weights.dtype == np.float64
        assert weights.min() >= 0
        assert weights.sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("resampler", ["systematic", "stratified", "multinomial"])
@pytest.mark.parametrize("name", FAMILY)
def test_one_particle_works(robot, prior, drive, name, resampler):
    actions, scans = drive
    plans = [actions[t:] + np.array([0.0, 0.01 * (t > 3)]) for t in range(len(actions) + 1)]
    localizer = localizers.make(name, robot, particles=1, resampler=resampler)
    for belief in follow(localizer, prior, (actions, scans), plans=plans):
        poses, weights = belief.points()
        assert poses.shape == (1, 3)
        assert np.isfinite(poses).all()
        assert weights.tolist() == [1.0]
        assert belief.effective_sample_size == 1.0


def test_the_mean_heading_of_179_and_minus_179_degrees_is_180():
    poses = np.array([(1, 5, math.radians(179)), (3, 7, math.radians(-179))])
    x, y, heading = localizers.mean_pose(poses, np.array([0.5, 0.5]))
    assert (x, y) == (2.0, 6.0)
    assert abs(math.degrees(heading)) == pytest.approx(180.0, abs=1e-9)


def test_the_mean_pose_is_weighted():
    poses = np.array([(0, 0, 0.0), (4, 8, math.pi / 2)])
    x, y, heading = localizers.mean_pose(poses, np.array([0.75, 0.25]))
    assert (x, y) == (1.0, 2.0)
    assert heading == pytest.approx(math.atan2(0.25, 0.75))
