"""What real robots send: references, clocks, frames and files as drivers make them."""

import gzip
import itertools
import shutil

import bags
import numpy as np
import pytest
from bags import ODOMETRY, SCAN, TF, bag, by_tf, driven, moving, quaternion, scanning, transform
from drives import NAN, read_and_warned
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused

from deqmcl_gym import logs
from deqmcl_gym.logs.motion import composed, increments_of
from deqmcl_gym.logs.odometry import JudgedOdometry, Odometry, Taken, clock_shifts, without_jumps
from deqmcl_gym.logs.trajectory import read_estimate, tolerance_of

TIMES, POSES = driven()
MOUNT = (0.2, -0.1, 0.4)
LOG = logs.Log(logs.Scanner(angles=(0.0,), max_range=5.0), TIMES, POSES, np.ones((41, 1)))
RECORDS = TIMES[1:40:4]


def interleaved(times, poses):
    pairs = zip(moving(times, poses), scanning(times), strict=True)
    return [message for pair in pairs for message in pair]


def placed(x=MOUNT[0], y=MOUNT[1], yaw=MOUNT[2], base="base_footprint", space=""):
    return (f"{space}/tf_static", TF, transform(base, "laser", x, y, yaw=yaw))


def place(log):
    return (*log.scanner.mounting, log.scanner.turn)


def referenced_by(stamps, at=slice(1, 40, 4), tolerance=None):
    """A log of scans 0.4 s apart, and with a reference at such stamps, s."""
    log = LOG.of_records(np.arange(41)[at])
    columns = [np.interp(stamps, TIMES, column) for column in POSES.T]
    reference = logs.Trajectory(stamps, np.column_stack(columns))
    return log, logs.referenced(log, reference, tolerance=tolerance)


@pytest.mark.parametrize(
    ("stamps", "records"),
    [
        (RECORDS + 4e-7, slice(1, 40, 4)),  # rounded to microseconds
        (RECORDS + np.linspace(-5e-4, 5e-4, 10), slice(1, 40, 4)),  # to milliseconds
        (RECORDS + np.resize([0.019, -0.019], 10), slice(1, 40, 4)),
        (np.arange(0.0031, TIMES[-1], 0.01), slice(None)),  # motion capture at 100 Hz
    ],
)
def test_a_reference_pose_near_in_time_is_the_records_own_moved_by_the_odometry(stamps, records):
    log, found = referenced_by(stamps, records)
    assert not found.interpolated.any()
    # the odometry is the truth here, on straight lines between records 0.08 m and 0.04 rad apart
    np.testing.assert_allclose(found.reference, log.odometry, rtol=0, atol=2e-3)


def test_a_pose_farther_off_in_time_is_interpolated_and_the_tolerance_can_be_given():
    log, found = referenced_by(RECORDS + 0.03)
    assert tolerance_of(log) == pytest.approx(0.02)
    assert found.interpolated[1:].all()
    assert not np.isfinite(found.reference[0, 0])  # before the first pose
    assert not referenced_by(RECORDS + 0.03, tolerance=0.05)[1].interpolated.any()
    assert tolerance_of(log.segment(0, 1)) == 0.0


def test_odometry_of_records_is_judged_as_that_of_messages():
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.05, 2.0, 300))
    poses = np.cumsum(rng.normal(0, [0.3, 0.3, 0.2], (300, 3)), axis=0)
    poses[100:] += 30.0, -40.0, 3.0  # far away
    poses[200:] -= poses[200]  # anew at the origin
    messages = Odometry("m")
    for time, pose in zip(times.tolist(), poses.tolist(), strict=True):
        assert messages.take(time, tuple(pose)) is Taken.USED
    found, jumps = without_jumps(times, poses, "m")
    assert jumps == messages.jumps == 2
    np.testing.assert_allclose(found[:, :2], np.array(messages.stretch.poses)[:, :2], atol=1e-9)
    off = found[:, 2] - np.array(messages.stretch.poses)[:, 2]
    np.testing.assert_allclose(np.cos(off), 1.0, atol=1e-12)


