"""A bag with a lidar in front and one behind: one log, whose scans are pairs of theirs."""

import math

import numpy as np
import pytest
from bags import SCAN, TF, bag, moving, scan, transform, written
from drives import read_and_warned
from refusals import refused

from deqmcl_gym import GridMap, logs
from deqmcl_gym.maps import Lidar, Mount

FRONT, REAR = "/front/scan", "/rear/scan"
BOTH = (FRONT, REAR)
BEAMS, HALF = 41, 1.5  # beams of each, from -HALF to HALF rad
STEP = 2 * HALF / (BEAMS - 1)
AHEAD = Mount(x=0.3, y=0.1, heading=0.2)
BEHIND = Mount(x=-0.4, y=-0.1, heading=3.0, upside_down=True)
CELLS = np.zeros((60, 90), np.int8)  # 9 m x 6 m
CELLS[[0, -1]] = CELLS[:, [0, -1]] = 100
CELLS[25:32, 60:70] = CELLS[1:9, 20:28] = 100
HALL = GridMap(occupancy=CELLS, resolution=0.1)


def pose_at(times):
    """The truth, linear in time, so that odometry between two messages is exact: (n, 3)."""
    times = np.atleast_1d(times)
    return np.column_stack([2.0 + 0.5 * times, 3.0 + 0.2 * times, 0.3 + 2.0 * times])


def truth(times, mount):
    """Exact scans of one lidar at these times, (n, BEAMS)."""
    one = Lidar(beams=BEAMS, field_of_view=2 * HALF, max_range=20.0, sigma=0.0, mounts=(mount,))
    return one.ranges(HALL, pose_at(times).T)


def frame_of(name, mount):
    roll = math.pi if mount.upside_down else 0.0
    placed = transform("base_footprint", name, mount.x, mount.y, roll=roll, yaw=mount.heading)
    return "/tf_static", TF, placed


def sent(topic, mount, times, ranges=None, **more):
    seen = truth(times, mount) if ranges is None else ranges
    fan = {"first": -HALF, "step": STEP, "farthest": 20.0} | more
    timed = zip(map(float, times), seen, strict=True)
    return [(topic, SCAN, scan(time, topic[1:], row, **fan)) for time, row in timed]


def two(path, front, rear, poses=pose_at):
    """A bag of scans (topic, type, message) of both lidars, and of odometry at 10 Hz for 4 s."""
    stamps = np.arange(41) / 10
    fixed = [frame_of(name[1:], mount) for name, mount in zip(BOTH, (AHEAD, BEHIND), strict=True)]
    return bag(path, *fixed, *moving(stamps, poses(stamps)), *front, *rear)


def test_two_topics_of_one_clock_are_one_lidar_with_the_scans_as_they_were_sent(tmp_path):
    times = np.arange(1, 30) / 8
    path = two(tmp_path / "x", sent(FRONT, AHEAD, times), sent(REAR, BEHIND, times))
    log, warned = read_and_warned(path, scan_topic=BOTH)
    assert (warned, log.skipped) == ("", {})
    assert log.times.tolist() == times.tolist()
    both = np.concatenate([truth(times, AHEAD), truth(times, BEHIND)], axis=1)
    np.testing.assert_array_equal(log.ranges, both)
    assert log.scanner.places == (pytest.approx((0.3, 0.1)), pytest.approx((-0.4, -0.1)))
    off = log.odometry - pose_at(times)
    np.testing.assert_allclose(off[:, :2], 0, atol=1e-12)
    np.testing.assert_allclose(np.cos(off[:, 2]), 1, atol=1e-12)
    # the lidar that was read casts the rays that were sent, from both places, one upside down;
    # a bearing of a LaserScan is float32
    cast = log.scanner.ranges(HALL, log.odometry.T)
    assert np.quantile(np.abs(cast - both), 0.99) < 1e-4
    turned, _ = read_and_warned(path, scan_topic=BOTH[::-1])
    np.testing.assert_array_equal(turned.ranges, np.roll(both, BEAMS, axis=1))


