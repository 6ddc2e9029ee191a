"""What the lidars of real robots send: limits, codes of no return, angles that vary."""

import math

import numpy as np
import pytest
from bags import SCAN, bag, driven, moving, scan, scanning
from drives import NAN, read_and_warned

from deqmcl_gym import logs
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.logs.scans import no_return_codes

TIMES, POSES = driven()

READINGS = {  # what stands for no return, and what a log has for it
    0.0: NAN, -1.0: NAN, NAN: NAN, -math.inf: NAN, 0.1: NAN,
    3.0: math.inf, 3.5: math.inf, 65.535: math.inf, math.inf: math.inf,
}  # fmt: skip
WIDE, DEEP = 6.0, 4.0  # m, of a room with a corner in (0, 0)


def one_reading(path, reading):
    ranges = (1.0, reading, 2.0)
    if path.suffix == ".csv":
        path.write_text(
            '# {"angles": [-1, 0, 1], "max_range": 3.0, "min_range": 0.1}\n'
            "time,odom_x,odom_y,odom_heading,range_0,range_1,range_2\n"
            f"0,0,0,0,{','.join(map(str, ranges))}\n"
        )
    else:
        times, poses = driven(3)
        limits = {"nearest": 0.1, "farthest": 3.0}
        bag(path, *moving(times, poses), *scanning([0.1], ranges=ranges, **limits))
    log, _ = read_and_warned(path)
    return log


@pytest.mark.parametrize("name", ["x", "x.csv"])
@pytest.mark.parametrize(("reading", "kept"), READINGS.items())
def test_a_reading_at_or_beyond_a_limit_is_no_measurement(tmp_path, name, reading, kept):
    log = one_reading(tmp_path / name, reading)
    np.testing.assert_array_equal(log.ranges, np.float32([[1.0, kept, 2.0]]))
    marked = np.array([1.0, reading, 2.0])
    log.scanner.lose(marked)  # as a localizer does with what a robot sends
    np.testing.assert_array_equal(marked, [1.0, kept, 2.0])
    shown = {math.inf: 6.0}.get(kept, 9.0)
    two = logs.Log(log.scanner, [0.0, 1.0], np.zeros((2, 3)), log.ranges.repeat(2, axis=0))
    assert LogEnv(log=two).reset()[0][1] == pytest.approx(shown)


def test_the_largest_reading_is_no_return_if_many_beams_read_it_to_the_last_digit():
    rng = np.random.default_rng(0)
    ranges = np.round(rng.uniform(0.5, 20.0, (50, 40)), 2).astype(np.float32)
    assert no_return_codes(ranges) == ([], [])
    hit = ranges.copy()
    hit[rng.random(hit.shape) < 0.03] = 50.0
    hit[3, :2] = 70.0  # two readings beyond it
    assert no_return_codes(hit) == ([np.float32(50.0)], [])
    near = np.where(hit == 50.0, np.float32(1e-3), hit)
    assert no_return_codes(near) == ([], [np.float32(1e-3)])
    few = ranges.copy()
    few[0, :10] = 50.0  # half a per cent
    assert no_return_codes(few) == ([], [])
    beside = ranges.copy()
    beside[:, 3] = 0.2  # one beam along a wall, exact to the last digit
    assert no_return_codes(beside) == ([], [])
    # a robot that stands still reads each number as often
    assert no_return_codes(np.float32([[1.0, 2.0, 3.0]] * 50)) == ([], [])


def test_a_code_of_no_return_is_told_and_is_the_scanners_limit(tmp_path):
    rng = np.random.default_rng(1)
    lines = []
    for t in range(40):
        ranges = np.where(rng.random(180) < 0.05, 50.0, np.round(rng.uniform(1, 9, 180), 2))
        words = " ".join(map(str, ranges.tolist()))
        lines.append(f"FLASER 180 {words} 0 0 0 {0.1 * t} 0 0 {t} host {t}")
    (tmp_path / "x.log").write_text("\n".join(lines))
    log, warned = read_and_warned(tmp_path / "x.log")
    assert "of the ranges read exactly 50.0, the largest of many: taken as no return" in warned
    assert log.scanner.max_range == 50.0
    assert np.nanmax(log.ranges[np.isfinite(log.ranges)]) < 9.01


def test_a_log_most_of_whose_beams_are_dropped_says_why(heard):
    near = scanning(TIMES[1:-1], ranges=(1.0, 2.0, 6.0), nearest=5.0)
    _, warned = heard(*moving(TIMES, POSES), *near)
    assert "67% of the ranges are no measurements: 0% are at or beyond max_range" in warned
    assert "67% at or below min_range, 5 m" in warned


def seen(pose, angles):
    """Exact ranges of a lidar at (x, y, θ) in the room, (n,)."""
    x, y, heading = pose
    dx, dy = np.cos(heading + angles), np.sin(heading + angles)
    with np.errstate(divide="ignore"):
        by_x, by_y = np.where(dx > 0, WIDE - x, -x) / dx, np.where(dy > 0, DEEP - y, -y) / dy
        return np.minimum(by_x, by_y)


