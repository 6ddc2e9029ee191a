"""Damaged logs: a bad record is skipped and counted, a bad file refused in one sentence."""

import gzip
import io
import os
import re
import sqlite3
import zipfile

import numpy as np
import pytest
from bags import written
from drives import ENDINGS, episode, read_and_warned, real
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused

from deqmcl_gym import logs
from deqmcl_gym.logs.raw_records import RawRecords, ascending
from deqmcl_gym.validation import InputError

VIEW = "PARAM laser_front_laser_fov 180 0 nohost 0"  # 3 beams are not a SICK's


def carmen_lines(n=12):
    return [f"FLASER 3 1.5 2.5 3.5 0 0 0 {t}.0 0 0.1 {t} host {t}" for t in range(n)]


@pytest.fixture
def read_lines(tmp_path):
    def read(lines):
        (tmp_path / "x.log").write_text("\n".join([VIEW, *lines]))
        return read_and_warned(tmp_path / "x.log")

    return read


@pytest.fixture
def csv(tmp_path):
    logs.write(episode(), tmp_path / "x.csv")
    return tmp_path / "x.csv", (tmp_path / "x.csv").read_text().splitlines()


DAMAGES = {
    "cut within its ranges": lambda line: line[:12],
    "cut before its time": lambda line: line[: line.index("host") - 3],
    "a word among its ranges": lambda line: line.replace("2.5", "2,5"),
    "an underscore among its digits": lambda line: line.replace("2.5", "2_5"),
    "no UTF-8": lambda line: line.replace("2.5", "\udcff"),
    "a count that lies": lambda line: line.replace(" 3 1.5", " 4 1.5"),
    "a count below 0": lambda line: line.replace(" 3 1.5", " -3 1.5"),
    "a NaN in its pose": lambda line: line.replace("0 0.1", "0 nan"),
    "an infinite time": lambda line: re.sub(r"\d+ host", "inf host", line),
    "a garbled word": lambda line: line.replace("FLASER", "FLAS3R"),
    "two lines in one": lambda line: line + line,
}


@pytest.mark.parametrize("damage", DAMAGES)
@settings(max_examples=15)
@given(hurt=st.sets(st.integers(1, 11), min_size=1, max_size=4))
def test_every_damaged_record_is_left_out_and_counted_and_no_other(tmp_path_factory, damage, hurt):
    lines = carmen_lines()
    for index in hurt:
        lines[index] = DAMAGES[damage](lines[index])
    path = tmp_path_factory.getbasetemp() / "damaged.log"
    path.write_bytes("\n".join(lines).encode("utf-8", "surrogateescape"))
    log, warned = read_and_warned(path)
    assert log.times.tolist() == [t for t in range(12) if t not in hurt]
    assert sum(log.skipped.values()) == len(hurt)
    assert f"skipped {len(hurt)} of 12 records" in warned


@pytest.mark.parametrize("time", ["-5", "1e9"])
@pytest.mark.parametrize("index", [2, 5, 9])
def test_a_time_stamp_that_is_off_costs_one_record(read_lines, time, index):
    lines = carmen_lines()
    lines[index] = re.sub(r"\d+ host", f"{time} host", lines[index])
    log, warned = read_lines(lines)
    assert log.times.tolist() == [t for t in range(12) if t != index]
    assert "skipped 1 of 12 records: 1 whose time runs backwards" in warned


@given(st.lists(st.integers(0, 30), min_size=1, max_size=25))
def test_the_records_kept_are_the_longest_run_that_never_goes_back(times):
    damage = RawRecords("x").damage
    kept = ascending(np.array(times, float), damage)
    run = np.array(times)[kept]
    assert (np.diff(run) >= 0).all()
    assert (np.diff(kept) > 0).all()
    longest = np.ones(len(times), int)  # by definition, in quadratic time
    for i in range(len(times)):
        before = [longest[j] for j in range(i) if times[j] <= times[i]]
        longest[i] = 1 + max(before, default=0)
    assert len(kept) == longest.max()
    assert damage.total() == len(times) - len(kept)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.98])
def test_a_file_that_breaks_off_is_refused_or_its_loss_is_counted(tmp_path, ending, share):
    log = real(n=60)
    path = tmp_path / f"x{ending}"
    written(log, path)
    file = next(path.glob("*.db3")) if ending == "" else path
    content = file.read_bytes()
    file.write_bytes(content[: int(len(content) * share)])
    try:
        back, warned = read_and_warned(path)
    except InputError:
        with refused(path.name):
            logs.read(path)
    else:  # a text cut at a line's end looks whole
        assert ending in (".log", ".csv")
        assert len(back) < len(log)
        assert back.times.tolist() == log.times[: len(back)].tolist()
        assert "skipped 1 of" in warned or content[int(len(content) * share) - 1 :][:1] == b"\n"


