"""``deqmcl sweep``: what it writes, what it runs once, and what it runs again."""

import errno
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from deqmcl_command import DEQMCL, exit_code, files, process
from sweep_command import lines, sweep, tables, trial_files, write_small

from benchmarks.report import writing
from benchmarks.sweeps import manifest, store, sweepfile
from benchmarks.sweeps.collecting import results_in
from benchmarks.sweeps.suites import SUITES
from benchmarks.sweeps.sweepfile import sweep_of
from benchmarks.trials import plugins
from benchmarks.trials.spec import unworded
from deqmcl_gym.validation import InputError
from localizers import registry


@pytest.fixture(scope="module")
def finished(file, tmp_path_factory):
    """The folder of a small sweep that was never interrupted."""
    out = tmp_path_factory.mktemp("finished") / "out"
    assert sweep(file, out) == 0
    return out


@pytest.fixture
def copy(finished, tmp_path):
    return Path(shutil.copytree(finished, tmp_path / "copy"))


def broken(robot, **params):
    raise ArithmeticError("broken")


def test_a_sweep_writes_tables_manifest_and_one_file_per_trial_and_no_lock_stays(finished):
    names = {name for name in files(finished) if not name.startswith(("trials/", "timings/"))}
    assert {"manifest.json", "results.csv", "trials.csv", "timings.csv"} <= names
    assert not [name for name in names if "lock" in name or "tmp" in name]
    assert len(trial_files(finished)) == 4
    assert len(lines(finished)) == 2 * 1 + 2 * 3  # mcl holds x[t], dead reckoning x[t±4] too
    assert all(line["steps_done"] == line["scans_used"] == "204" for line in lines(finished))


def test_what_is_said_counts_the_trials(file, finished, tmp_path, capsys):
    assert sweep(file, tmp_path / "out") == 0
    said = capsys.readouterr()
    assert said.out.startswith("small: 4 of 4 trials finished.\n")
    assert "results.csv" in said.out
    assert said.err == ""


def test_the_manifest_says_what_was_run_by_what_code_where_and_how(file, finished):
    manifest = json.loads((finished / "manifest.json").read_text())
    assert manifest["command"] == [
        *("deqmcl", "sweep", str(file), "--out", str(finished), "--jobs", "1"),
    ]
    identity = manifest["identity"]
    assert identity["sweep"]["trials"] == 2
    assert identity["sweep"]["localizers"][0] == {"name": "mcl", "params": {}}
    assert re.fullmatch("[0-9a-f]{64}", identity["code"])
    assert set(identity["libraries"]) == {"numpy", "numba", "pymunk", "gymnasium"}
    assert manifest["cpu"]
    assert manifest["environment"]["python"]


@pytest.mark.parametrize("how", [("--jobs", "2"), ("--jobs", "1", "--timeout", "600")])
def test_the_numbers_depend_neither_on_processes_nor_on_how_many(file, finished, tmp_path, how):
    out = tmp_path / "out"
    done = process(DEQMCL, "sweep", file, "--out", out, *how)
    assert (done.returncode, done.stderr) == (0, "")
    assert tables(out) == tables(finished)
    assert trial_files(out) == trial_files(finished)


def test_jobs_timeout_and_executor_are_no_part_of_what_a_sweep_is(file, copy, ran):
    how = ("--jobs", "2", "--timeout", "600", "--executor", "in_threads:executor")
    assert sweep(file, copy, *how) == 0
    assert ran == []


def test_a_second_run_computes_nothing_and_writes_the_same_bytes(file, copy, ran):
    before = files(copy)
    assert sweep(file, copy) == 0
    assert ran == []
    after = files(copy)
    changed = {name for name in before | after if before.get(name) != after.get(name)}
    assert changed == {"report.html", "results.md"}  # another --out in the command


def test_only_what_is_missing_is_run_and_the_tables_come_back(file, finished, copy, ran):
    for path in [*sorted((copy / "trials").iterdir())[:2], copy / "results.csv"]:
        path.unlink()
    assert sweep(file, copy) == 0
    assert len(ran) == 2
    assert tables(copy) == tables(finished)


def edited(path):
    path.write_text(path.read_text().replace('"steps_done":204', '"steps_done":205'))


