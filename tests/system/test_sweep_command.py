"""``deqmcl sweep``: what it writes and says, the same numbers however it is run; dry runs."""

import json
import re
import shutil
from collections import Counter

import pytest
from deqmcl_command import exit_code, files, lines, lose, records
from sweep_command import sweep, tables, write_small

from benchmarks.report import page
from benchmarks.sweeps import manifest, running
from benchmarks.sweeps.sweepfile import read_sweep, sweep_named, sweep_of

VARIED = "\n[[vary]]\nparams.particles = [5, 6]\n"
UNTIL = ("--until-decided", "--max-worlds", "22")


def test_a_sweep_writes_tables_manifest_and_a_line_a_trial(finished):
    names = {"manifest.json", "results.csv", "trials.csv", "timings.csv", "trials.jsonl"}
    assert names == files(finished).keys()
    assert len(records(finished)) == 4
    assert len(lines(finished)) == 2 * 1 + 2 * 3  # mcl holds x[t], dead reckoning x[t±4] too
    assert all(line["steps_done"] == line["scans_used"] == "204" for line in lines(finished))


@pytest.mark.parametrize("how", [("--jobs", "2"), ("--jobs", "1", "--timeout", "600")])
def test_the_numbers_do_not_depend_on_processes(file, finished, tmp_path, capsys, how):
    out = tmp_path / "out"
    assert sweep(file, out, *how) == 0
    said = capsys.readouterr()
    assert said.out.startswith("small: 4 of 4 trials finished.\n")
    assert "results.csv" in said.out
    assert said.err == ""
    assert tables(out) == tables(finished)
    assert records(out) == records(finished)


def test_jobs_and_timeout_are_no_part_of_what_a_sweep_is(file, copy, ran):
    before = files(copy)
    how = ("--jobs", "2", "--timeout", "600")
    assert sweep(file, copy, *how) == 0
    assert ran == []
    assert files(copy) == before


def test_shards_in_one_folder_or_copied_come_to_the_whole(file, finished, tmp_path, capsys, ran):
    out, other = tmp_path / "out", tmp_path / "other"
    assert sweep(file, out, "--shard", "1/3") == 0
    assert capsys.readouterr().out.startswith(
        "small: 2 of 4 trials finished, 2 missing.\n"
        "Not complete:\n"
        "  1 of 2: paper L=4 mcl particles=15\n"
        "  1 of 2: paper L=4 dead-reckoning\n"
    )
    assert sweep(file, out, "--shard", "2/3") == 0
    assert sweep(file, other, "--shard", "3/3") == 0
    shutil.copytree(other, out, dirs_exist_ok=True)
    assert len(ran) == 4
    assert sweep(file, out) == 0
    assert "4 of 4 trials finished." in capsys.readouterr().out
    assert len(ran) == 4
    assert tables(out) == tables(finished)


def test_worlds_seed_and_parameters_given_as_options_are_as_if_the_file_said_them(tmp_path, ran):
    file, out = write_small(tmp_path, more=VARIED), tmp_path / "out"
    given = "--trials", "1", "--seed", "3", "--set", "params.mcl.particles=7"
    assert sweep(file, out, *given, "--set", 'params.mcl.resampler="multinomial"') == 0
    said = json.loads((out / "manifest.json").read_text())
    assert said["command"][-2:] == ["--set", 'params.mcl.resampler="multinomial"']
    own = "particles = 7, resampler = 'multinomial'"
    text = file.read_text().replace("trials = 2", "trials = 1\nseed = 3", 1)
    file.write_text(text.replace('"mcl",', f'{{ name = "mcl", params = {{ {own} }} }},'))
    assert read_sweep(file).canonical() == said["identity"]["sweep"]
    assert len(ran) == 2  # mcl is the same at both points of the axis


@pytest.mark.parametrize("name", ["headline", "plan-sensor"])
def test_a_sweep_can_be_told_from_its_manifest(name):
    sweep = sweep_named(name)
    text = json.dumps(manifest.manifest_of(sweep, []).identity.sweep, allow_nan=False)
    assert sweep_of(json.loads(text), title="") == sweep


def test_combinations_that_are_the_same_are_said_and_run_once(tmp_path, capsys, ran):
    file = write_small(tmp_path, trials=1, more="\n[[vary]]\nparams.particles = [5, 6, 5]\n")
    assert sweep(file, tmp_path / "out") == 0
    assert "3 combinations equal others and were run once." in capsys.readouterr().out
    assert len(ran) == 3


