"""``deqmcl replay`` on a log recorded here: its tables, against plain loops, and what it says."""

import csv
import math
import re
import statistics
from types import SimpleNamespace

import numpy as np
import pytest
from hall import recorded_in_a_hall

from benchmarks.cli import main
from benchmarks.replay.playing import Track
from benchmarks.replay.scoring import Played, Row
from benchmarks.replay.tables import results_table
from deqmcl_gym import logs
from deqmcl_gym.maps import GridMap

COMMAND = ("lap.csv", "--map", "hall.yaml", "--every", "0.1m,5deg", "--max-beams", "20")
KNOWN = (*COMMAND, "--reference", "lap.tum", "--particles", "200", "--seeds", "3", "--jobs", "1")
BLIND = (*COMMAND, "--particles", "200", "--seeds", "1", "--jobs", "1")
BROKEN = """
class Broken:
    def __init__(self, robot): ...
    def reset(self, prior, plan, rng): raise OSError("no laser")
    def update(self, ranges, action, plan): ...
"""


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """The current folder, with a hall, a log without poses, and its reference."""
    monkeypatch.chdir(tmp_path)
    hall, log = recorded_in_a_hall(steps=40)
    hall.save("hall.yaml")
    logs.Trajectory(log.times, log.reference).write("lap.tum")
    logs.write(logs.Log(log.scanner, log.times, log.odometry, log.ranges, None, "m"), "lap.csv")
    return tmp_path


def replay(*words):
    """Run the command; its exit code."""
    try:
        return main(["replay", *map(str, words)])
    except SystemExit as end:
        return end.code


