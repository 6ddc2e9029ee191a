"""What is written is read back: every format, rooms in px and logs as real robots make them."""

import gzip
import itertools
import math

import numpy as np
import pytest
from bags import written
from drives import ENDINGS, episode, real, same
from hypothesis import given, settings
from hypothesis import strategies as st

from deqmcl_gym import logs
from deqmcl_gym.logs.carmen import read_carmen

ROS = (".bag", ".mcap", "")
IN_ROWS = (".csv", ".csv.gz", ".npz")  # formats with the reference in the records themselves
finite = st.floats(-0.1, 0.1)  # no jump
readings = st.one_of(st.floats(0.5, 78.5, width=32), st.sampled_from([0.0, 79.0, 81.83, math.inf]))


def bent():
    log = real()
    scanner = logs.Scanner(angles=(*log.scanner.angles[:-1], 1.5), max_range=8.0)
    return logs.Log(scanner, log.times, log.odometry, log.ranges)


@pytest.mark.parametrize(
    ("made", "ending"),
    [*itertools.product([episode, real], ENDINGS), *((bent, ending) for ending in IN_ROWS)],
)
def test_a_log_comes_back_with_all_digits(tmp_path, ending, made):
    log = made()
    written(log, tmp_path / f"x{ending}")
    own_stamps = {} if ending in IN_ROWS else {"max_gap": 0.0}
    back = logs.read(tmp_path / f"x{ending}", **own_stamps)
    if ending in ROS:  # headings pass through quaternions, angles are float32
        same(back, log, within=1e-12, angles=1e-6)
        found, meant = ((one.min_range, one.max_range) for one in (back.scanner, log.scanner))
        assert found == pytest.approx(meant, rel=1e-7)
    else:
        same(back, log)
        assert back.scanner == log.scanner
    if made is episode:  # its actions to the bit, whatever the headings passed through
        found, meant = back.increments, log.increments[:, [0, 2]].astype(np.float32)
        np.testing.assert_array_equal(found[:, [0, 2]].astype(np.float32), meant)
        np.testing.assert_allclose(found[:, 1], 0, atol=1e-9)
    assert not back.skipped
    assert [path.name for path in tmp_path.iterdir()] == [f"x{ending}"]  # nothing beside it


@settings(max_examples=200)
@given(
    rows=st.lists(
        st.tuples(
            st.floats(0, 1e9, allow_nan=False),
            st.tuples(finite, finite, finite),
            st.lists(readings, min_size=3, max_size=3),
        ),
        min_size=1, max_size=6,
    ),
    kind=st.sampled_from(["FLASER", "ROBOTLASER1"]),
    between=st.sampled_from([" ", "  ", "\t"]),
    ending=st.sampled_from(["\n", "\r\n", "\n\n"]),
)  # fmt: skip
def test_carmen_lines_are_read_as_they_stand(tmp_path_factory, rows, kind, between, ending):
    rows = sorted(rows, key=lambda row: row[0])
    path = tmp_path_factory.getbasetemp() / "generated.log"
    lines = ["# comment", "PARAM robot_frontlaser_offset 0.25 0 nohost 0", "SYNC x 0 nohost 0"]
    for time, pose, ranges in rows:
        at, scan = " ".join(map(repr, pose)), " ".join(map(repr, ranges))
        head = "0 -1.5 3 1 80.0 0.01 0 " if kind == "ROBOTLASER1" else ""
        after = "0 " if kind == "ROBOTLASER1" else ""
        more = "0 0 0 0 0 " if kind == "ROBOTLASER1" else ""
        lines.append(f"ODOM {at} 0 0 0 {time!r} host {time!r}")
        lines.append(f"{kind} {head}3 {scan} {after}{at} {at} {more}{time!r} host {time!r}")
    path.write_bytes(ending.join(line.replace(" ", between) for line in lines).encode())
    log = logs.read(path)
    assert log.times.tolist() == [row[0] for row in rows]
    assert log.odometry.tolist() == [list(row[1]) for row in rows]
    given_ranges = np.float32([row[2] for row in rows])
    none = np.where(given_ranges > 0, np.inf, np.nan)
    seen = (given_ranges > 0) & (given_ranges < 79)
    np.testing.assert_array_equal(log.ranges, np.where(seen, given_ranges, none))
    flaser = kind == "FLASER"
    assert log.scanner.mounting == ((0.25, 0.0) if flaser else (0.0, 0.0))
    expected = [-math.pi / 2, 0, math.pi / 2] if flaser else [-1.5, -0.5, 0.5]
    assert log.scanner.bearings == pytest.approx(expected)
    written(log, path)
    same(read_carmen(path), log)


@pytest.mark.parametrize(
    ("beams", "last"), [(1, -90.0), (180, 89.0), (360, 89.5), (181, 90.0), (361, 90.0)]
)
def test_flaser_has_the_angles_of_a_sick(tmp_path, beams, last):
    line = f"FLASER {beams} {'1 ' * beams}0 0 0 0 0 0 1 host 1\n"
    path = tmp_path / "x.log"
    path.write_bytes(gzip.compress(line.encode()))  # the ending need not say that it is packed
    degrees = np.degrees(logs.read(path).scanner.bearings)
    assert (degrees[0], degrees[-1]) == pytest.approx((-90.0, last))
    assert np.diff(degrees) == pytest.approx(np.full(beams - 1, 180 / max(beams - beams % 2, 1)))


@pytest.mark.parametrize("ours", [True, False])
@pytest.mark.parametrize("turn", [0.0, math.pi])
def test_a_mounting_between_two_millimetres_costs_no_record(tmp_path, ours, turn):
    rng = np.random.default_rng(0)
    angles = tuple(turn + np.linspace(-1, 1, 5))
    scanner = logs.Scanner(angles=angles, max_range=8.0, mounting=(0.0625, 0.0))
    poses = rng.uniform(-1, 1, (200, 3))
    log = logs.Log(scanner, np.arange(200.0), poses, rng.uniform(1, 7, (200, 5)))
    written(log, tmp_path / "x.log")
    if not ours:
        lines = (tmp_path / "x.log").read_text().splitlines()
        text = "\n".join(line for line in lines if not line.startswith("PARAM"))
        (tmp_path / "x.log").write_text(text)
    back = read_carmen(tmp_path / "x.log")
    assert len(back) == 200
    assert back.scanner.mounting == pytest.approx((0.0625, 0.0), abs=6e-4)


def test_ranges_beyond_the_bounds_given_are_no_measurements(tmp_path):
    scanner = logs.Scanner(angles=(0.0, 0.1, 0.2), max_range=8.0, min_range=0.1)
    log = logs.Log(scanner, np.arange(2.0), np.eye(2, 3), np.array([[0.2, 1.0, 7.0]] * 2))
    logs.write(log, tmp_path / "x.csv")
    for bounds, kept in (
        ({"min_range": 0.5}, [False, True, True]),
        ({"max_range": 5.0}, [True, True, False]),
        ({"min_range": 0.05, "max_range": 9.0}, [True, True, True]),  # the scanner's own hold
    ):
        back = logs.read(tmp_path / "x.csv", **bounds)
        assert np.isfinite(back.scanner.measured(back.ranges)[0]).tolist() == kept
