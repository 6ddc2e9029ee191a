"""``deqmcl paper`` end to end on a small run: the files, and that nothing but the seed matters."""

import json
import re
import shutil
from argparse import ArgumentParser

from deqmcl_command import METHODS, SMALL, exit_code, files, lines, records

from benchmarks.commands import setting_sweep
from benchmarks.commands.experiments import paper_command
from benchmarks.sweeps.sweepfile import paper_sweep, sweep_named, sweep_of

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


def test_the_command_writes_all_promised_files_and_is_quiet_where_no_one_watches(small_run):
    done, out = small_run
    assert (done.returncode, done.stderr) == (0, "")
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
    assert {
        method: {int(r["offset"]) for r in rows if r["method"] == method} for method in METHODS
    } == OFFSETS
    assert len(rows) == sum(map(len, OFFSETS.values()))
    assert {row["worlds"] for row in rows} == {"2"}


def test_what_is_printed_is_the_table_with_the_papers_values(small_run):
    done, out = small_run
    for words in ("Table 1, scenario paper: 2 worlds, N = 100, L = 20", "20.95 (17.66)", "deq-mcl"):
        assert words in done.stdout
    written = (out / "table.md").read_text()
    assert "| deq-mcl" in written
    assert "20.95 (17.66)" in written


def test_the_manifest_says_how_to_get_the_same_numbers(small_run):
    _, out = small_run
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["command"] == ["deqmcl", *SMALL, "--jobs", "2", "--out", str(out)]
    assert sweep_of(manifest["identity"]["sweep"], title="") == SMALL_SWEEP
    environment = manifest["environment"]
    assert re.fullmatch("[0-9a-f]{64}", environment["code"])
    assert set(environment["libraries"]) == {"numpy", "numba", "pymunk", "gymnasium"}
    assert set(environment) == {"deqmcl-gym", "code", "python", "platform", "libraries"}


def test_one_and_two_workers_write_the_same_bytes_but_for_the_command(small_run, one_worker):
    two, one = files(small_run[1]), files(one_worker)
    assert set(one) == set(two)
    same = {name for name in one if not MACHINE.match(name)}
    assert {"results.csv", "trials.csv", "table.md", "figures/lap.webp"} < same
    assert [name for name in sorted(same) if one[name] != two[name]] == []
    ours, theirs = (json.loads(run["manifest.json"]) for run in (one, two))
    assert ours.pop("command") != theirs.pop("command")
    assert ours == theirs


def test_a_folder_grows_by_worlds_and_methods_and_runs_only_those(one_worker, tmp_path, ran):
    out = shutil.copytree(one_worker, tmp_path / "copy")
    more = ("--trials", "3", "--localizers", ",".join((*METHODS, "ekf")), "--particles", "100")
    assert exit_code("paper", *more, "--jobs", "1", "--out", out) == 0
    run = {(trial.localizer, trial.trial) for trial in ran}
    assert run == {*((name, 2) for name in METHODS), *(("ekf", i) for i in range(3))}
    assert {row["worlds"] for row in lines(out, "results.csv")} == {"3"}
    assert exit_code(*SMALL, "--jobs", "1", "--out", out) == 2  # it does not shrink