@pytest.mark.parametrize(("heading", "jumps"), [(0.0, 1), (2 * np.pi, 1), (3.3, 0), (-3.3, 0)])
def test_a_slow_step_to_the_origin_is_a_driver_that_begins_anew_only_at_heading_0(heading, jumps):
    poses = np.array([(0.6, 0.0, heading), (0.0, 0.0, heading)])
    assert without_jumps(np.array([0.0, 5.0]), poses, "m")[1] == jumps


def test_a_reference_that_jumps_or_is_tilted_is_told(tmp_path):
    jumped = POSES.copy()
    jumped[:5] = 0.0
    with pytest.warns(logs.LogWarning, match=r"jumps farther than a robot drives, once, .* m"):
        logs.referenced(LOG, logs.Trajectory(TIMES, jumped))
    half = POSES[:, 2] / 2
    sine, cosine, none = np.sin(half), np.cos(half), np.zeros(41)
    tilted = {
        "camera": (none, -sine, none, cosine),  # z ahead, y down
        "first": (cosine, none, none, sine),  # qw first
        "plain": (none, none, sine, cosine),
    }
    for name, quaternions in tilted.items():
        table = np.column_stack([TIMES, POSES[:, :2], none, *quaternions])
        np.savetxt(tmp_path / f"{name}.tum", table)
    with pytest.warns(logs.LogWarning, match=r"tilted by up to \d+°: give poses .* z up"):
        logs.read_tum(tmp_path / "camera.tum")
    with pytest.warns(logs.LogWarning, match=r"tilted by up to \d+°: they are read with qw first"):
        found = logs.read_tum(tmp_path / "first.tum")
    np.testing.assert_allclose(found.poses, POSES, atol=1e-12)
    np.testing.assert_allclose(logs.read_tum(tmp_path / "plain.tum").poses, POSES, atol=1e-12)


@pytest.mark.parametrize(
    ("factor", "unit"), [(1e9, "nanoseconds"), (1e6, "microseconds"), (1e3, "milliseconds")]
)
def test_times_in_another_unit_than_seconds_are_asked_for(tmp_path, factor, unit):
    path = tmp_path / "x.tum"
    path.write_text("".join(f"{1.7e9 * factor + t:.0f} 0 0 0 0 0 0 1\n" for t in range(3)))
    for read in (logs.read_tum, read_estimate):
        with refused(str(path), f"are these {unit}?"):
            read(path)


@settings(max_examples=60)
@given(
    at=st.integers(1, 39),
    frame=st.tuples(st.floats(5, 900), st.floats(-900, 900), st.floats(-3, 3)),
    back=st.sampled_from([0.0, 1.5, 60.0, 1e6]),
    doubled=st.sets(st.integers(0, 39)),
)
def test_odometry_that_begins_anew_or_comes_twice_has_true_increments(at, frame, back, doubled):
    moved = composed(np.array([frame] * 41), POSES)
    sent = np.where(np.arange(41)[:, None] >= at, moved, POSES)
    stamps = TIMES - back * (np.arange(41) >= at)
    order = np.sort([*range(41), *doubled])  # each doubled message follows itself
    timed = np.column_stack([stamps, sent])[order]
    found = JudgedOdometry.of(np.arange(len(order)), np.full(len(order), NAN), timed, "m")
    jumped = np.concatenate([np.array(one.poses) for one in found.stretches])
    steps, true = increments_of(jumped), increments_of(POSES)
    true[at - 1] = 0.0  # at the jump itself, nothing is known of the motion
    if at == 40 and back:  # a single message of another clock is a late one
        steps, true = steps[:39], true[:39]
    else:
        assert (found.jumps, len(found.stretches)) == (int(not back), 1 + bool(back))
    np.testing.assert_allclose(steps, true, atol=1e-9)


def test_a_clock_that_is_set_back_begins_a_stretch_whose_times_go_on(heard):
    log, warned = heard(*interleaved(10.0 + TIMES - 2.0 * (TIMES > 1.95), POSES))
    assert "the clock was set back, once" in warned
    # of the scan that came before the clock was known to be another, nothing is known
    assert len(log) in (40, 41)
    assert (np.diff(log.times) > 0).all()
    steps = increments_of(log.odometry)[:18]
    np.testing.assert_allclose(steps, increments_of(POSES)[:18], atol=1e-9)
    assert log.driven[-1] == pytest.approx(0.8, abs=0.03)


