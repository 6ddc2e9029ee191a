"""``deqmcl run``: one lap, its animation and its error curve."""

import csv
import math
import re

import cv2
import pytest
from deqmcl_command import DEQMCL, exit_code, files, process

from benchmarks.execution.attempt import trial_trace
from benchmarks.scoring import scores
from benchmarks.suites import paper_suite

FEW = ("--particles", "20", "--seed", "3")


def curve(folder):
    """Lines of error.csv as numbers, by offset."""
    by_offset = {}
    with (folder / "error.csv").open(newline="") as file:
        for line in csv.DictReader(file):
            row = {name: float(value) for name, value in line.items()}
            by_offset.setdefault(int(row["offset"]), []).append(row)
    return by_offset


@pytest.fixture(scope="module")
def lap(tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "new" / "folder"
    return process(DEQMCL, "run", "--localizer", "mcl", *FEW, "--out", out), out


def test_a_lap_leaves_its_animation_its_curve_and_nothing_else(lap):
    done, out = lap
    assert (done.returncode, done.stderr) == (0, "")
    assert set(files(out)) == {"lap.webp", "error.png", "error.csv"}


def test_the_animation_has_a_frame_for_every_second_step(lap):
    read_it, animation = cv2.imreadanimation(str(lap[1] / "lap.webp"))
    assert read_it
    assert len(animation.frames) == 204 // 2 + 1
    assert all(side % 2 == 0 for side in animation.frames[0].shape[:2])


def test_the_curve_is_a_picture(lap):
    height, width, _ = cv2.imread(str(lap[1] / "error.png")).shape
    assert width > height > 200


def test_the_lap_is_trial_0_of_the_paper_experiment_with_that_seed(lap):
    done, out = lap
    (trial,) = paper_suite(
        preset="paper", localizers=["mcl"], trials=1, seed=3, lag=20, particles=20
    )
    (row,) = scores(trial_trace(trial), 20)
    errors = [line["error"] for line in curve(out)[0] if line["state"] >= 1]
    assert len(errors) == 204
    assert sum(errors) / 204 == pytest.approx(row.error, rel=1e-12)  # a sum of 204 floats
    (said,) = re.findall(r"x\[t\]: error +([\d.]+), position RMSE", done.stdout)
    assert float(said) == pytest.approx(row.error, abs=0.005)  # two decimals
    assert done.stdout.startswith("MCL, preset paper, seed 3: 204 steps\n")


def test_the_curve_holds_the_true_states_and_the_errors_of_every_offset_held(tmp_path):
    arguments = ("--localizer", "dead-reckoning", "--lag", "30", "--preset", "matched")
    assert exit_code("run", *arguments, "--out", tmp_path) == 0
    lines = curve(tmp_path)
    states = {offset: [int(row["state"]) for row in rows] for offset, rows in lines.items()}
    assert states == {0: [*range(205)], -30: [*range(175)], 30: [*range(30, 205)]}
    for row in lines[0]:  # one point: its error in (x, y) is at most the whole error
        apart = math.hypot(row["x"] - row["true_x"], row["y"] - row["true_y"])
        assert apart <= row["error"] * (1 + 1e-12)  # rounding
        assert row["error"] <= math.hypot(apart, 2)  # directions are at most 2 apart


def test_the_same_command_writes_the_same_bytes(lap, tmp_path):
    assert exit_code("run", "--localizer", "mcl", *FEW, "--out", tmp_path) == 0
    assert files(tmp_path) == files(lap[1])


@pytest.mark.parametrize("lag", [0, 300])
def test_any_lag_works_even_one_longer_than_the_lap(tmp_path, capsys, lag):
    arguments = ("--localizer", "deq-mcl", "--particles", "10", "--lag", lag)
    assert exit_code("run", *arguments, "--out", tmp_path) == 0
    assert set(curve(tmp_path)) == {0}
    assert capsys.readouterr().out.count("position RMSE") == 1
