"""Bags of other people's robots, written by rosbags alone: topics, transforms, odometry."""

import math
import sys

import numpy as np
import pytest
from bags import ODOMETRY, SCAN, TF, bag, make, odometry, scan, transform, written
from drives import read_and_warned
from refusals import refused
from rosbags.rosbag2 import StoragePlugin

from deqmcl_gym import logs
from deqmcl_gym.validation import InputError

LASERLESS = "no topic of type sensor_msgs/msg/LaserScan; its topics"


def drive(*more, times=(0.5, 1.0, 1.5), **of_scans):
    moved = [("/odom", ODOMETRY, odometry(float(t), float(t), 0.1 * t)) for t in range(3)]
    return [*more, *moved, *(("/scan", SCAN, scan(time, **of_scans)) for time in times)]


def mounted(**transformed):
    return ("/tf_static", TF, transform("base_footprint", "laser", 0.0, 0.0, **transformed))


def test_odometry_lies_straight_between_the_messages_around_a_scan(tmp_path):
    log, warned = read_and_warned(bag(tmp_path / "x", *drive()))
    assert log.times.tolist() == [0.5, 1.0, 1.5]
    np.testing.assert_allclose(log.odometry, [[t, 0, 0.1 * t] for t in log.times], atol=1e-12)
    assert "no static transform from base_footprint to laser" in warned


@pytest.mark.parametrize(("roll", "sign"), [(0.0, 1), (math.pi, -1)])
def test_static_transforms_say_the_mounting_through_a_chain_and_upside_down(tmp_path, roll, sign):
    chain = [
        ("/tf_static", TF, transform("base_footprint", "base_link", 0.1, 0.0)),
        ("/tf_static", TF, transform("base_link", "mast", 0.2, 0.0, yaw=math.pi / 2)),
        ("/tf_static", TF, transform("mast", "laser", 0.5, 0.0, roll=roll)),
    ]
    log, warned = read_and_warned(bag(tmp_path / "x", *drive(*chain)))
    assert warned == ""
    assert log.scanner.mounting == pytest.approx((0.3, 0.5))
    assert log.scanner.bearings == pytest.approx(math.pi / 2 + sign * np.array([-1.0, 0.0, 1.0]))
    for x, y, heading in log.odometry:
        ahead, off = heading + math.atan2(0.5, 0.3), math.hypot(0.3, 0.5)
        at = (x + off * math.cos(ahead), y + off * math.sin(ahead), heading)
        assert log.scanner.rays((x, y, heading))[0, :2] == pytest.approx(at[:2])


def test_frames_that_share_a_topic_are_not_mixed(tmp_path):
    back = [("/scan", SCAN, scan(t, "back", (4.0,) * 3)) for t in (0.6, 1.1)]
    log, warned = read_and_warned(bag(tmp_path / "x", *drive(*back)))
    assert (log.times.tolist(), log.ranges.max()) == ([0.5, 1.0, 1.5], 3.0)
    assert "2 with a scan of another frame" in warned
    camera = [("/odom", ODOMETRY, odometry(t, 9.0, frame="camera")) for t in (0.4, 1.0, 1.6)]
    path = bag(tmp_path / "y", *drive(*camera))
    with refused("choose by base_frame, as --set world.reading.base_frame=base_footprint."):
        logs.read(path)
    assert read_and_warned(path, base_frame="base_footprint")[0].odometry[:, 0].max() == 1.5
    assert read_and_warned(path, base_frame="camera")[0].odometry[:, 0].min() == 9.0
    with refused("base_frame 'foot'", "camera"):
        logs.read(path, base_frame="foot")


@pytest.mark.parametrize("farthest", [0.0, math.inf, math.nan, 3e38])
def test_a_bag_without_the_range_of_its_scanner_is_read_with_the_range_given(tmp_path, farthest):
    path = bag(tmp_path / "x", *drive(farthest=farthest))
    with refused(f"{path}: range_max of its scans is", "as --set world.reading.max_range=20"):
        logs.read(path)
    log, _ = read_and_warned(path, max_range=2.5)
    assert (log.scanner.max_range, log.ranges.tolist()[0]) == (2.5, [1.0, 2.0, math.inf])


