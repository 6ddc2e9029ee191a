"""What becomes of a log: actions of its odometry, records apart, fewer beams, a reference."""

import math

import numpy as np
import pytest
from bags import written
from drives import read_and_warned, real
from hypothesis import given
from hypothesis import strategies as st

from deqmcl_gym import logs
from deqmcl_gym.envs.log import spacing
from deqmcl_gym.logs.motion import composed, dead_reckoned, increments_of, relative, sideways_of
from deqmcl_gym.validation import InputError

sizes = st.one_of(st.just(0.0), st.floats(2**-13, 10.0, width=32))


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
    arc = np.array([[chord * math.cos(turn / 2), chord * math.sin(turn / 2), turn]])
    strafed = composed(arc, np.array([0, aside, 0]))
    increments = increments_of(np.vstack([np.zeros(3), arc, strafed]))
    np.testing.assert_allclose(sideways_of(increments), [0.0, aside], atol=1e-12)


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
        ("0.2m,5deg", (0.2, math.radians(5))), ("5°, 0.2 m", (0.2, math.radians(5))),
        ("0.2m", (0.2, math.inf)), (".5rad", (math.inf, 0.5)), ((0.2, 0.1), (0.2, 0.1)),
        *((bad, None) for bad in ("", "0.2", "0.2m,0.3m", "-1m", "nanm", "9px", 3, None, (1,))),
    ],
)  # fmt: skip
def test_every_is_a_distance_and_an_angle_and_nothing_else(text, meant):
    if meant is None:
        with pytest.raises(InputError, match="every"):
            spacing("every", text, "m")
    else:
        assert spacing("every", text, "m") == pytest.approx(meant)


def drive(n=60, noise=0.0):
    """A log, and where the robot truly was: elsewhere, with noise of its own."""
    rng = np.random.default_rng(0)
    steps = np.column_stack([rng.uniform(0.0, 0.1, n - 1), rng.choice([-0.3, 0.0, 0.3], n - 1)])
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


def test_a_gap_of_the_reference_has_none_also_where_the_robot_comes_back(tmp_path):
    log, true = drive()
    known = np.r_[0:20, 40:60]
    found = logs.referenced(log, logs.Trajectory(log.times[known], true[known]), max_gap=0.2)
    assert found.referenced.tolist() == known.tolist()
    there = np.column_stack([np.r_[0:30, 30:-1:-1] * 0.2, np.zeros((61, 2))])
    log = logs.Log(log.scanner, np.arange(61.0), there, np.ones((61, 1)))
    logs.write(log, tmp_path / "x.npz")
    logs.Trajectory([0.0, 60.0], there[[0, 60]]).write(tmp_path / "x.tum")
    read, warned = read_and_warned(tmp_path / "x.npz", reference=tmp_path / "x.tum")
    assert read.referenced.tolist() == [0, 60]
    assert "a pose for only 2 of 61 records" in warned
    assert "reference: at 2 of 61 records" in str(read)


