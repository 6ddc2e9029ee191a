"""deqmcl run and deqmcl paper end to end: the files, and that nothing but the seed matters."""

import contextlib
import io
import json
import math
import re
import shutil
from argparse import ArgumentParser

import cv2
import numpy as np
import pandas as pd
import pytest
from deqmcl_command import DEQMCL, METHODS, SMALL, exit_code, files, lines, process, records

from benchmarks.commands.experiments import paper_command, setting_sweep
from benchmarks.sweeps.sweepfile import paper_sweep, sweep_named, sweep_of
from benchmarks.trials.scoring import scores
from benchmarks.trials.stage import Stage
from deqmcl_gym import logs

FEW = ("--particles", "20", "--seed", "3")


def curve(folder):
    return dict(tuple(pd.read_csv(folder / "error.csv").groupby("offset")))


@pytest.fixture(scope="module")
def lap(tmp_path_factory):
    out, said = tmp_path_factory.mktemp("run") / "new" / "folder", io.StringIO()
    with contextlib.redirect_stdout(said):
        assert exit_code("run", "--localizer", "mcl", *FEW, "--out", out) == 0
    return said.getvalue(), out


def test_a_lap_leaves_its_animation_its_errors_its_tracks_and_nothing_else(lap):
    said, out = lap
    tracks = {"trajectory_truth.tum", "trajectory_t.tum"}
    named = {"lap.webp", "error.csv", *tracks}
    assert files(out).keys() == named
    assert all(name in said for name in named)
    read_it, animation = cv2.imreadanimation(str(out / "lap.webp"))
    assert read_it
    assert len(animation.frames) == 204 // 4 + 1 + 1  # every fourth step, and the whole way
    assert all(side % 2 == 0 for side in animation.frames[0].shape[:2])


def test_curve_and_trajectories_hold_the_true_and_estimated_poses_of_every_offset(tmp_path):
    arguments = ("--localizer", "deq-mcl", *FEW, "--lag", "30")
    assert exit_code("run", *arguments, "--out", tmp_path) == 0
    held = curve(tmp_path)
    states = {offset: rows["state"].tolist() for offset, rows in held.items()}
    assert states == {0: [*range(205)], -30: [*range(175)], 30: [*range(30, 205)]}
    for name, offset in (("t", 0), ("t-30", -30), ("t+30", 30)):
        rows = np.loadtxt(tmp_path / f"trajectory_{name}.tum")
        own = held[offset][["state", "x", "y"]].to_numpy()
        np.testing.assert_allclose(rows[:, :3], own, rtol=1e-8)  # nine digits
        assert (rows[:, 3:6] == 0).all()
    truth = np.loadtxt(tmp_path / "trajectory_truth.tum")
    heading = 2 * np.arctan2(truth[:, 6], truth[:, 7])
    apart = heading - held[0]["true_heading"].to_numpy()
    assert (apart + math.pi) % (2 * math.pi) - math.pi == pytest.approx(0, abs=1e-9)
    assert truth[:, 1:3] == pytest.approx(held[0][["true_x", "true_y"]].to_numpy(), rel=1e-8)


def test_the_lap_is_trial_0_of_the_paper_experiment_with_that_seed(lap):
    printed, out = lap
    few = {"trials": 1, "seed": 3, "lag": 20, "particles": 20}
    (trial,) = paper_sweep(scenario="paper", localizers=["mcl"], **few).distinct()
    (row,) = scores(Stage.of(trial).trace())
    errors = curve(out)[0].query("state >= 1")["error"]
    assert len(errors) == 204
    assert errors.mean() == pytest.approx(row["error"], rel=1e-12)  # a sum of 204 floats
    (said,) = re.findall(r"x\[t\]: error +([\d.]+), position RMSE", printed)
    assert float(said) == pytest.approx(row["error"], abs=0.005)  # two decimals
    assert printed.startswith("mcl, scenario paper, seed 3: 204 steps\n")


def test_a_lap_can_be_kept_as_a_log_over_no_other_file(tmp_path, refusal):
    out, log = tmp_path / "out", tmp_path / "lap.csv"
    arguments = ("run", "--localizer", "dead-reckoning", "--seed", "3", "--out", out)
    (tmp_path / "mine.csv").write_text("mine")
    refusal([*arguments, "--log", tmp_path / "mine.csv"], "exists already")
    assert files(tmp_path) == {"mine.csv": b"mine"}
    assert exit_code(*arguments, "--log", log) == 0
    truth = np.loadtxt(out / "trajectory_truth.tum")
    kept = logs.read(log)
    assert kept.times.tolist() == truth[:, 0].tolist()
    assert kept.reference[:, :2] == pytest.approx(truth[:, 1:3], rel=1e-8)