def test_clocks_are_shifted_in_files_as_in_the_loop_of_a_robot():
    assert clock_shifts([0.0, 1.0, 2.0, 3.0, 0.5, 1.5]).tolist() == [0, 0, 0, 0, 3.5, 3.5]
    assert clock_shifts([0.0, 1.0, 999.0, 2.0, 3.0]).tolist() == [0] * 5  # one stamp far ahead
    assert clock_shifts([10.0, 0.0, 11.0, 12.0]).tolist() == [0] * 4  # one far behind
    assert clock_shifts([NAN, 1.0, NAN, 2.0]).tolist() == [0] * 4


def test_which_of_two_publishers_is_taken_is_told_and_can_be_chosen(tmp_path):
    times, poses = driven(201, 0.05, 0.0)
    other = poses.copy()
    other[:, 0] += 0.01 * np.arange(201)
    pairs = zip(moving(times, poses), moving(times + 0.02, other), strict=True)
    both = [message for pair in pairs for message in pair]
    path = bag(tmp_path / "x", *both, *scanning(times[1:-1]))
    log, warned = read_and_warned(path)
    assert "2 publishers send odometry on /odom (1: 10 Hz, " in warned
    remedy = "choose another by odometry_publisher, as --set world.reading.odometry_publisher=2"
    assert remedy in warned
    assert log.driven[-1] == pytest.approx(9.9, abs=0.05)
    second, _ = read_and_warned(path, odometry_publisher=2)
    assert second.driven[-1] > 11
    with refused("odometry_publisher is 3, but must be a whole number from 1 to 2"):
        read_and_warned(path, odometry_publisher=3)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("stamps", "the headers of /odom have no stamps (all are 0)"),
        ("quaternions", "the quaternions of /odom are 0"),
        ("clock", "of another clock"),
    ],
)
def test_odometry_of_no_use_is_named_and_transforms_are_taken_if_there_are_any(heard, how, words):
    none = bags.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 0.0)
    for _, _, message in (odometry_ := moving(TIMES, POSES)):
        if how == "stamps":
            message.header.stamp.sec = message.header.stamp.nanosec = 0
        elif how == "clock":
            message.header.stamp.sec += 1000
        else:
            message.pose.pose.orientation = none
    messages = [*odometry_, *scanning(TIMES[1:-1])]
    with refused("has no usable odometry", words, "record an Odometry topic or /tf"):
        heard(*messages)
    log, warned = heard(*messages, *by_tf(TIMES, POSES))
    assert words in warned
    assert ": the odometry is taken from transforms" in warned
    np.testing.assert_allclose(log.odometry, POSES[1:-1], atol=1e-9)


@pytest.mark.parametrize("parent", ["odom", "r1/odom", "r1_odom", "world"])
@pytest.mark.parametrize("space", ["", "/r1"])
def test_odometry_is_what_moves_the_scanner_whatever_the_frames_are_called(heard, parent, space):
    base = "r1/base" if parent == "r1/odom" else "base"
    moved = by_tf(TIMES, POSES, parent, base, f"{space}/tf")
    wheel = [(f"{space}/tf", TF, transform(base, "wheel", 0.0, 0.3, yaw=t, time=t)) for t in TIMES]
    above = [(f"{space}/tf", TF, transform("map", parent, 0.5 * t, 0.0, time=t)) for t in TIMES]
    dock = [(f"{space}/tf", TF, transform(parent, "dock", 5.0, 0.0, time=t)) for t in TIMES]
    scans = scanning(TIMES[1:-1], topic=f"{space}/scan")
    fixed = placed(base=base, space=space)
    asks = ({}, {"odometry_frame": parent}, {"base_frame": f"/{base}"})  # as ROS 1 spelt it
    for more, asked in itertools.product(((), above), asks):
        sent = [fixed, *dock, *wheel, *more, *moved, *scans]
        log, warned = heard(*sent, **asked)
        np.testing.assert_allclose(log.odometry, POSES[1:-1], atol=1e-9)
        assert place(log) == pytest.approx(MOUNT)
        assert warned == ""
    with refused("odometry_frame 'odm'"):
        heard(*sent, odometry_frame="odm")
    with refused("no odometry"):
        heard(fixed, *scans)