def test_without_the_extra_report_a_sweep_has_its_tables(tmp_path, monkeypatch, capsys, refusal):
    monkeypatch.setattr(page, "find_spec", lambda name: None)
    few = write_small(tmp_path, trials=1)
    assert exit_code("sweep", few, "--jobs", "1", "--out", tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert "Tables only: a report needs jinja2 and matplotlib" in said
    assert "pip install 'deqmcl-gym[report]'" in said
    assert not (tmp_path / "out" / "report.html").exists()
    assert tables(tmp_path / "out")
    refusal(["report", tmp_path / "out"], "pip install 'deqmcl-gym[report]'")


def test_a_dry_run_shows_the_cells_and_a_time_and_writes_nothing(here, capsys):
    file = write_small(here, trials=50, more="\n[[vary]]\nscenario = ['paper', 'sharp']\n")
    assert sweep(file, here / "out", "--dry-run") == 0
    said = capsys.readouterr().out
    assert "small: 200 trials in 4 cells" in said
    assert "in all cells: L=4" in said
    assert re.search(r"\n50 +≈ \d.* s +sharp mcl particles=15\n", said)
    assert re.search(r"About \d+ (s|min) with 1 job: estimated from one measured trial", said)
    assert [path.name for path in here.iterdir()] == ["small.toml"]


@pytest.mark.parametrize(
    ("jobs", "time"), [("1", "10 min with 1 job:"), ("2", "5 min with 2 jobs")]
)
def test_the_time_of_a_dry_run_is_shared_out_among_jobs(tmp_path, monkeypatch, capsys, jobs, time):
    monkeypatch.setattr(running, "_seconds", lambda trials, *_: [6.0] * len(trials))
    file = write_small(tmp_path, trials=50)  # 100 trials of 6 s
    assert sweep(file, tmp_path / "out", "--dry-run", "--jobs", jobs) == 0
    assert f"About {time}" in capsys.readouterr().out


def counts(out):
    return Counter(line["method"] for line in lines(out) if line["offset"] == "0")


@pytest.fixture(scope="module")
def decided(tmp_path_factory):
    """A sweep of three methods until that is decided, and its file."""
    folder = tmp_path_factory.mktemp("decided")
    file = write_small(folder, others=["mcl-map"])
    assert sweep(file, folder / "out", *UNTIL) == 0
    return file, folder / "out"


def test_a_method_stops_when_it_is_decided_and_its_baseline_goes_on_for_the_others(decided):
    _, out = decided
    assert counts(out) == {"mcl": 22, "mcl-map": 22, "dead-reckoning": 20}
    last = {line["method"]: line for line in lines(out, "decisions.csv") if line["verdict"]}
    verdicts = {name: line["verdict"] for name, line in last.items()}
    assert verdicts == {"mcl-map": "open", "dead-reckoning": "better"}
    for line in lines(out, "results.csv"):
        assert (line["diff_low"], line["p"]) == ("", "")  # nothing for a fixed number of worlds


def test_what_is_run_until_decided_does_not_depend_on_jobs(decided, tmp_path):
    file, out = decided
    other = tmp_path / "out"
    assert sweep(file, other, "--max-worlds", "20", "--until-decided", "--jobs", "2") == 0
    lose(other, *range(0, 60, 6))
    assert sweep(file, other, *UNTIL) == 0
    assert records(other) == records(out)
    assert tables(other) == tables(out)


def test_a_margin_is_not_chosen_after_a_look(decided, tmp_path, refusal, capsys):
    file, out = decided
    whole = shutil.copytree(out, tmp_path / "whole")
    assert sweep(file, whole, "--trials", "22") == 0  # which looks at all worlds, with none
    assert counts(whole) == {"mcl": 22, "mcl-map": 22, "dead-reckoning": 22}
    assert not (whole / "decisions.csv").exists()
    for folder in (out, whole):
        again = ("sweep", file, "--out", folder, *UNTIL, "--margin", "60%")
        refusal(again, "was looked at with --margin 5%", "60%", "new --out")
    assert sweep(file, whole, *UNTIL) == 0
    assert lines(whole, "decisions.csv") == lines(out, "decisions.csv")
    assert "Comparisons with the baseline: 1 better, 1 open" in capsys.readouterr().out