def torn(path):
    path.write_bytes(path.read_bytes()[:-20])


@pytest.mark.parametrize(("damage", "why"), [(edited, "checksum"), (torn, "torn")])
def test_a_damaged_trial_is_named_and_run_again_and_the_others_are_kept(
    file, finished, copy, ran, capsys, damage, why
):
    path = sorted((copy / "trials").iterdir())[1]
    damage(path)
    assert sweep(file, copy) == 0
    assert len(ran) == 1
    assert tables(copy) == tables(finished)
    (line,) = capsys.readouterr().err.splitlines()
    assert str(path) in line
    assert why in line


def test_stray_files_are_named_and_left_out(file, finished, copy, capsys):
    some = next((copy / "trials").glob("*.json"))
    (copy / "trials" / ".x.json.abc.tmp").write_text("{")
    (copy / "trials" / "ffff.json").write_bytes(some.read_bytes())
    assert sweep(file, copy) == 0
    said = capsys.readouterr().err
    assert ".x.json.abc.tmp is what an interrupted write has left; it is removed." in said
    assert "ffff.json is no trial of this sweep; it is left out." in said
    assert not (copy / "trials" / ".x.json.abc.tmp").exists()
    assert tables(copy) == tables(finished)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"trials": 3}, ["trials was 2 and is 3"]),
        ({"particles": 16}, ["params.particles was 15 and is 16"]),
        ({"more": "\n[world]\nnoise.drive = 0.5"}, ["world.noise.drive was null and is 0.5"]),
    ],
)
def test_another_sweep_in_the_folder_is_refused_with_all_differences(
    copy, tmp_path, capsys, changes, named
):
    before = files(copy)
    assert sweep(write_small(tmp_path, **changes), copy) == 2
    said = capsys.readouterr().err
    for words in named:
        assert words in said
    assert "--out" in said
    assert files(copy) == before


def test_changed_code_is_refused_and_named(file, copy, capsys, monkeypatch):
    monkeypatch.setattr(manifest, "code_digest", lambda: "other")
    monkeypatch.setattr(manifest, "versions", lambda: {"numpy": "0.1"})
    assert sweep(file, copy) == 2
    said = capsys.readouterr().err
    assert "code was" in said
    assert "libraries.numpy was" in said
    assert "libraries.numba was" in said


def test_a_changed_plug_in_is_refused_and_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(registry._FACTORIES, "mine", registry._FACTORIES["mcl"])
    for module in (plugins, manifest):
        monkeypatch.setattr(module, "source_digest", lambda name: "1" if name == "mine" else "")
    file, out = write_small(tmp_path, trials=1), tmp_path / "out"
    assert sweep(file, out, "--with", "mine") == 0
    assert {line["method"] for line in lines(out)} == {"mcl", "dead-reckoning", "mine"}
    for module in (plugins, manifest):
        monkeypatch.setattr(module, "source_digest", lambda name: "2" if name == "mine" else "")
    capsys.readouterr()
    assert sweep(file, out, "--with", "mine") == 2
    assert 'plug-ins.mine was "1" and is "2"' in capsys.readouterr().err


@pytest.mark.parametrize("content", ["", "[]", "{"])
def test_a_manifest_that_cannot_be_read_is_no_excuse_to_go_on(file, copy, capsys, content):
    (copy / "manifest.json").write_text(content)
    assert sweep(file, copy) == 2
    assert "manifest.json cannot be read" in capsys.readouterr().err


def test_the_folder_of_another_command_is_refused(file, tmp_path, capsys):
    (tmp_path / "manifest.json").write_text('{"command": ["deqmcl", "paper"]}')
    before = files(tmp_path)
    assert sweep(file, tmp_path) == 2
    assert "is not of a sweep" in capsys.readouterr().err
    assert files(tmp_path) == before