@pytest.mark.parametrize(("scanned", "turn"), [("/r1/scan", 0.0), ("/r2/front/scan", 2.0)])
def test_each_of_two_robots_in_a_bag_has_its_own_frames_and_odometry(heard, scanned, turn):
    messages = []
    for robot, own in (("r1", 0.0), ("r2", 2.0)):
        messages.append(placed(0.1, 0.0, own, space=f"/{robot}"))
        moved = moving(TIMES, POSES + np.array([own, 0, 0]))
        messages += [(f"/{robot}/odom", ODOMETRY, one) for *_, one in moved]
    for topic in ("/r1/scan", "/r2/front/scan"):
        messages += scanning(TIMES[1:-1], topic=topic)
    log, warned = heard(*messages, scan_topic=scanned)
    assert warned == ""
    assert log.scanner.turn == pytest.approx(turn)
    np.testing.assert_allclose(log.odometry, POSES[1:-1] + np.array([turn, 0, 0]), atol=1e-9)


def test_a_body_that_rocks_has_the_mean_mounting_and_its_spread_is_told(heard):
    rng = np.random.default_rng(4)
    rolls = [{"roll": rng.normal(0, 0.01), "time": t} for t in TIMES]
    rocking = [("/tf", TF, transform("base_footprint", "body", 0.0, 0.0, **one)) for one in rolls]
    sent = [placed(base="body"), *rocking, *moving(TIMES, POSES), *scanning(TIMES[1:-1])]
    log, warned = heard(*sent)
    # the mean of 41 rolls is below 0.006 rad, 4 of its standard deviations, 0.3 m above the floor
    assert place(log) == pytest.approx(MOUNT, abs=3e-3)
    assert "the place of laser on base_footprint is the mean of transforms that vary" in warned
    assert "no static transform" not in warned


@pytest.mark.parametrize("base", ["robot/body", "somewhere"])
def test_without_a_transform_to_the_robots_frame_the_scanners_own_tree_is_taken(heard, base):
    moved = moving(TIMES, POSES, frame=base)
    log, warned = heard(placed(base="body"), *moved, *scanning(TIMES[1:-1]))
    assert place(log) == pytest.approx(MOUNT)
    assert ("the scanner's place on body is taken" in warned) == (base == "somewhere")


@pytest.mark.parametrize("by", ["/odom", "/tf"])
def test_a_pose_that_a_stack_tells_by_transforms_is_composed_with_the_odometry(tmp_path, by):
    drifted = composed(np.array([[3.0, -1.0, 0.7]] * 41), POSES)[::2]
    messages = moving(TIMES, POSES, frame="base")
    if by == "/tf":
        messages = by_tf(TIMES, POSES, base="base")
    there = np.column_stack([3.0 + 1e-3 * TIMES, np.full((41, 2), (-1.0, 0.7))])[::2]
    messages += by_tf(TIMES[::2], there, "map", "odom")
    path = bag(tmp_path / "x", *messages, *scanning(TIMES))
    drifted[:, 0] += 1e-3 * TIMES[::2]
    for topic in (None, "/tf"):
        found = read_estimate(path, topic)
        np.testing.assert_allclose(found.times, TIMES[::2])
        np.testing.assert_allclose(found.poses, drifted, atol=1e-9)


def test_a_pose_out_of_order_or_without_a_stamp_and_a_covariance_that_is_none_are_counted(tmp_path):
    upper = "var_x,cov_xy,cov_x_heading,var_y,cov_y_heading,var_heading"
    good, bad = "1,0,0,1,0,1", ("-1,0,0,1,0,1", "1,2,0,1,0,1", "1,0,0,1,0,0")
    start = 1_700_000_000
    rows = [f"0,0,0,0,{good}", *(f"{start + t},1,2,0.5,{good}" for t in (1, 2, 4, 3))]
    rows += [f"{start + 5 + t},1,2,0.5,{one}" for t, one in enumerate(bad)]
    text = "\n".join([f"time,x,y,heading,{upper}", *rows]) + "\n"
    (tmp_path / "x.csv.gz").write_bytes(gzip.compress(text.encode()))
    with pytest.warns(logs.LogWarning) as caught:
        found = read_estimate(tmp_path / "x.csv.gz")
    words = " ".join(str(one.message) for one in caught)
    assert "skipped 2 of 8 records" in words
    assert "3 of 6 covariances count as unknown" in words
    assert np.isnan(found.covariances[:, 0, 0]).tolist() == [False] * 3 + [True] * 3