def test_between_sparse_poses_fast_turns_cost_little_where_straight_lines_cost_much():
    log, true = drive(400, noise=0.05)
    sparse = logs.Trajectory(log.times[::8], true[::8])
    known = slice(0, len(log) // 8 * 8 - 7)
    off = relative(logs.referenced(log, sparse).reference[known], true[known])
    columns = [*sparse.poses.T[:2], np.unwrap(sparse.poses[:, 2])]
    lines = np.column_stack([np.interp(log.times, sparse.times, one) for one in columns])
    straight = relative(lines[known], true[known])
    # a random walk of 8 steps that is pinned at both ends: noise × a step × √(8 / 4) in SD
    assert np.abs(off[:, 2]).std() < 0.05 * 0.3 * np.sqrt(8 / 4)
    assert np.hypot(*off.T[:2]).max() < 0.5 * np.hypot(*straight.T[:2]).max()
    assert np.abs(off[::8]).max() < 1e-9  # as it says


def test_a_log_says_which_poses_of_its_reference_are_interpolated():
    log, true = drive(400)
    sparse = logs.Trajectory(log.times[::8], true[::8])
    found = logs.referenced(log, sparse)
    at_stamps = np.isin(log.times, sparse.times)
    inside = log.times <= sparse.times[-1]
    np.testing.assert_array_equal(found.interpolated, inside & ~at_stamps)
    part = found.spaced(0.2, 0.1)
    among = inside[np.isin(log.times, part.times)] & ~np.isin(part.times, sparse.times)
    np.testing.assert_array_equal(part.interpolated, among)
    assert f"{int((inside & ~at_stamps).sum())} of them interpolated" in str(found)


@pytest.mark.parametrize("ending", [".csv", ".npz", ".log"])
def test_records_that_share_a_stamp_keep_the_pose_of_each(tmp_path, ending):
    scanner = logs.Scanner(angles=(0.0,), max_range=9.0)
    poses = np.column_stack([[0.0, 1.0, 2.0, 3.0], np.zeros((4, 2))])
    reference = poses + np.array([5.0, 0.0, 0.0])
    log = logs.Log(scanner, [0.0, 1.0, 1.0, 2.0], poses, np.ones((4, 1)), reference)
    written(log, tmp_path / f"x{ending}")
    back = logs.read(tmp_path / f"x{ending}")
    np.testing.assert_array_equal(back.reference, log.reference)
    assert back.interpolated is None or not back.interpolated.any()
    bare = logs.Log(scanner, log.times, poses, log.ranges)
    both = logs.referenced(bare, logs.Trajectory([0.0, 1.0, 2.0], log.reference[[0, 1, 3]]))
    np.testing.assert_array_equal(both.reference, log.reference[[0, 1, 1, 3]])
    assert both.referenced.size == 4


@pytest.mark.parametrize("ending", [".csv", ".npz"])
@pytest.mark.parametrize("damaged", [False, True])
def test_a_row_without_a_reference_has_none_beside_a_damaged_row(tmp_path, ending, damaged):
    log, true = drive(10)
    reference = np.where(np.isin(np.arange(10), (0, 4, 9))[:, None], true, np.nan)
    whole = logs.Log(log.scanner, log.times, log.odometry, log.ranges, reference)
    path = tmp_path / f"x{ending}"
    logs.write(whole, path)
    if damaged and ending == ".csv":
        lines = path.read_text().splitlines()
        cells = lines[-6].split(",")
        lines[-6] = ",".join([cells[0], "nan", *cells[2:]])
        path.write_text("\n".join(lines))
    elif damaged:
        arrays = dict(np.load(path))
        arrays["odometry"][4, 0] = np.nan
        np.savez(path, **arrays)
    back, _ = read_and_warned(path)
    assert back.times[back.referenced].tolist() == ([0.0, 9.0] if damaged else [0.0, 4.0, 9.0])


@pytest.mark.parametrize("ending", [".log", ".bag"])
def test_poses_in_a_log_with_their_own_stamps_are_interpolated_as_those_beside_it(tmp_path, ending):
    log, true = drive()
    reference = np.where((np.arange(60) % 5 == 0)[:, None], true, np.nan)
    sparse = logs.Log(log.scanner, log.times, log.odometry, log.ranges, reference)
    written(sparse, tmp_path / f"x{ending}")
    found = logs.read(tmp_path / f"x{ending}")
    assert found.interpolated.sum() == 44  # of 12 stretches the last ends with the log's record 55
    assert np.abs(relative(found.reference[:56], true[:56])).max() < 1e-9
    bare = logs.read(tmp_path / f"x{ending}", max_gap=0.0)
    assert bare.referenced.tolist() == list(range(0, 60, 5))
    with pytest.raises(InputError, match="max_gap"):
        logs.read(tmp_path / f"x{ending}", max_gap=-1.0)
