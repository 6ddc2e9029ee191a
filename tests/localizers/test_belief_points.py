"""What a localizer takes and what it gives: lists and read-only arrays; poses and their means."""

import math

import numpy as np
import pytest
from following import follow, same, small

import localizers

NAMES = localizers.names()


@pytest.mark.parametrize("name", NAMES)
def test_read_only_arrays_and_plain_lists_are_taken(robot, prior, drive, name):
    actions, scans = (array.copy() for array in drive)
    actions.flags.writeable = scans.flags.writeable = False
    beliefs = follow(localizers.make(name, robot, **small(name, 30)), prior, (actions, scans))
    lists = [actions[t:].tolist() for t in range(len(actions) + 1)]
    listed = follow(
        localizers.make(name, robot, **small(name, 30)),
        prior,
        (actions.tolist(), scans.tolist()),
        plans=lists,
    )
    assert same(beliefs, listed)


@pytest.mark.parametrize("name", NAMES)
def test_the_poses_are_as_many_as_the_particles(robot, prior, drive, name):
    counts = {"dead-reckoning": {1}, "ekf": {512}, "grid": range(1, 9 * 10 * 12 + 1)}
    for belief in follow(localizers.make(name, robot, **small(name, 30)), prior, drive):
        assert len(belief.points()[0]) in counts.get(name, {30})


def test_the_mean_heading_of_179_and_minus_179_degrees_is_180():
    poses = np.array([(1, 5, math.radians(179)), (3, 7, math.radians(-179))])
    x, y, heading = localizers.mean_pose(poses, np.array([0.5, 0.5]))
    assert (x, y) == (2.0, 6.0)
    assert abs(math.degrees(heading)) == pytest.approx(180.0, abs=1e-9)