def test_a_scan_of_another_time_is_moved_to_where_the_robot_was_at_the_records(tmp_path):
    times = np.arange(1, 19) / 5
    late = times + 0.09  # s: 0.05 m and 0.18 rad of the robot
    path = two(tmp_path / "x", sent(FRONT, AHEAD, times), sent(REAR, BEHIND, late))
    log, _ = read_and_warned(path, scan_topic=BOTH)
    assert log.times.tolist() == times.tolist()
    np.testing.assert_array_equal(log.ranges[:, :BEAMS], truth(times, AHEAD))
    found, sent_then = log.ranges[:, BEAMS:].astype(float), truth(late, BEHIND)
    rows, beams = np.nonzero(np.isfinite(found))
    # every reading is one of those sent, whose point is seen from the record within half a beam
    for row, beam in zip(rows.tolist(), beams.tolist(), strict=True):
        x, y, angle = log.scanner.rays(log.odometry[row])[BEAMS + beam]
        points = []
        rays = log.scanner.rays(pose_at(late[row])[0])[BEAMS:]
        for far, (px, py, at) in zip(sent_then[row], rays, strict=True):
            points.append((px + far * math.cos(at) - x, py + far * math.sin(at) - y))
        off = [abs(math.remainder(math.atan2(v, u) - angle, 2 * math.pi)) for u, v in points]
        apart = [abs(math.hypot(u, v) - found[row, beam]) for u, v in points]
        assert min(o for o, d in zip(off, apart, strict=True) if d < 1e-4) <= STEP / 2 + 1e-5
    here = truth(times, BEHIND)
    moved = np.abs(found - here)[np.isfinite(found)]
    assert np.median(moved) < np.median(np.abs(sent_then - here)) / 2
    assert np.isfinite(found).mean() > 0.8


def test_records_are_those_of_the_slower_topic_and_no_scan_is_in_two(tmp_path):
    fast, slow = np.arange(1, 79) / 20, np.arange(1, 13) * 0.3 + 0.01
    order = np.arange(fast.size * BEAMS).reshape(-1, BEAMS) % 500 / 50 + 1.0

    def still(at):
        return np.zeros((at.size, 3))

    front = sent(FRONT, AHEAD, fast, order)
    path = two(tmp_path / "x", front, sent(REAR, BEHIND, slow), still)
    log, warned = read_and_warned(path, scan_topic=BOTH)
    assert log.times == pytest.approx(slow)
    nearest = np.abs(fast[:, None] - slow).argmin(axis=0)
    np.testing.assert_array_equal(log.ranges[:, :BEAMS], np.float32(order[nearest]))
    assert "66 of 78 scans of /front/scan are in no record: records are those of /rear/" in warned
    # two scans of the slower topic within reach of one of the faster: the nearer has it
    few = np.array([1.0, 1.04, 2.0])
    only = np.array([1.03, 2.0, 2.5, 3.0])
    path = two(tmp_path / "y", sent(FRONT, AHEAD, only), sent(REAR, BEHIND, few), still)
    log, warned = read_and_warned(path, scan_topic=BOTH)
    assert log.times == pytest.approx([1.04, 2.0])
    assert log.skipped == {"without a scan of /front/scan within 0.1 s": 1}


def test_a_record_without_its_partner_is_left_out_counted_and_told(tmp_path):
    times = np.arange(1, 31) / 8
    front, rear = np.delete(times, 4), np.delete(times, [9, 10])
    path = two(tmp_path / "x", sent(FRONT, AHEAD, front), sent(REAR, BEHIND, rear))
    log, warned = read_and_warned(path, scan_topic=BOTH, max_apart=0.06)
    assert log.times.tolist() == np.delete(times, [4, 9, 10]).tolist()
    said = "without a scan of /front/scan within 0.06 s"
    assert log.skipped == {said: 1}
    assert f"skipped 1 of 28 records: 1 {said}" in warned
    assert "2 of 29 scans of /front/scan are in no record" in warned
    np.testing.assert_array_equal(log.ranges[:, BEAMS:], truth(log.times, BEHIND))