@pytest.mark.parametrize("doubled", [0, 10])
def test_parts_of_a_bag_are_one_log_whatever_their_order_and_where_they_overlap(tmp_path, doubled):
    fixed, drive = placed(0.1, 0.0, 0.0), interleaved(TIMES, POSES)
    one, _ = read_and_warned(bag(tmp_path / "whole", fixed, *drive))
    paths = [bag(tmp_path / "second", *drive[30:], first=31)]
    paths.append(bag(tmp_path / "first", fixed, *drive[: 30 + 2 * doubled]))
    other, warned = read_and_warned(paths)
    assert warned == "" if doubled == 0 else f"{doubled} doubled" in warned
    assert other.source.endswith("and 1 more")
    np.testing.assert_array_equal(one.times, other.times)
    np.testing.assert_array_equal(one.odometry, other.odometry)
    assert one.scanner == other.scanner
    (tmp_path / "x.csv").write_text("")
    for files in ([tmp_path / "x.csv"] * 2, [paths[0], tmp_path / "x.csv"]):
        with refused("only bags have several parts"):
            logs.read(files)


def test_a_bag_that_was_cut_names_the_remedy(tmp_path):
    whole = bag(tmp_path / "whole", *moving(TIMES, POSES), *scanning(TIMES))
    (database,) = whole.glob("*.db3")
    cut = {"x.db3": "ros2 bag reindex", "x.mcap": "mcap recover", "x.bag": "rosbag reindex"}
    for name, remedy in cut.items():
        (tmp_path / name).write_bytes(database.read_bytes()[:900])
        with refused(str(tmp_path / name), f"mend it by {remedy}"):
            logs.read(tmp_path / name)
    shutil.copytree(whole, tmp_path / "bare")
    (tmp_path / "bare" / "metadata.yaml").unlink()
    with refused("bare has no metadata.yaml: give the .mcap or .db3 files in it."):
        logs.read(tmp_path / "bare")


def test_a_topic_without_a_message_is_no_choice(heard):
    empty = [("/scan_rear", SCAN, None), ("/odom_visual", ODOMETRY, None)]
    log, _ = heard(*empty, *moving(TIMES, POSES), *scanning(TIMES))
    assert len(log) == 41


def test_a_turned_message_is_seen_from_above(heard):
    """Odometry with roll and pitch of a slope."""
    messages = moving(TIMES, POSES)
    for (_, _, message), (_, _, heading) in zip(messages, POSES, strict=True):
        message.pose.pose.orientation = quaternion(roll=0.05, yaw=heading)
    log, _ = heard(*messages, *scanning(TIMES))
    np.testing.assert_allclose(log.odometry, POSES, atol=3e-3)  # 1 - cos(0.05 rad) of the heading


@pytest.mark.parametrize("frame", ["map", "world"])
def test_poses_of_an_estimate_or_the_truth_are_no_odometry_if_there_is_another(heard, frame):
    messages = moving(TIMES, POSES + 0.5)
    for _, _, message in messages:
        message.header.frame_id = frame
    scans = scanning(TIMES[1:-1])
    said = f"in frame {frame}, as an estimate or the truth"
    _, warned = heard(*messages, *scans)
    assert f"{said}: taken as odometry, as there is no other" in warned
    log, warned = heard(*messages, *by_tf(TIMES, POSES), *scans)
    assert "the odometry is taken from transforms" in warned
    np.testing.assert_allclose(log.odometry, POSES[1:-1], atol=1e-9)


def test_a_static_transform_that_is_sent_again_replaces_the_first(heard):
    fixed = placed(0.0, 0.0, 0.0), placed(0.2, 0.0, 0.5)
    log, warned = heard(*fixed, *moving(TIMES, POSES), *scanning(TIMES[1:-1]))
    assert place(log) == pytest.approx((0.2, 0.0, 0.5))
    assert warned == ""