@pytest.mark.parametrize(
    ("varies", "whole", "most"),
    [  # least share of beams with a range, and the error of nine tenths of these, m
        ("beams", 0.97, 1e-4), ("start", 0.97, 1e-4), ("turn", 0.97, 1e-4), ("step", 0.97, 1e-4),
        ("limits", 0.97, 1e-4), ("quarter", 0.25, 1e-4), ("sense", 0.99, 1e-4),
    ],
)  # fmt: skip
def test_scans_that_vary_are_all_used_at_the_angles_that_they_have(heard, varies, whole, most):
    rng, usual = np.random.default_rng(2), 2 * math.pi / 119
    times, poses = driven(81, 0.015)
    scans = []
    for at, (t, pose) in enumerate(zip(times[1:-1], poses[1:-1], strict=True)):
        n = 120 + int(rng.integers(-4, 5) if varies in ("beams", "step") else 0)
        first = -math.pi + (rng.uniform(-0.02, 0.02) if varies == "start" else 0.0)
        first = rng.uniform(-math.pi, math.pi) if varies == "turn" else first
        step = 2 * math.pi / (n - 1) if varies == "step" else usual
        if varies == "quarter":  # of a turn, one after the other
            n, first, step = 30, (at % 4 - 2) * math.pi / 2, math.pi / 60
        if varies == "sense":  # turned either way
            step = math.pi / 60 * (1 if at % 2 else -1)
            first = math.copysign(math.pi, -step)
        ranges, far = seen(pose, first + step * np.arange(n)), 10.0
        far += rng.uniform(-1, 1) if varies == "limits" else 0
        said = {"ranges": ranges, "first": first, "step": step, "farthest": far}
        scans.append(("/scan", SCAN, scan(t, **said)))
    log, warned = heard(*moving(times, poses), *scans)
    assert (len(log), log.skipped) == (79, {})
    assert ("scans have other angles than those of the log" in warned) == (varies != "limits")
    exact = np.array([seen(pose, log.scanner.bearings) for pose in log.odometry])
    off = np.abs(log.ranges - exact)
    # exact on straight walls; within a beam of a corner a wall ends between two beams, 4 corners of
    # 120 beams, and with fewer beams than bearings a few have none within half an angle
    assert np.isfinite(off).mean() >= whole
    assert np.nanquantile(off, 0.9) < most
    assert np.nanmax(off) < 0.5
    if varies == "quarter":
        assert (log.scanner.beams, np.isfinite(off).sum(axis=1).max()) == (120, 30)


def test_a_scan_of_no_beam_or_of_fewer_costs_no_record(heard):
    sizes = [0, 0, 3, *[5] * 36]
    timed, fan = zip(TIMES[1:-1], sizes, strict=True), {"first": -1.0, "step": 0.5}
    scans = [("/scan", SCAN, scan(t, ranges=np.full(n, 2.0), **fan)) for t, n in timed]
    log, _ = heard(*moving(TIMES, POSES), *scans)
    assert (len(log), log.scanner.beams) == (39, 5)
    assert np.isfinite(log.ranges).sum(axis=1).tolist() == sizes


@pytest.mark.parametrize("increment", [0.0, -0.5])
def test_an_increment_that_does_not_lead_to_the_last_angle_is_taken_from_it(heard, increment):
    scans = scanning(TIMES[1:-1], first=-0.5, step=increment)  # its last angle is 0.5
    log, warned = heard(*moving(TIMES, POSES), *scans)
    assert log.scanner.bearings == pytest.approx([-0.5, 0.0, 0.5])
    assert "39 scans have an angle_increment that does not lead to their angle_max" in warned


def raw(times, poses):
    lines = ["PARAM robot_frontlaser_offset 0.2 0 nohost 0"]
    for t, (x, y, heading) in zip(times, poses, strict=True):
        lines.append(f"ODOM {x} {y} {heading} 0 0 0 {t} host {t}")
    head = "RAWLASER1 0 -0.5 1.0 0.5 80.0 0.01 0 4 1.5 2.5 0.0 80.0 0"
    return lines + [f"{head} {t} host {t}" for t in times[1:-1] + 0.03]


def test_raw_scans_of_carmen_have_the_odometry_of_their_time(tmp_path):
    (tmp_path / "x.log").write_text("\n".join(raw(TIMES, POSES)))
    log, warned = read_and_warned(tmp_path / "x.log")
    assert (len(log), warned) == (39, "")
    columns = [np.interp(log.times, TIMES, column) for column in POSES.T]
    np.testing.assert_allclose(log.odometry, np.column_stack(columns), atol=1e-9)
    np.testing.assert_array_equal(log.ranges[0], np.float32([1.5, 2.5, NAN, math.inf]))
    assert log.scanner.bearings == pytest.approx([-0.5, 0.0, 0.5, 1.0])
    assert log.scanner.mounting == (0.2, 0.0)


@pytest.mark.parametrize("beams", [271, 1081, 682])
def test_flaser_of_another_lidar_has_the_angles_of_param_or_of_an_argument(tmp_path, beams):
    path, view = tmp_path / "x.log", 270 if beams % 2 else 240
    line = f"FLASER {beams} {'1 ' * beams}0 0 0 0 0 0 1 host 1"
    step = view / (beams - beams % 2)
    path.write_text(line)
    _, warned = read_and_warned(path)
    assert f"{beams} beams are taken as those of a SICK LMS, from -90° to 90°" in warned
    found = [read_and_warned(path, field_of_view=math.radians(view))]
    params = [f"PARAM laser_front_laser_fov {view} 0 nohost 0"]
    path.write_text("\n".join([*params, line]))
    found.append(read_and_warned(path))
    params.append(f"PARAM laser_front_laser_resolution {step!r} 0 nohost 0")
    path.write_text("\n".join([line, *params]))  # in any order
    found.append(read_and_warned(path))
    for log, warned in found:
        assert warned == ""
        degrees = np.degrees(log.scanner.bearings)
        assert degrees == pytest.approx(-view / 2 + step * np.arange(beams))