def test_each_lidar_has_the_range_floor_and_the_blind_sectors_of_its_own_driver(tmp_path):
    times = np.arange(1, 9) / 4
    near = np.full((times.size, BEAMS), 0.3)
    rear = near.copy()
    rear[:, 3:6], rear[:, 6:8], rear[:, 8] = np.nan, 0.0, np.inf  # the robot's own body
    ahead = sent(FRONT, AHEAD, times, near, nearest=0.5)
    behind = sent(REAR, BEHIND, times, rear, nearest=0.2, farthest=7.0)
    path = two(tmp_path / "x", ahead, behind)
    log, _ = read_and_warned(path, scan_topic=BOTH)
    assert not np.isfinite(log.ranges[:, :BEAMS]).any()
    blind = ~np.isfinite(log.ranges[:, BEAMS:]).any(axis=0)
    assert np.flatnonzero(blind).tolist() == [3, 4, 5, 6, 7, 8]
    assert np.isfinite(log.ranges[:, BEAMS:][:, ~blind]).all()
    assert (log.scanner.min_range, log.scanner.max_range) == (pytest.approx(0.2), 20.0)


@pytest.mark.parametrize("ending", [".csv", ".npz"])
def test_a_log_of_two_lidars_is_written_and_read_again(tmp_path, ending):
    times = np.arange(1, 9) / 4
    scans = sent(FRONT, AHEAD, times), sent(REAR, BEHIND, times)
    log, _ = read_and_warned(two(tmp_path / "x", *scans), scan_topic=BOTH)
    path = tmp_path / f"again{ending}"
    logs.write(log, path)
    same, warned = read_and_warned(path)
    assert warned == ""
    np.testing.assert_array_equal(same.ranges, log.ranges)
    np.testing.assert_allclose(same.scanner.bearings, log.scanner.bearings, atol=1e-5)
    np.testing.assert_allclose(same.scanner.places, log.scanner.places, atol=1e-12)


REFUSED = {
    "an unknown topic": (
        {"scan_topic": (FRONT, "/side/scan")}, "scan_topic is '/side/scan', but must be a topic"),
    "a number": ({"scan_topic": (FRONT, 2)}, "several different ones"),
    "nothing chosen": ({}, "2 topics of type"),
    "one topic and a tolerance": (
        {"scan_topic": FRONT, "max_apart": 0.1}, "pairs the scans of 2 scan topics or more"),
    "a negative tolerance": ({"scan_topic": BOTH, "max_apart": -1.0}, "max_apart"),
    "a mounting for two": (
        {"scan_topic": BOTH, "mounting": (0.0, 0.0, 0.0), "max_apart": 1.0}, "has mounts of its"),
    "clocks that differ": ({"scan_topic": BOTH}, "give a larger max_apart, or one topic"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_topics_that_make_no_log_are_refused_in_a_sentence(tmp_path, case):
    given, said = REFUSED[case]
    times = np.arange(1, 9) / 4
    path = two(tmp_path / "x", sent(FRONT, AHEAD, times), sent(REAR, BEHIND, times + 0.12))
    with refused(said):
        read_and_warned(path, **given)


def test_a_carmen_log_has_one_scanner(tmp_path):
    times = np.arange(1, 9) / 4
    path = two(tmp_path / "x", sent(FRONT, AHEAD, times), sent(REAR, BEHIND, times))
    written(read_and_warned(path, scan_topic=FRONT)[0], tmp_path / "x.log")
    with refused("kind of scan in a CARMEN log"):
        logs.read(tmp_path / "x.log", scan_topic=("FLASER", "ROBOTLASER1"))