def test_on_a_map_in_metres_errors_are_metres_and_degrees(tmp_path, capsys):
    walls = "[[0, 0], [4, 0], [4, 3], [0, 3]]"
    (tmp_path / "room.toml").write_text(
        f"[env]\nlap.waypoints = [[1, 1], [3, 1], [3, 2], [1, 2]]\n"
        f"[env.floor_plan]\nouter = {walls}\nunit = 'm'\n"
    )
    arguments = ("--scenario", tmp_path / "room.toml", "--localizer", "dead-reckoning")
    assert exit_code("run", *arguments, "--lag", "0", "--out", tmp_path / "out") == 0
    (line,) = (one for one in capsys.readouterr().out.splitlines() if "x[t]:" in one)
    said = re.fullmatch(r" +x\[t\]: position RMSE +([\d.]+) m, heading RMSE +([\d.]+) deg", line)
    rows = curve(tmp_path / "out")[0]
    off = np.hypot(rows["x"] - rows["true_x"], rows["y"] - rows["true_y"])
    assert rows["position_error"].to_numpy() == pytest.approx(off.to_numpy())
    assert float(said[1]) == pytest.approx(np.sqrt((off[1:] ** 2).mean()), abs=0.005)
    degrees = np.degrees(np.sqrt((rows["heading_error"][1:] ** 2).mean()))
    assert float(said[2]) == pytest.approx(degrees, abs=0.05)


SMALL_SWEEP = paper_sweep(trials=2, particles=100)
FIGURES = "fig4_deq-mcl.png", "fig4_mcl.png", "fig5_step150.png", "fig5_step170.png", "lap.webp"
OFFSETS = {
    "mcl": {0},
    "mcl-map": {0},
    "mcl-smoother": {0, -20},
    "mcl-map-smoother": {0, -20},
    "deq-mcl": {0, -20, 20},
    "dead-reckoning": {0, -20, 20},
}
# what may differ between runs: times and the command, and what tells of them
MACHINE = re.compile(r"timings|manifest\.json|trials\.jsonl|report\.html|images/points")


def test_the_command_writes_all_promised_files(small_run):
    _, out = small_run
    names = set(files(out))
    assert len(records(out)) == 2 * len(METHODS)
    assert names >= {
        *("table.md", "results.csv", "trials.csv", "timings.csv", "manifest.json"),
        *("report.html", *(f"figures/{name}" for name in FIGURES)),
    }


def test_the_command_is_the_sweep_of_its_name():
    parser = ArgumentParser()
    paper_command.arguments(parser)
    options = parser.parse_args([])
    assert setting_sweep(options, METHODS, options.trials) == sweep_named("paper")
    assert options.out.as_posix() == "results/paper"
    options = parser.parse_args(["--seed", "1"])
    assert setting_sweep(options, METHODS, options.trials).seed == 1


def test_the_table_has_every_method_at_every_offset_it_holds(small_run):
    rows = lines(small_run[1], "results.csv")
    held = {one: {int(r["offset"]) for r in rows if r["method"] == one} for one in METHODS}
    assert held == OFFSETS
    assert len(rows) == sum(map(len, OFFSETS.values()))
    assert {row["worlds"] for row in rows} == {"2"}
    for row in rows:  # of a single pose there is no spread, which is not 0
        spread = [row[name] for name in ("entropy", "var_x", "var_y", "var_cos", "var_sin")]
        assert ([*{*spread}] == [""]) == (row["method"] == "dead-reckoning")


def test_what_is_printed_is_the_table_with_the_papers_values(small_run):
    said, out = small_run
    assert "Table 1, scenario paper: 2 worlds, N = 100, L = 20" in said
    for text in (said, (out / "table.md").read_text()):
        assert "deq-mcl" in text
        assert "20.95 (17.66)" in text


def test_the_manifest_says_how_to_get_the_same_numbers(small_run):
    _, out = small_run
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["command"] == ["deqmcl", *SMALL, "--jobs", "1", "--out", str(out)]
    assert sweep_of(manifest["identity"]["sweep"], title="") == SMALL_SWEEP
    environment = manifest["environment"]
    assert re.fullmatch("[0-9a-f]{64}", environment["code"])
    assert set(environment["libraries"]) == {"numpy", "numba", "pymunk", "gymnasium"}
    assert set(environment) == {"deqmcl-gym", "code", "python", "platform", "libraries"}


def test_two_workers_write_the_same_bytes_but_for_the_command_and_are_quiet(small_run, tmp_path):
    done = process(DEQMCL, *SMALL, "--jobs", "2", "--out", tmp_path / "paper")
    assert (done.returncode, done.stderr) == (0, "")
    two, one = files(tmp_path / "paper"), files(small_run[1])
    assert set(one) == set(two)
    same = {name for name in one if not MACHINE.match(name)}
    assert {"results.csv", "trials.csv", "table.md", "figures/lap.webp"} < same
    assert [name for name in sorted(same) if one[name] != two[name]] == []
    ours, theirs = (json.loads(run["manifest.json"]) for run in (one, two))
    assert ours.pop("command") != theirs.pop("command")
    assert ours == theirs


def test_a_folder_grows_by_worlds_and_methods_and_runs_only_those(small_run, tmp_path, ran):
    out = shutil.copytree(small_run[1], tmp_path / "copy")
    more = ("--trials", "3", "--localizers", ",".join((*METHODS, "ekf")), "--particles", "100")
    assert exit_code("paper", *more, "--jobs", "1", "--out", out) == 0
    run = {(trial.localizer, trial.trial) for trial in ran}
    assert run == {*((name, 2) for name in METHODS), *(("ekf", i) for i in range(3))}
    assert {row["worlds"] for row in lines(out, "results.csv")} == {"3"}
    assert exit_code(*SMALL, "--jobs", "1", "--out", out) == 2  # it does not shrink