@pytest.mark.parametrize("ending", [*ENDINGS[:-1], ".db3"])
@settings(max_examples=20)
@given(noise=st.binary(max_size=200))
def test_noise_is_refused_in_one_sentence(tmp_path_factory, ending, noise):
    path = tmp_path_factory.getbasetemp() / f"noise{ending}"
    path.write_bytes(noise)
    with refused(path.name):
        read_and_warned(path)


def test_utf_16_and_a_byte_order_mark_are_read(tmp_path):
    for encoding in ("utf-16", "utf-8-sig", "latin-1"):
        text = "\n".join(["# Gebäude 79", VIEW, *carmen_lines()])
        (tmp_path / "x.log").write_bytes(text.encode(encoding))
        log, warned = read_and_warned(tmp_path / "x.log")
        assert (len(log), warned) == (12, "")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no scan"),
        ("FLASER 3 1", "1 unreadable lines"),
        ("FLASER 1 1 0 0 0 nan 0 0 1 h 1", "not finite"),
        (
            "FLASER 1 1 0 0 0 0 0 0 1 h 1\n"
            "ROBOTLASER1 0 0 3 1 80 0.01 0 1 1 0 0 0 0 0 0 0 0 0 0 0 0 1 h 1",
            "two kinds",
        ),
    ],
)
def test_a_carmen_log_without_a_choice_of_scans_is_refused(tmp_path, text, said):
    (tmp_path / "x.log").write_text(text)
    with refused("x.log", said):
        read_and_warned(tmp_path / "x.log")


def test_what_cannot_be_a_log_is_refused(tmp_path):
    (tmp_path / "x.dat").write_text("1")
    (tmp_path / "x").write_text("1")
    words = dict.fromkeys(("x.npz.gz", "x.dat", "x"), "unknown format")
    words |= dict.fromkeys(("no.log", "no.csv", "no.npz", "no.mcap", "no.bag", "no"), "exist")
    for name, said in words.items():
        with refused(name, said):
            logs.read(tmp_path / name)
    logs.write(episode(), tmp_path / "x.csv")
    with refused("x.csv", "does not take it"):
        logs.read(tmp_path / "x.csv", scan_topic="/scan")
    for name in ("x.dat", "x.log", "x.bag", "x"):
        with pytest.raises(InputError, match=r"not written: end the name in \.csv, \.csv\.gz or"):
            logs.write(episode(), tmp_path / name)


@pytest.mark.parametrize("ending", [*ENDINGS[:-1], ".db3", ".log.gz"])
def test_a_pipe_is_not_waited_for(tmp_path, ending):
    pipe = tmp_path / f"pipe{ending}"
    os.mkfifo(pipe)
    with refused(pipe.name, "is a named pipe"):
        logs.read(pipe)


def test_a_stray_quote_or_a_number_beyond_all_use_costs_one_record(csv):
    path, lines = csv
    lines[10] = lines[10].replace(",", ',"x', 1)
    time, _, *rest = lines[20].split(",")
    lines[20] = ",".join([time, "1e300", *rest])
    path.write_text("\n".join(lines))
    log, warned = read_and_warned(path)
    assert len(log) == len(episode()) - 2
    assert "1 unreadable" in warned
    assert "beyond 1e+12" in warned


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_name_that_is_too_long_is_refused_read_or_written(tmp_path, ending):
    path = tmp_path / f"{'a' * 300}{ending}"
    with refused(path.name):
        logs.read(path)
    if ending in (".csv", ".csv.gz", ".npz"):
        with pytest.raises(InputError, match="cannot be written"):
            logs.write(real(), path)


@pytest.mark.parametrize("name", ["x.log.gz", "x.csv.gz", "x.npz", "x.tum.gz"])
def test_no_more_is_unpacked_than_is_allowed_and_only_what_is_needed(tmp_path, monkeypatch, name):
    path, read = tmp_path / name, logs.read_tum if "tum" in name else logs.read
    monkeypatch.setattr("deqmcl_gym.files.MOST_OF_LOGS", 10_000)
    monkeypatch.setattr("deqmcl_gym.logs.MOST_OF_LOGS", 10_000)
    if name == "x.npz":
        logs.write(real(), path)
        arrays = dict(np.load(path))
        np.savez_compressed(path, **arrays, more=np.zeros(10**6))
        assert len(read(path)) == len(real())
        np.savez_compressed(path, **arrays | {"ranges": np.zeros((10**4, 3))})
    else:
        path.write_bytes(gzip.compress(b"0 " * 10**4))
    with pytest.raises(InputError, match=f"{name} is larger than 10,000 bytes"):
        read(path)