def test_failed_trials_are_said_kept_and_run_again_only_if_asked(
    tmp_path, monkeypatch, capsys, ran
):
    monkeypatch.setitem(registry._FACTORIES, "broken", broken)
    file, out = write_small(tmp_path), tmp_path / "out"
    for again in ((), (), ("--retry-failed",)):
        ran.clear()
        assert sweep(file, out, "--with", "broken", *again) == 3
        said = capsys.readouterr()
        assert said.out.startswith("small: 4 of 6 trials finished, 2 failed.\n")
        assert said.err == (
            "deqmcl: 2 of 6 trials failed, the rest is kept; first: broken, trial 0: "
            "ArithmeticError: broken (--debug shows where)\n"
        )
    assert [trial.localizer for trial in ran] == ["broken", "broken"]
    assert {line["method"] for line in lines(out)} == {"mcl", "dead-reckoning"}


class Leaving:
    """A localizer that ends the process it runs in."""

    def reset(self, prior, plan, rng):
        sys.exit()

    def update(self, ranges, action, plan):
        raise AssertionError("it was reset")


def test_a_localizer_that_calls_exit_fails_its_trials_and_the_sweep_goes_on(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setitem(registry._FACTORIES, "leaving", lambda robot: Leaving())
    file = write_small(tmp_path, trials=1)
    assert sweep(file, tmp_path / "out", "--with", "leaving") == 3
    said = capsys.readouterr()
    assert said.out.startswith("small: 2 of 3 trials finished, 1 failed.\n")
    assert "last: WorkerDiedError: it called exit(None) (--debug" in said.err


def test_a_localizer_that_calls_exit_when_it_is_made_ends_no_command_in_silence(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setitem(registry._FACTORIES, "leaving", lambda robot: sys.exit(0))
    file = write_small(tmp_path, trials=1)
    assert sweep(file, tmp_path / "out", "--with", "leaving") == 3
    assert capsys.readouterr().err == (
        "deqmcl: a plug-in called exit(0); finished trials are kept.\n"
    )


def test_fail_fast_stops_and_says_what_is_missing(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(registry._FACTORIES, "broken", broken)
    file, out = write_small(tmp_path), tmp_path / "out"
    assert sweep(file, out, "--with", "broken", "--fail-fast") == 3
    assert capsys.readouterr().out.startswith(
        "small: 2 of 6 trials finished, 1 failed, 3 missing.\n"
        "Not complete:\n"
        "  1 of 2: paper L=4 mcl particles=15\n"
        "  1 of 2: paper L=4 dead-reckoning\n"
        "  0 of 2: paper L=4 broken lag=4 particles=15\n"
    )


def test_a_plug_in_that_cannot_be_loaded_fails_its_trials_and_the_sweep_goes_on(tmp_path, capsys):
    file, out = write_small(tmp_path), tmp_path / "out"
    assert sweep(file, out, "--with", "no_such_module:Localizer") == 3
    said = capsys.readouterr()
    assert said.out.startswith("small: 4 of 6 trials finished, 2 failed.\n")
    assert "no_such_module:Localizer, trial 0" in said.err


def test_shards_into_one_folder_come_to_the_whole(file, finished, tmp_path, capsys):
    out = tmp_path / "out"
    assert sweep(file, out, "--shard", "1/3") == 0
    assert "2 of 4 trials finished, 2 missing." in capsys.readouterr().out
    assert sweep(file, out, "--shard", "2/3") == 0
    assert sweep(file, out, "--shard", "3/3") == 0
    assert "4 of 4 trials finished." in capsys.readouterr().out
    assert tables(out) == tables(finished)
    assert not list(out.glob(".lock*"))


def test_shards_into_folders_of_their_own_are_joined_by_copying_their_trials(
    file, finished, tmp_path, ran
):
    parts = [tmp_path / str(number) for number in (1, 2)]
    for number, part in enumerate(parts, 1):
        assert sweep(file, part, "--shard", f"{number}/2") == 0
    ran.clear()
    for part in parts:
        shutil.copytree(part, tmp_path / "all", dirs_exist_ok=True)
    assert sweep(file, tmp_path / "all") == 0
    assert ran == []
    assert tables(tmp_path / "all") == tables(finished)


def test_a_localizer_added_stands_in_the_tables_beside_the_others(file, tmp_path):
    out = tmp_path / "out"
    assert sweep(file, out, "--with", "mcl-map,mcl", "--with", "deq-mcl") == 0
    assert list(dict.fromkeys(line["method"] for line in lines(out))) == [
        *("mcl", "dead-reckoning", "mcl-map", "deq-mcl"),
    ]


@pytest.mark.parametrize("name", ["quick", "beta", "sensor", "disturbed", "guided", "study-plan"])
def test_a_sweep_can_be_told_from_its_manifest(tmp_path, name):
    sweep = SUITES[name]
    text = json.dumps(manifest.identity(sweep)["sweep"], allow_nan=False)
    assert sweep_of(unworded(json.loads(text)), title="") == sweep


def test_what_a_folder_holds_can_be_read_again_in_the_order_asked_for(finished):
    found = results_in(finished)
    assert (found.planned, found.missing, found.failures) == (4, 0, [])
    assert [(r["trial"]["localizer"], r["trial"]["trial"]) for r in found.records] == [
        *(("mcl", 0), ("mcl", 1), ("dead-reckoning", 0), ("dead-reckoning", 1)),
    ]
    assert found.title == "small"
    assert found.command[:2] == ["deqmcl", "sweep"]


def test_what_a_folder_holds_can_be_read_where_nothing_can_be_written(finished, monkeypatch):
    def refuse(path):
        raise InputError(f"{path} cannot be written to")

    monkeypatch.setattr(store, "writable_folder", refuse)
    assert len(results_in(finished).records) == 4


def test_results_of_other_code_can_be_read_and_infinity_is_a_number(tmp_path, monkeypatch):
    monkeypatch.setitem(registry._FACTORIES, "broken", broken)
    more = "\n[[vary]]\nparams.beta = [inf, 1.0]\n"
    file, out = write_small(tmp_path, trials=1, more=more), tmp_path / "out"
    assert sweep(file, out, "--with", "mcl-map,broken") == 3
    monkeypatch.setattr(plugins, "provenance", lambda: "other")
    (copy := out / "trials" / "note.json").write_text("{}")
    found = results_in(out)
    assert copy.exists()
    assert (len(found.records), len(found.failures), found.missing) == (4, 2, 0)
    betas = [r["trial"]["params"].get("beta") for r in found.records]
    assert betas == [None, None, "inf", 1.0]  # mcl and dead reckoning have none


def test_a_folder_of_another_schema_is_refused_and_not_told_as_empty(finished, monkeypatch):
    monkeypatch.setattr(store, "SCHEMA", store.SCHEMA + 1)
    words = rf"none of the 4 trials .* has schema {store.SCHEMA - 1}, not {store.SCHEMA}"
    with pytest.raises(InputError, match=words):
        results_in(finished)


def test_a_trial_is_stored_with_the_quality_at_every_step_if_its_localizer_gives_one(finished):
    for found in results_in(finished).records:
        if found["trial"]["localizer"] == "dead-reckoning":
            assert found["quality"] is None
        else:
            assert len(found["quality"]) == found["steps_done"]
            assert all(0 <= q <= 1 for q in found["quality"])


def test_guided_worlds_of_different_length_are_swept_and_reported_together(tmp_path):
    more = '\n[[vary]]\npreset = ["paper", "guided"]\n'
    out = tmp_path / "out"
    assert sweep(write_small(tmp_path, more=more), out) == 0
    assert exit_code("report", out) == 0
    trials = [row for row in lines(out) if row["offset"] == "0"]
    steps = {p: {r["steps_done"] for r in trials if r["preset"] == p} for p in ("paper", "guided")}
    assert steps["paper"] == {"204"}
    assert len(steps["guided"]) == 2
    assert all(float(row["error"]) > 0 for row in trials)


def test_a_disk_that_fills_up_is_said_in_one_line_and_the_sweep_goes_on_later(
    file, finished, tmp_path, monkeypatch, capsys
):
    really, writes = os.fsync, []

    def fill_up(handle):
        writes.append(handle)
        if len(writes) == 6:  # manifest, then timing and trial of each
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        really(handle)

    monkeypatch.setattr(os, "fsync", fill_up)
    out = tmp_path / "out"
    assert sweep(file, out) == 3
    assert capsys.readouterr().err.startswith(f"deqmcl: No space left on device: {out}/timings/")
    kept = trial_files(out)
    assert len(kept) == 2
    assert not [name for name in files(out) if "tmp" in name or "lock" in name]
    assert sweep(file, out) == 0
    assert kept.items() <= trial_files(out).items()
    assert tables(out) == tables(finished)


@pytest.mark.skipif(sys.platform == "win32", reason="no such locks there")
def test_two_sweeps_into_one_folder_are_one_too_many_and_a_dead_ones_lock_is_none(file, tmp_path):
    from benchmarks.sweeps.lock import locked
    from deqmcl_gym.validation import InputError

    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, tmp_path], stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout.readline() == "locked\n"
    done = process(DEQMCL, "sweep", file, "--out", tmp_path)
    assert done.returncode == 2
    assert f"another sweep (process {holder.pid}) is writing to {tmp_path}" in done.stderr
    with pytest.raises(InputError, match="another sweep"), locked(tmp_path, "1/2"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == [".lock"]
    holder.kill()
    holder.communicate()
    assert (tmp_path / ".lock").exists()  # stale
    assert sweep(file, tmp_path) == 0
    assert not (tmp_path / ".lock").exists()


HOLDER = """
import sys, time
from pathlib import Path
from benchmarks.sweeps.lock import locked
with locked(Path(sys.argv[1])):
    print("locked", flush=True)
    time.sleep(1000)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no such locks there")
def test_different_shards_share_a_folder_and_the_same_one_does_not(tmp_path):
    from benchmarks.sweeps.lock import locked
    from deqmcl_gym.validation import InputError

    with locked(tmp_path, "1/2"):
        with locked(tmp_path, "2/2"):
            assert (tmp_path / ".lock").exists()
        for shard in ("1/2", None):
            with pytest.raises(InputError, match="another sweep"), locked(tmp_path, shard):
                pass
    assert list(tmp_path.iterdir()) == []


def test_a_sweep_without_home_display_or_our_locale_gives_the_same_numbers(
    file, finished, tmp_path
):
    gone = ("HOME", "DISPLAY", "XDG_CACHE_HOME", "XDG_RUNTIME_DIR")
    bare = {name: value for name, value in os.environ.items() if name not in gone}
    bare |= {
        "HOME": "/proc/no-such-home",
        "LC_ALL": "de_DE.UTF-8",
        "LC_NUMERIC": "de_DE.UTF-8",
        "TZ": "Pacific/Chatham",
        "NUMBA_CACHE_DIR": "/proc/nowhere",
        "OMP_NUM_THREADS": "3",
    }
    done = process(DEQMCL, "sweep", file, "--out", tmp_path / "out", "--jobs", "1", env=bare)
    assert done.returncode == 0, done.stderr
    assert tables(tmp_path / "out") == tables(finished)


def test_a_family_writes_each_of_its_suites_into_a_folder_of_its_name(
    tmp_path, monkeypatch, capsys
):
    small = replace(SUITES["quick"], localizers=SUITES["quick"].localizers[-1:], trials=1)
    suites = {"one": small, "two": replace(small, seed=1)}
    monkeypatch.setattr(sweepfile, "SUITES", suites)
    monkeypatch.setattr(sweepfile, "FAMILIES", {"both": tuple(suites)})
    assert sweep("both", tmp_path / "out") == 0
    said = capsys.readouterr().out
    for name in suites:
        assert str(tmp_path / "out" / name) in said
        assert len(trial_files(tmp_path / "out" / name)) == 1


def test_combinations_that_are_the_same_are_said_and_run_once(tmp_path, capsys, ran):
    file = write_small(tmp_path, trials=1, more="\n[[vary]]\nparams.particles = [5, 6, 5]\n")
    assert sweep(file, tmp_path / "out") == 0
    assert "3 combinations equal others and were run once." in capsys.readouterr().out
    assert [(t.localizer, dict(t.params)) for t in ran] == [
        ("mcl", {"particles": 5}),
        ("dead-reckoning", {}),
        ("mcl", {"particles": 6}),
    ]


def test_without_the_extra_report_a_sweep_has_its_tables_and_names_the_pip_command(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(writing, "find_spec", lambda name: None)
    assert sweep(write_small(tmp_path, trials=1), tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert "Tables only: a report needs jinja2 and matplotlib" in said
    assert "pip install 'deqmcl-gym[report]'" in said
    assert not (tmp_path / "out" / "report.html").exists()
    assert tables(tmp_path / "out")
