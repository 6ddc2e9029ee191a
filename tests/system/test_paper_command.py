"""``deqmcl paper`` end to end on a small run: the files, and that nothing but the seed matters."""

import csv
import json
import math
import re
import shutil

import pytest
from deqmcl_command import METHODS, SMALL, exit_code, files

from benchmarks.pictures import gallery
from benchmarks.trials import attempt

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
MACHINE = re.compile(r"timings|manifest\.json")  # what may differ between runs


def rows_of(folder, name="table.csv"):
    with (folder / name).open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_command_succeeds_and_keeps_quiet_on_stderr_where_no_one_watches(small_run):
    done, _ = small_run
    assert (done.returncode, done.stderr) == (0, "")


def test_all_promised_files_are_there_and_no_other(small_run):
    _, out = small_run
    names = set(files(out))
    trials = {name for name in names if name.startswith("trials/")}
    assert len(trials) == 2 * len(METHODS)
    assert names - trials == {
        *("table.csv", "trials.csv", "table.md", "manifest.json", "timings.csv"),
        *(f"figures/{name}" for name in (*FIGURES, "drawn.json")),
        *(name.replace("trials/", "timings/") for name in trials),
    }


def test_the_table_has_every_method_at_every_offset_it_holds(small_run):
    rows = rows_of(small_run[1])
    found = {
        method: {int(r["offset"]) for r in rows if r["method"] == method} for method in METHODS
    }
    assert found == OFFSETS
    assert len(rows) == sum(map(len, OFFSETS.values()))
    assert {row["trials"] for row in rows} == {"2"}


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
    rows = {(row.pop("method"), row["offset"]): row for row in rows_of(small_run[1])}
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
    for words in ("Table 1, scenario paper: 2 worlds, N = 100, L = 20", "20.95 (17.66)", "DEQ-MCL"):
        assert words in done.stdout
    written = (out / "table.md").read_text()
    (said,) = re.findall(r"^Dead reckoning on the plan .*\.$", done.stdout, re.MULTILINE)
    assert said in written
    assert "| DEQ-MCL" in written
    assert "20.95 (17.66)" in written


def test_the_manifest_says_how_to_get_the_same_numbers(small_run):
    _, out = small_run
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["command"] == ["deqmcl", *SMALL, "--jobs", "2", "--out", str(out)]
    assert manifest["configuration"] == {
        "scenario": "paper",
        "localizers": list(METHODS),
        "trials": 2,
        "seed": 0,
        "particles": 100,
        "lag": 20,
    }
    assert manifest["seeds"]["root"] == 0
    environment = manifest["environment"]
    assert re.fullmatch("[0-9a-f]{64}", environment["code"])
    assert set(environment["libraries"]) == {"numpy", "numba", "pymunk", "gymnasium"}
    assert set(environment) == {"deqmcl-gym", "code", "python", "platform", "libraries"}


def test_one_and_two_workers_write_the_same_bytes(small_run, one_worker):
    two, one = files(small_run[1]), files(one_worker)
    assert set(one) == set(two)
    same = {name for name in one if not MACHINE.match(name)}
    assert {"table.csv", "trials.csv", "table.md", "figures/lap.webp"} < same
    assert [name for name in sorted(same) if one[name] != two[name]] == []


def test_the_manifests_of_two_runs_differ_in_the_command_only(small_run, one_worker):
    two, one = (json.loads((p / "manifest.json").read_text()) for p in (small_run[1], one_worker))
    assert one.pop("command") != two.pop("command")
    assert one == two


def test_a_second_run_computes_nothing_and_writes_the_same_bytes(one_worker, tmp_path, monkeypatch):
    def fail(*given):
        raise AssertionError(f"{given} was run or drawn again")

    out = tmp_path / "copy"
    shutil.copytree(one_worker, out)
    (out / "table.csv").write_text("spoiled")
    monkeypatch.setattr(attempt, "trial_moments", fail)
    monkeypatch.setattr(gallery, "write_figures", fail)
    assert exit_code(*SMALL, "--jobs", "1", "--out", out) == 0
    before, after = files(one_worker), files(out)
    changed = {name for name in before if before[name] != after[name]}
    assert changed == {"manifest.json"}  # another --out


def test_another_seed_gives_other_worlds(one_worker, tmp_path):
    fewer = ("--trials", "2", "--localizers", "dead-reckoning", "--jobs", "1", "--seed", "1")
    assert exit_code("paper", *fewer, "--out", tmp_path) == 0
    ours = {row["error"] for row in rows_of(tmp_path, "trials.csv")}
    theirs = {row["error"] for row in rows_of(one_worker, "trials.csv")}
    assert len(ours) == 6
    assert not ours & theirs


@pytest.mark.parametrize(
    ("content", "words"),
    [('{"identity": {}}', "is the folder of a sweep: give another --out"), ("{", "cannot be read")],
)
def test_the_folder_of_a_sweep_is_refused_and_left_as_it_was(tmp_path, capsys, content, words):
    (tmp_path / "manifest.json").write_text(content)
    (tmp_path / "trials.csv").write_text("the sweep's")
    before = files(tmp_path)
    few = ("--trials", "1", "--localizers", "dead-reckoning", "--jobs", "1")
    assert exit_code("paper", *few, "--out", tmp_path) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert files(tmp_path) == before
