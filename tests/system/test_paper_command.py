"""``deqmcl paper`` end to end on a small run: the files, and that nothing but the seed matters."""

import csv
import json
import math
import re
import shutil
from argparse import ArgumentParser

import cv2
import pytest
from deqmcl_command import METHODS, SMALL, exit_code, files

from benchmarks.commands import paper, shared
from benchmarks.pictures import figures
from benchmarks.report import writing
from benchmarks.sweeps.suites import SUITES, paper_sweep
from benchmarks.sweeps.sweepfile import sweep_of
from benchmarks.trials import attempt
from benchmarks.trials.spec import unworded
from deqmcl_gym.validation import integer
from localizers.naming import registry

SMALL_SWEEP = paper_sweep(trials=2, particles=100)
FIGURES = (
    *("fig4_deq-mcl.png", "fig4_mcl.png", "fig5_step150.png", "fig5_step170.png", "lap.webp"),
)
OFFSETS = {
    "mcl": {0},
    "mcl-map": {0},
    "mcl-smoother": {0, -20},
    "mcl-map-smoother": {0, -20},
    "deq-mcl": {0, -20, 20},
    "dead-reckoning": {0, -20, 20},
}
# what may differ between runs: times and the command, and what tells of them
MACHINE = re.compile(
    r"timings|manifest\.json|report\.html|results\.md|written\.json|images/(speed|points)"
)


def rows_of(folder, name="results.csv"):
    with (folder / name).open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_command_succeeds_and_keeps_quiet_on_stderr_where_no_one_watches(small_run):
    done, _ = small_run
    assert (done.returncode, done.stderr) == (0, "")


def test_all_promised_files_are_there(small_run):
    _, out = small_run
    names = set(files(out))
    trials = {name for name in names if name.startswith("trials/")}
    assert len(trials) == 2 * len(METHODS)
    assert names >= {
        *("table.md", "results.csv", "trials.csv", "timings.csv", "manifest.json"),
        *("report.html", "results.md", *(f"figures/{name}" for name in FIGURES)),
        *(name.replace("trials/", "timings/") for name in trials),
    }


def test_the_command_is_the_sweep_of_its_name():
    parser = ArgumentParser()
    paper.arguments(parser)
    options = parser.parse_args([])
    assert shared.sweep_of(options, METHODS, options.trials) == SUITES["paper"]
    assert options.out.as_posix() == "results/paper"


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_a_readable_picture_with_colours(small_run, name):
    path = small_run[1] / "figures" / name
    if path.suffix == ".webp":
        read_it, animation = cv2.imreadanimation(str(path))
        assert read_it
        assert len(animation.frames) == 204 // 2 + 1
        image = animation.frames[50][..., :3]
    else:
        image = cv2.imread(str(path))
    assert min(image.shape[:2]) > 300
    assert image.std(axis=(0, 1)).min() > 10


def test_the_figures_are_of_trial_0():
    shown = figures.chosen(SMALL_SWEEP.distinct())
    assert [(trial.localizer, trial.trial) for trial in shown] == [("mcl", 0), ("deq-mcl", 0)]


def test_the_table_has_every_method_at_every_offset_it_holds(small_run):
    rows = rows_of(small_run[1])
    found = {
        method: {int(r["offset"]) for r in rows if r["method"] == method} for method in METHODS
    }
    assert found == OFFSETS
    assert len(rows) == sum(map(len, OFFSETS.values()))
    assert {row["worlds"] for row in rows} == {"2"}


def test_the_table_is_made_of_the_trials(small_run):
    _, out = small_run
    trials = rows_of(out, "trials.csv")
    assert len(trials) == 2 * len(rows_of(out))
    for row in rows_of(out):
        own = [t for t in trials if (t["method"], t["offset"]) == (row["method"], row["offset"])]
        first, second = (float(trial["error"]) for trial in own)
        # sums of two floats, rounded
        assert float(row["error"]) == pytest.approx((first + second) / 2, rel=1e-14)
        assert float(row["error_sd"]) == pytest.approx(abs(first - second) / math.sqrt(2), rel=1e-9)
    assert {(t["steps_done"], t["scans_used"]) for t in trials} == {("204", "204")}


def test_the_present_of_the_smoother_is_that_of_mcl(small_run):
    against = (
        "diff",
        "diff_low",
        "diff_high",
        "win_rate",
        "p",
        "p_holm",
        "paired_worlds",
        "params",
    )
    rows = {
        (row["method"], row["offset"]): {k: v for k, v in row.items() if k not in against}
        | {"method": ""}
        for row in rows_of(small_run[1])
    }
    assert rows["mcl-smoother", "0"] == rows["mcl", "0"]
    assert rows["mcl-map-smoother", "0"] == rows["mcl-map", "0"]
    assert rows["mcl-map", "0"] != rows["mcl", "0"]


def test_dead_reckoning_has_errors_but_no_spread(small_run):
    rows = [row for row in rows_of(small_run[1]) if row["method"] == "dead-reckoning"]
    for row in rows:
        assert [row[name] for name in ("entropy", "var_x", "var_cos")] == ["", "", ""]
        assert float(row["error"]) > 0