def promised():
    """An archive whose array would have 10¹³ numbers."""
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**13,)}
    archive = zipfile.ZipFile(buffer := io.BytesIO(), "w")
    with archive, archive.open("times.npy", "w") as file:
        np.lib.format.write_array_header_1_0(file, header)
    return buffer.getvalue()


def array(save, *values, **arrays):
    save(buffer := io.BytesIO(), *values, **arrays)
    return buffer.getvalue()


PICKLED = {"times": np.array([{}], object), "odometry": np.zeros((1, 3)), "ranges": np.ones((1, 1))}
FILES = {  # by name: the content, or what it is of a whole text; the words
    "half.log.gz": (gzip.compress("\n".join(carmen_lines(500)).encode())[:900], "truncated"),
    "array.npz": (array(np.save, np.zeros(3)), "not a complete npz file"),
    "promised.npz": (promised(), "not a complete npz file"),
    "pickled.npz": (array(np.savez, **PICKLED), "pickles"),
    "twice.csv": (lambda text: text.replace("ref_x", "odom_x"), "the column 'odom_x' 2 times"),
    "nested.csv": (lambda text: "# " + "[" * 10**5 + text, "is not a JSON object"),
    "other.csv": (lambda text: text.replace("ref_heading", "ref_theta"), "'ref_heading' 0 times"),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_is_wrong_as_a_whole_is_refused(tmp_path, csv, name):
    content, said = FILES[name]
    content = content("\n".join(csv[1])).encode() if callable(content) else content
    (tmp_path / name).write_bytes(content)
    with refused(name, said):
        read_and_warned(tmp_path / name)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"scanner": {"min_range": 6.0}}, "must be a number"),
        ({"odometry": np.zeros((2, 3))}, "odometry"),
        ({"ranges": np.zeros((3, 2))}, "have shape"),
        ({"times": [0.0, 2.0, 1.0]}, "run backwards"),
        ({"reference": np.zeros((2, 3))}, "reference"),
        ({"unit": "feet"}, "unit"),
        ({"ranges": [["near"]] * 3}, "ranges is"),
        ({"reference": [["x", "y", "z"]] * 3}, "the reference of the log is"),
    ],
)
def test_a_log_made_by_hand_is_checked(changes, said):
    given = {"times": np.arange(3.0), "odometry": np.zeros((3, 3)), "ranges": np.ones((3, 1))}
    given |= {"scanner": {}, **changes}
    scanner = {"angles": (0.0,), "max_range": 5.0, **given.pop("scanner")}
    with pytest.raises(InputError, match=said):
        logs.Log(logs.Scanner(**scanner), **given)


def test_a_reference_that_does_not_overlap_is_refused():
    log = real()
    later = logs.Trajectory(log.times + 1e6, log.odometry)
    with pytest.raises(InputError, match="no record has a reference pose"):
        logs.referenced(log, later)
    apart = logs.Trajectory([log.times[0] - 1, log.times[-1] + 1], [(0, 0, 0), (9, 0, 0)])
    with pytest.raises(InputError, match=r"0.5 m apart or farther, which is max_gap"):
        logs.referenced(log, apart, max_gap=0.5)


def test_a_damaged_message_of_a_bag_is_counted(tmp_path):
    log = real()
    written(log, tmp_path / "x")
    with sqlite3.connect(next((tmp_path / "x").glob("*.db3"))) as base:
        topic = base.execute("SELECT id FROM topics WHERE name = '/scan'").fetchone()[0]
        third = "SELECT id FROM messages WHERE topic_id = ? ORDER BY timestamp LIMIT 1 OFFSET 2"
        (message,) = base.execute(third, (topic,)).fetchone()
        base.execute("UPDATE messages SET data = x'0001000001' WHERE id = ?", (message,))
    back, warned = read_and_warned(tmp_path / "x")
    assert back.times == pytest.approx(np.delete(log.times, 2))
    assert "skipped 1 of 30 records: 1 unreadable" in warned