def table(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def tum(path):
    """Poses x, y, θ by time, as the text says."""
    rows = [list(map(float, line.split())) for line in path.read_text().splitlines()]
    return {t: (x, y, 2 * math.atan2(qz, qw)) for t, x, y, _, _, _, qz, qw in rows}


@pytest.mark.parametrize(
    ("start", "beside"),
    [("reference", "dead-reckoning"), ("1.2,1,0", "dead-reckoning"), ("global", "mcl-map")],
)
def test_the_tables_are_those_of_plain_loops(recorded, start, beside):
    told = (*KNOWN, f"--start={start}", "--scan", "power=0.3")
    assert replay(*told, "--localizers", f"mcl,{beside}", "--out", "o") == 0
    results = {row["localizer"]: row for row in table("o/results.csv")}
    trials = table("o/trials.csv")
    assert [row["localizer"] for row in trials] == ["mcl"] * 3 + [beside] * 3
    log = logs.read("lap.csv").spaced(0.1, math.radians(5))
    way = [0.0]
    for forward, left, _ in log.increments.tolist():
        way.append(way[-1] + math.hypot(forward, left))
    reference = tum(recorded / "o/tracks/reference.tum")
    assert list(reference) == log.times.tolist()
    for name, row in results.items():
        positions, headings, metres, successes = [], [], [], []
        for seed in range(3):
            estimate = tum(recorded / f"o/tracks/{name}-{seed}.tum")
            position, heading, good = [], [], []
            for time, (x, y, angle) in reference.items():
                ex, ey, theirs = estimate[time]
                position.append(math.hypot(ex - x, ey - y))
                heading.append(abs(math.remainder(theirs - angle, 2 * math.pi)))
                good.append(position[-1] <= 1 and heading[-1] <= math.radians(30))
            from_here = [all(good[i:]) for i in range(len(good))]
            metres.append(way[from_here.index(True)] if any(from_here) else math.inf)
            successes.append(all(good[math.floor(0.75 * len(good)) :]))
            positions += position
            headings += heading
            (own,) = (r for r in trials if (r["localizer"], r["seed"]) == (name, str(seed)))
            assert float(own["position_median"]) == pytest.approx(statistics.median(position))
            rms = math.sqrt(sum(error**2 for error in position) / len(position))
            assert float(own["ape_rmse"]) == pytest.approx(rms)
            assert float(own["success_1m"]) == successes[-1]
        assert row["seeds"] == "3"
        assert float(row["position_median"]) == pytest.approx(statistics.median(positions))
        assert float(row["position_p95"]) == pytest.approx(np.quantile(positions, 0.95))
        assert float(row["heading_median"]) == pytest.approx(statistics.median(headings))
        assert float(row["success_1m"]) == pytest.approx(sum(successes) / 3)
        assert float(row["metres_to_localize"]) == pytest.approx(statistics.median(metres))
        assert float(row["ms_per_step"]) > 0
    if start == "reference":
        assert float(results["mcl"]["position_median"]) < 0.1
    if start == "1.2,1,0":
        assert results["dead-reckoning"]["metres_to_localize"] == "inf"
    page = (recorded / "o/report.html").read_text()
    assert page.count("<svg") == 5
    assert "http" not in page.replace("http://www.w3.org", "")


def test_the_numbers_do_not_depend_on_who_runs_beside_or_where(recorded):
    assert replay(*KNOWN, "--localizers", "mcl,amcl", "--out", "one") == 0
    assert replay(*KNOWN, "--localizers", "amcl", "--jobs", "2", "--out", "two") == 0
    for seed in range(3):
        name = f"tracks/amcl-{seed}.tum"
        assert (recorded / "one" / name).read_bytes() == (recorded / "two" / name).read_bytes()


def test_without_a_reference_there_is_agreement_and_no_error(recorded, capsys):
    assert replay(*BLIND, "--start=2.3,1,0", "--localizers", "mcl", "--out", "o") == 0
    told = capsys.readouterr()
    assert "no error is known" in told.out
    assert "assumed, as there is no reference" in told.out
    assert "do not fit" not in told.err
    (row,) = table("o/results.csv")
    assert row["position_median"] == row["success_1m"] == row["metres_to_localize"] == ""
    assert float(row["agreement_03"]) > 0.9
    assert not (recorded / "o/tracks/reference.tum").exists()
    assert "no error is known" in (recorded / "o/report.html").read_text()


@pytest.mark.parametrize("wrong", ["scale", "floor"])
@pytest.mark.parametrize("known", [True, False])
def test_a_map_that_does_not_fit_is_noticed(recorded, capsys, wrong, known):
    grid = GridMap.load("hall.yaml")
    cells, resolution = grid.occupancy, 0.1
    if wrong == "floor":
        cells, resolution = np.zeros((120, 160), np.int8), 0.05
        cells[[0, -1]] = cells[:, [0, -1]] = 100
    GridMap(occupancy=cells, resolution=resolution).save("hall.yaml")
    told = (*KNOWN, "--seeds", "1") if known else (*BLIND, "--start=2.3,1,0")
    assert replay(*told, "--localizers", "mcl", "--out", "o") == 0
    assert "Warning: log and map do not fit" in capsys.readouterr().err
    assert "Warning: log and map do not fit" in (recorded / "o/report.html").read_text()


@pytest.mark.parametrize("told", [KNOWN, (*BLIND, "--start=2.3,1,0")])
def test_a_log_without_a_measurement_in_range_is_noticed(recorded, capsys, told):
    log = logs.read("lap.csv")
    mm = np.nan_to_num(log.ranges, posinf=np.nan) * 1000
    logs.write(logs.Log(log.scanner, log.times, log.odometry, mm, None, "m"), "lap.csv")
    assert replay(*told, "--localizers", "mcl", "--out", "o") == 0
    assert "Warning: no beam has a measurement" in capsys.readouterr().err


def test_what_the_reader_warns_of_is_also_said_before_a_refusal(recorded, capsys):
    lines = (recorded / "lap.csv").read_text().splitlines(keepends=True)
    (recorded / "lap.csv").write_text("".join([*lines, lines[-2]]))  # its time runs backwards
    assert replay(*KNOWN, "--start=40,1,0", "--out", "o") == 2
    warning, refusal = capsys.readouterr().err.splitlines()
    assert "Warning: " in warning
    assert "backwards" in warning
    assert "no free space" in refusal


def test_motion_given_in_part_leaves_the_rest_as_it_would_be(recorded, capsys):
    noises = []
    for words in ((), ("--motion", "drive=0.5"), ("--motion", "drive=0.5,turn=0.1,drift=0")):
        assert replay(*KNOWN, *words, "--localizers", "dead-reckoning", "--out", "o") == 0
        noises.append(capsys.readouterr().out)
    estimated, part, whole = (re.search(r"drive (\S+).*?\)", text, re.S)[0] for text in noises)
    assert part == estimated.replace(estimated.split()[1], "0.5,").replace(
        "(estimated", "(drive given; the rest estimated"
    )
    assert whole.endswith("(given)")


def test_a_plug_in_that_fails_ends_with_3_and_the_others_are_kept(recorded, capsys):
    (recorded / "broken.py").write_text(BROKEN)
    assert replay(*KNOWN, "--localizers", "mcl,broken.py:Broken", "--out", "o") == 3
    told = capsys.readouterr()
    assert "3 of 6 runs failed" in told.err
    assert "no laser" in told.err
    mine = {row["localizer"]: row for row in table("o/results.csv")}
    assert mine["mcl"]["failed"] == "0"
    assert mine["broken.py:Broken"]["failed"] == "3"
    assert float(mine["mcl"]["success_1m"]) == 1
    assert "no laser" in (recorded / "o/report.html").read_text()


def test_lost_runs_are_counted_among_those_that_ended():
    here, poses, seconds = np.zeros((3, 3)), np.full((3, 3), 50.0), np.ones(3)
    track = Track(
        times=np.arange(3.0), way=np.arange(3.0), means=poses, best=poses, truth=here,
        seconds=seconds, unit="m",
    )  # fmt: skip
    run = SimpleNamespace(setting=SimpleNamespace(log=SimpleNamespace(unit="m")), seed=0)
    played = [Played(run=run, track=track, agreement=(0.0, 0.0))] * 2
    told = results_table([Row(localizer="mcl", played=played, failed=2)], referenced=True)
    cells = dict(zip(told.header, told.lines[0], strict=True))
    assert cells["lost"] == "2 of 2"
    assert cells["success (1 m, 30°)"] == "0 of 4"


def test_a_plug_in_that_hangs_is_ended_in_time(recorded, capsys):
    (recorded / "slow.py").write_text(
        BROKEN.replace('raise OSError("no laser")', "all(iter(lambda: True, 0))")
    )
    words = ("--localizers", "slow.py:Broken", "--timeout", "2", "--out", "o")
    assert replay(*BLIND, "--start=1.2,1,0", *words) == 3
    assert "1 of 1 runs failed" in (told := capsys.readouterr().err)
    assert "no result within 2 s" in told


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--start=2.1,1.6,0",), "no free space"),
        (("--start=40,1,0",), "no free space"),
        (("--start=2.3,1",), "must be reference, global"),
        (("--start", "-1,0,0"), "write --start=VALUE if it begins with -"),
        (("--read", "scanner=front"), "write it into the file"),
        (("--start=2.3,1,90",), "radians"),
        (("--every", "often"), "0.2m,5deg"),
        (("--motion", "dive=1"), "'drive'"),
        (("--motion", "drive=much"), "must be a number"),
        (("--scan", "power=0"), "scan.power"),
        (("--scan", "kind=sonar"), "beam model"),
        (("--max-beams", "0"), "max_beams"),
        (("--particles", "0"), "--particles"),
        (("--seeds", "0"), "--seeds"),
        (("--jobs", "0"), "--jobs"),
        (("--localizers", "mlc"), "'mcl'"),
        (("--localizers", "mcl,mcl"), "named twice"),
        (("--localizers", ","), "names none"),
        (("--reference", "far.tum"), "leaves the map"),
        (("--reference", "late.tum"), "same clock"),
        (("--map", "lost.yaml"), "lost.yaml"),
    ],
)
def test_bad_input_is_refused_in_a_sentence_and_nothing_is_written(recorded, capsys, words, said):
    reference = logs.read_tum("lap.tum")
    logs.Trajectory(reference.times, reference.poses + 50).write("far.tum")
    logs.Trajectory(reference.times + 1e4, reference.poses).write("late.tum")
    assert replay(*KNOWN, *words, "--out", "o") == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert said in told
    assert not (recorded / "o").exists()


def test_no_reference_and_no_start_is_refused(recorded, capsys):
    assert replay(*BLIND, "--out", "o") == 2
    assert "--start global" in capsys.readouterr().err


def test_a_folder_that_holds_other_files_is_refused(recorded, capsys):
    (recorded / "lost+found.txt").write_text("mine")
    assert replay(*KNOWN, "--out", recorded) == 2
    assert "none of this command's" in capsys.readouterr().err
    assert not (recorded / "results.csv").exists()