def test_what_is_printed_is_the_table_with_the_papers_values_and_the_honest_sentence(small_run):
    done, out = small_run
    for words in ("Table 1, scenario paper: 2 worlds, N = 100, L = 20", "20.95 (17.66)", "deq-mcl"):
        assert words in done.stdout
    written = (out / "table.md").read_text()
    (said,) = re.findall(r"^Dead reckoning on the plan.*\.$", done.stdout, re.MULTILINE)
    assert said in written
    assert "| DEQ-MCL" in written
    assert "20.95 (17.66)" in written


def test_no_line_of_the_table_is_wider_than_120_characters(small_run):
    table = small_run[0].stdout.partition("\n\n")[2].partition("\n\n")[0]
    assert len(table.splitlines()) == 2 + sum(map(len, OFFSETS.values()))
    assert max(map(len, table.splitlines())) <= 120


def test_the_manifest_says_how_to_get_the_same_numbers(small_run):
    _, out = small_run
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["command"] == ["deqmcl", *SMALL, "--jobs", "2", "--out", str(out)]
    assert sweep_of(unworded(manifest["identity"]["sweep"]), title="") == SMALL_SWEEP
    assert manifest["seeds"]["root"] == 0
    environment = manifest["environment"]
    assert re.fullmatch("[0-9a-f]{64}", environment["code"])
    assert set(environment["libraries"]) == {"numpy", "numba", "pymunk", "gymnasium"}
    assert set(environment) == {"deqmcl-gym", "code", "python", "platform", "libraries"}


def test_one_and_two_workers_write_the_same_bytes(small_run, one_worker):
    two, one = files(small_run[1]), files(one_worker)
    assert set(one) == set(two)
    same = {name for name in one if not MACHINE.match(name)}
    assert {"results.csv", "trials.csv", "table.md", "figures/lap.webp"} < same
    assert [name for name in sorted(same) if one[name] != two[name]] == []


def test_the_manifests_of_two_runs_differ_in_the_command_only(small_run, one_worker):
    two, one = (json.loads((p / "manifest.json").read_text()) for p in (small_run[1], one_worker))
    assert one.pop("command") != two.pop("command")
    assert one == two


def test_a_second_run_computes_and_draws_nothing(one_worker, monkeypatch):
    def fail(*given):
        raise AssertionError(f"{given} was run or drawn again")

    before = files(one_worker)
    monkeypatch.setattr(attempt, "trial_moments", fail)
    monkeypatch.setattr(figures, "write_figures", fail)
    monkeypatch.setattr(writing, "_write", fail)
    assert exit_code(*SMALL, "--jobs", "1", "--out", one_worker) == 0
    assert files(one_worker) == before


def test_a_folder_grows_by_worlds_and_methods_and_runs_only_those(one_worker, tmp_path, ran):
    out = tmp_path / "copy"
    shutil.copytree(one_worker, out)
    more = ("--trials", "3", "--localizers", ",".join((*METHODS, "ekf")), "--particles", "100")
    assert exit_code("paper", *more, "--jobs", "1", "--out", out) == 0
    run = {(trial.localizer, trial.trial) for trial in ran}
    assert run == {*((name, 2) for name in METHODS), *(("ekf", i) for i in range(3))}
    assert {row["worlds"] for row in rows_of(out)} == {"3"}
    assert exit_code(*SMALL, "--jobs", "1", "--out", out) == 2  # it does not shrink


def test_another_seed_gives_other_worlds(one_worker, tmp_path):
    fewer = ("--trials", "2", "--localizers", "dead-reckoning", "--jobs", "1", "--seed", "1")
    assert exit_code("paper", *fewer, "--out", tmp_path) == 0
    ours = {row["error"] for row in rows_of(tmp_path, "trials.csv")}
    theirs = {row["error"] for row in rows_of(one_worker, "trials.csv")}
    assert len(ours) == 6
    assert not ours & theirs


def broken(robot):
    raise ArithmeticError("broken\nfrom the start")


def test_a_failing_localizer_fails_the_run_in_one_line_and_the_others_trials_are_kept(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setitem(registry._FACTORIES, "broken", broken)
    few = ("--trials", "2", "--localizers", "broken,dead-reckoning", "--jobs", "1")
    assert exit_code("paper", *few, "--out", tmp_path) == 3
    printed = capsys.readouterr()
    assert printed.out.startswith("The paper's experiment: 2 of 4 trials finished, 2 failed.\n")
    assert printed.err == (
        "deqmcl: 2 of 4 trials failed, the rest is kept; first: broken, trial 0: ArithmeticError: "
        "broken from the start (--debug shows where)\n"
    )
    assert len([name for name in files(tmp_path) if name.startswith("trials/")]) == 2
    assert not (tmp_path / "table.md").exists()  # no Table 1 of half an experiment


def test_a_localizer_that_refuses_its_parameters_is_bad_input_and_nothing_is_written(
    tmp_path, monkeypatch, capsys
):
    def picky(robot, *, particles):
        integer("particles", particles, low=50)

    monkeypatch.setitem(registry._FACTORIES, "picky", picky)
    few = ("--trials", "2", "--localizers", "dead-reckoning,picky", "--jobs", "1")
    assert exit_code("paper", *few, "--particles", 49, "--out", tmp_path / "out") == 2
    assert capsys.readouterr().err == (
        "deqmcl: particles is 49, but must be a whole number of 50 or more.\n"
    )
    assert list(tmp_path.iterdir()) == []