def test_a_mounting_may_be_repeated_in_any_sign_and_a_broken_one_is_left_out(tmp_path):
    half = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, -math.sin(0.25), -math.cos(0.25))
    empty = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 0.0)
    lost = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.nan, 1.0)
    three = [mounted(turned=half), mounted(turned=empty), mounted(turned=lost), mounted(yaw=0.5)]
    log, warned = read_and_warned(bag(tmp_path / "x", *drive(*three)))
    assert (warned, log.scanner.turn) == ("", pytest.approx(0.5))
    log, warned = read_and_warned(bag(tmp_path / "y", *drive(mounted(turned=empty))))
    assert "laser (no finite one from base_footprint to laser)" in warned


def test_a_mounting_that_is_given_replaces_the_logs_through_all_formats(tmp_path):
    log, _ = read_and_warned(bag(tmp_path / "x", *drive(mounted(yaw=0.5))))
    for name in ("x", "x.log", "x.csv", "x.npz", "x.mcap"):
        if name != "x":
            written(log, tmp_path / name)
        same, _ = read_and_warned(tmp_path / name, mounting=(0.2, -0.1, 0.5))
        assert same.scanner.bearings == pytest.approx(log.scanner.bearings, abs=1e-6)
        ahead, _ = read_and_warned(tmp_path / name, mounting=(0.2, -0.1, 0.0))
        assert ahead.scanner.bearings == pytest.approx([-1.0, 0.0, 1.0], abs=1e-6)
        assert ahead.scanner.mounting == (0.2, -0.1)


def test_topics_are_chosen_by_type_if_there_is_one_and_by_name_if_there_are_several(tmp_path):
    other = ("/back/scan", SCAN, scan(1.2, ranges=(4.0, 4.0, 4.0)))
    path = bag(tmp_path / "x", *drive(other), plugin=StoragePlugin.MCAP)
    with pytest.raises(InputError, match=r"/scan: choose .*reading.scan_topic=/back/scan"):
        logs.read(path)
    log, _ = read_and_warned(path, scan_topic="/back/scan")
    assert log.ranges.tolist() == [[4.0, 4.0, 4.0]]
    with pytest.raises(InputError, match="scan_topic is '/odom', but must be a topic of type"):
        logs.read(path, scan_topic="/odom")
    with pytest.raises(InputError, match="reference_topic"):
        logs.read(path, scan_topic="/scan", reference_topic="/amcl_pose")
    log, warned = read_and_warned(path, scan_topic="/scan", reference_topic="/odom")
    assert f"the poses of /odom in {path} are in frame odom" in warned
    np.testing.assert_allclose(log.reference, log.odometry, atol=1e-12)


@pytest.mark.parametrize(
    ("messages", "words"),
    [
        ((), LASERLESS),
        ([("/odom", ODOMETRY, odometry(0.0, 0.0))], LASERLESS),
        (drive(("/scan", SCAN, None), times=()), "no usable record"),
        (drive(times=(0.0, 0.0)), "have no stamps (all are 0)"),
        (drive(mounted(roll=0.5)), "tilted by 29°"),
    ],
)
def test_a_bag_without_scans_that_can_be_used_is_refused(tmp_path, messages, words):
    with refused(f"{tmp_path / 'x'}", words):
        read_and_warned(bag(tmp_path / "x", *messages))


@pytest.mark.parametrize(
    ("more", "times", "kept", "said"),
    [
        ((), (0.5, 1.0, 2.5, 99.0), [0.5, 1.0], "skipped 2 of 4 records: 2 without odometry"),
        # within a long gap of the odometry; the last one stands at a message
        (("/odom", ODOMETRY, odometry(9.0, 9.0)), (0.5, 5.0, 9.0), [0.5, 9.0],
         "1 without odometry"),
        (("/scan", SCAN, scan(0.7, first=math.nan)), (0.5, 1.0), [0.5, 1.0],
         "1 with a scan whose angles are not finite"),
    ],
)  # fmt: skip
def test_a_scan_without_a_place_or_angles_is_counted(tmp_path, more, times, kept, said):
    messages = [*drive(times=times), *([more] if more else [])]
    log, warned = read_and_warned(bag(tmp_path / "x", *messages))
    assert log.times.tolist() == kept
    assert said in warned


def test_without_rosbags_one_sentence_names_the_command(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(InputError, match=r'pip install "deqmcl-gym\[ros\]"'):
        logs.read(tmp_path / "x.bag")
