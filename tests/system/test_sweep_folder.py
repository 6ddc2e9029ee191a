"""The folder of a sweep: what is run again, what is refused, who may use it, what can be read."""

import json
import math
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from deqmcl_command import exit_code, files
from sweep_command import broken, report, sweep, tables, write_small

import localizers
from benchmarks.sweeps.results import results_in
from benchmarks.trials import plugins


def edited(path):
    path.write_text(path.read_text().replace('"steps_done":204', '"steps_done":205'))


@pytest.mark.parametrize(("damage", "why"), [(Path.unlink, None), (edited, "checksum")])
def test_only_a_trial_that_is_lost_or_damaged_is_run_again_and_the_tables_come_back(
    file, finished, copy, ran, capsys, damage, why
):
    path = sorted((copy / "trials").iterdir())[1]
    before = path.read_bytes()
    damage(path)
    (copy / "results.csv").unlink()
    assert sweep(file, copy) == 0
    assert len(ran) == 1
    assert path.read_bytes() == before
    assert tables(copy) == tables(finished)
    said = capsys.readouterr().err.splitlines()
    assert len(said) == (why is not None)
    assert all(str(path) in line and why in line for line in said)


def test_stray_files_are_named_and_left_out_and_only_our_own_are_removed(
    file, finished, copy, capsys
):
    some = next((copy / "trials").glob("*.json"))
    (left := copy / "trials" / ".deqmcl-0a1b2c3_.tmp").write_text("{")
    (mine := copy / "trials" / ".notes.tmp").write_text("{")
    (copy / "trials" / "ffff.json").write_bytes(some.read_bytes())
    assert sweep(file, copy) == 0
    said = capsys.readouterr().err
    assert f"{left} was left by an interrupted write; it is removed." in said
    assert "ffff.json is of another trial; it is left out." in said
    assert not left.exists()
    assert mine.exists()
    assert tables(copy) == tables(finished)


def test_a_folder_whose_manifest_says_what_its_seed_once_followed_from_is_read_and_goes_on(
    file, copy, ran, capsys
):
    made = json.loads((copy / "manifest.json").read_text())
    made["identity"]["sweep"]["held_out"] = {"value": "8f3c", "origin": "a beacon"}
    (copy / "manifest.json").write_text(json.dumps(made))
    before = tables(copy)
    assert exit_code("verify", copy, "--jobs", "1") == 0
    ran.clear()
    assert report(copy) == sweep(file, copy) == 0
    assert (tables(copy), ran, capsys.readouterr().err) == (before, [], "")


def test_another_sweep_in_the_folder_is_refused_with_all_differences(copy, tmp_path, refusal):
    before = files(copy)
    another = write_small(tmp_path, trials=1, particles=16, more="\n[world]\nnoise.drive = 0.5")
    differences = "trials was 2 and is 1", "particles was 15 and is 16", "was not set and is 0.5"
    refusal(["sweep", another, "--out", copy], *differences, "--out")
    assert files(copy) == before


def test_changed_code_is_refused_and_named(file, copy, refusal, monkeypatch):
    monkeypatch.setattr(plugins, "code_digest", lambda: "other")
    monkeypatch.setattr(plugins, "versions", lambda: {"numpy": "0.1"})
    changed = "code was", "libraries.numpy was", "libraries.numba was"
    refusal(["sweep", file, "--out", copy], *changed)


def test_a_manifest_of_something_else_is_no_excuse_to_go_on(file, copy, refusal):
    path = copy / "manifest.json"
    for spoil, words in (
        (lambda: path.write_text(""), "manifest.json is truncated, or not JSON"),
        (lambda: path.write_text('{"command": ["deqmcl", "speed"]}'), "it is not of a sweep"),
        (path.unlink, "holds no manifest.json of a sweep"),
    ):
        spoil()
        before = files(copy)
        refusal(["sweep", file, "--out", copy], words)
        assert files(copy) == before


def test_what_a_folder_holds_can_be_read_again_in_the_order_asked_for(finished):
    found = results_in(finished)
    assert (found.planned, found.missing, found.failures) == (4, 0, [])
    assert [(r.trial.localizer, r.trial.trial) for r in found.records] == [
        *(("mcl", 0), ("mcl", 1), ("dead-reckoning", 0), ("dead-reckoning", 1))
    ]
    assert found.title == "small"
    assert found.command[:2] == ["deqmcl", "sweep"]


@localizers.registered("broken", broken)
def test_results_of_other_code_can_be_read_and_infinity_is_a_number(tmp_path, monkeypatch):
    more = "\n[[vary]]\nparams.beta = [inf, 1.0]\n"
    file, out = write_small(tmp_path, trials=1, more=more), tmp_path / "out"
    assert sweep(file, out, "--with", "mcl-map,broken") == 3
    monkeypatch.setattr(plugins, "code_digest", lambda: "other")
    (copy := out / "trials" / "note.json").write_text("{}")
    found = results_in(out)
    assert copy.exists()
    assert (len(found.records), len(found.failures), found.missing) == (4, 2, 0)
    betas = [dict(r.trial.params).get("beta") for r in found.records]
    assert betas == [None, None, math.inf, 1.0]  # mcl and dead reckoning have none


PLUG_IN = """
from localizers.methods.dead_reckoning import dead_reckoning
from pathlib import Path
Path(__file__).with_name("ran").open("a").write("{}")
def L(robot): return dead_reckoning(robot)
"""


def test_a_report_takes_the_trials_of_the_manifests_own_code_alone_and_runs_none(tmp_path, capsys):
    plug_in, (one, two) = tmp_path / "p.py", (tmp_path / "one", tmp_path / "two")
    file = write_small(tmp_path)
    for out, version in ((one, 1), (two, 2)):
        plug_in.write_text(PLUG_IN.format(version))
        assert sweep(file, out, "--with", f"{plug_in}:L") == 0
    before = (tmp_path / "ran").read_text()
    (one / "manifest.json").unlink()
    shutil.copytree(two, one, dirs_exist_ok=True)  # the old trials beside the new ones
    capsys.readouterr()
    assert report(one) == 0
    assert tables(one) == tables(two)
    assert capsys.readouterr().err.count("is of other code, libraries or plug-ins") == 2
    assert (tmp_path / "ran").read_text() == before
    plug_in.unlink()
    assert report(one) == 0


@pytest.mark.skipif(sys.platform == "win32", reason="no such locks there")
def test_two_sweeps_into_one_folder_are_one_too_many_and_a_dead_ones_lock_is_none(
    file, tmp_path, refusal
):
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, tmp_path], stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout.readline() == "locked\n"
    words = f"another sweep (process {holder.pid}) is writing to {tmp_path}"
    refusal(["sweep", file, "--out", tmp_path], words)
    assert [path.name for path in tmp_path.iterdir()] == [".deqmcl.lock"]
    holder.kill()
    holder.communicate()
    assert (tmp_path / ".deqmcl.lock").exists()  # stale
    assert sweep(file, tmp_path) == 0
    assert not (tmp_path / ".deqmcl.lock").exists()


HOLDER = """
import sys, time
from pathlib import Path
from benchmarks.files import locked
with locked(Path(sys.argv[1])):
    print("locked", flush=True)
    time.sleep(1000)
"""
