"""The folder of a sweep: what is run again or refused after failures, faults, new code; verify."""

import errno
import json
import math
import os
import random
import re
import shutil
import sys

import pytest
from deqmcl_command import exit_code, files, lines, lose, records, stored
from sweep_command import broken, report, sweep, tables, write_small

import localizers
from benchmarks.sweeps import running
from benchmarks.sweeps.results import results_in
from benchmarks.sweeps.store import Store
from benchmarks.sweeps.sweepfile import sweep_named
from benchmarks.trials import stage


def test_only_a_lost_or_damaged_trial_is_run_again(file, finished, copy, ran, capsys):
    before = records(copy)
    lose(copy, 1)
    path = copy / "trials.jsonl"
    path.write_text(path.read_text().replace('"steps_done":204', '"steps_done":203', 1))
    (copy / "results.csv").unlink()
    assert sweep(file, copy) == 0
    assert len(ran) == 2
    assert {**records(copy), **before} == before
    assert tables(copy) == tables(finished)
    said = "is not as it was written; it is left out."
    assert capsys.readouterr().err == f"deqmcl: {path}, line 1 {said}\n"


def test_another_sweep_in_the_folder_is_refused_with_all_differences(copy, tmp_path, refusal):
    before = files(copy)
    another = write_small(tmp_path, trials=1, particles=16, more="\n[world]\nnoise.drive = 0.5")
    differences = "trials was 2 and is 1", "particles was 15 and is 16", "was not set and is 0.5"
    refusal(["sweep", another, "--out", copy], *differences, "--out")
    assert files(copy) == before


def test_changed_code_is_refused_and_named(file, copy, refusal, monkeypatch):
    monkeypatch.setattr(stage, "code_digest", lambda: "other")
    monkeypatch.setattr(stage, "versions", lambda: {"numpy": "0.1"})
    changed = "code was", "libraries.numpy was", "libraries.numba was"
    refusal(["sweep", file, "--out", copy], *changed)


@localizers.registered("broken", broken)
def test_results_of_other_code_can_be_read_and_infinity_is_a_number(tmp_path, monkeypatch):
    more = "\n[[vary]]\nparams.beta = [inf, 1.0]\n"
    file, out = write_small(tmp_path, trials=1, more=more), tmp_path / "out"
    assert sweep(file, out, "--with", "mcl-map,broken") == 3
    monkeypatch.setattr(stage, "code_digest", lambda: "other")
    found = results_in(out)
    assert (len(found.records), len(found.failures), found.missing) == (4, 2, 0)
    betas = [dict(r.trial.params).get("beta") for r in found.records]
    assert betas == [None, None, math.inf, 1.0]  # mcl and dead reckoning have none


PLUG_IN = """
from localizers.methods.classical import DeadReckoning
from pathlib import Path
Path(__file__).with_name("ran").open("a").write("{}")
def L(robot): return DeadReckoning(robot)
"""


def test_a_report_takes_the_trials_of_the_manifests_own_code_alone_and_runs_none(tmp_path, capsys):
    plug_in, (one, two) = tmp_path / "p.py", (tmp_path / "one", tmp_path / "two")
    file = write_small(tmp_path, trials=1)
    for out, version in ((one, 1), (two, 2)):
        plug_in.write_text(PLUG_IN.format(version))
        assert sweep(file, out, "--with", f"{plug_in}:L") == 0
    before = (tmp_path / "ran").read_text()
    old = (one / "trials.jsonl").rename(one / "trials-old.jsonl")
    shutil.copytree(two, one, dirs_exist_ok=True)  # the old trials beside the new ones
    assert old.exists()
    capsys.readouterr()
    assert report(one) == 0
    assert tables(one) == tables(two)
    assert capsys.readouterr().err.count("is of other code, libraries or plug-ins") == 1
    assert (tmp_path / "ran").read_text() == before
    plug_in.unlink()
    assert report(one) == 0


PROJECT = {
    "mine.py": """
from localizers.template import MyLocalizer
class Mine(MyLocalizer):
    def reset(self, prior, plan, rng): return super().reset(prior, plan, rng)
    def update(self, *given): return super().update(*given)
""",
    "drivers.py": """
from benchmarks.agents import OpenLoop
class Own(OpenLoop):
    def plan_at_reset(self, info): return super().plan_at_reset(info)
    def act(self, belief, info): return super().act(belief, info)
""",
    "scans.py": """
from localizers import GaussianUniform
from localizers.models.scan import LidarScan
def made(floor_plan, lidar):
    return LidarScan(floor_plan=floor_plan, lidar=lidar, beam=GaussianUniform(sigma=100.0))
""",
    "hall.toml": 'base = "sharp"\nagent = "drivers.py"\n',
    "sweeps/all.toml": """
scenario = "../hall.toml"
localizers = ["mcl", "../mine.py"]
agent = "../drivers.py:Own"
assumed.scan.kind = "../scans.py:made"
trials = 1
params.particles = 15
""",
}


def written(folder):
    for name, text in PROJECT.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder / "sweeps" / "all.toml"


def test_a_project_with_plug_ins_goes_on_where_it_was_moved_to(tmp_path, monkeypatch, capsys):
    there, here = tmp_path / "there", tmp_path / "here"
    assert sweep(written(there), there / "out") == 0, capsys.readouterr().err
    before = tables(there / "out")
    assert not [text for text in before.values() if str(there).encode() in text]
    held = json.loads((there / "out" / "manifest.json").read_text())["identity"]
    assert str(there) not in json.dumps(held)
    names = ("mine.py:Mine", "drivers.py:Own", "scans.py:made", "hall.toml")
    assert held["plug-ins"].keys() == {f"../{name}" for name in names}
    there.rename(here)
    ended = stored(here / "out")
    assert sweep(here / "sweeps" / "all.toml", here / "out") == 0, capsys.readouterr().err
    assert report(here / "out") == 0
    assert stored(here / "out") == ended
    assert tables(here / "out") == before
    (here / "mine.py").write_text(PROJECT["mine.py"] + "# edited\n")
    monkeypatch.chdir(tmp_path)
    assert exit_code("verify", here / "out", "--jobs", "1") == 0, capsys.readouterr().err
    assert sweep(here / "sweeps" / "all.toml", here / "out") == 0, capsys.readouterr().err


@localizers.registered("broken", broken)
def test_failed_trials_are_said_kept_and_run_again_only_if_asked(tmp_path, capsys, ran):
    file = write_small(tmp_path, others=("broken",))
    out = tmp_path / "out"
    for again in ((), (), ("--retry-failed",)):
        ran.clear()
        assert sweep(file, out, *again) == 3
        said = capsys.readouterr()
        assert said.out.startswith("small: 4 of 6 trials finished, 2 failed.\n")
        assert re.sub(r"line \d+", "line N", said.err) == (
            "deqmcl: 2 of 6 trials failed, the rest is kept; first: broken, trial 0: "
            "ArithmeticError: broken (sweep_command.py, line N) (--debug shows where)\n"
        )
    assert [trial.localizer for trial in ran] == ["broken"] * 2
    assert {line["method"] for line in lines(out)} == {"mcl", "dead-reckoning"}


def test_after_a_full_disk_a_sweep_goes_on(file, finished, tmp_path, monkeypatch, capsys):
    really, out = Store._append, tmp_path / "out"

    def fill_up(store, *parts):
        if len(records(out)) == 2:
            store._file.write(b'{"key": "a')
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        really(store, *parts)

    with monkeypatch.context() as patch:
        patch.setattr(Store, "_append", fill_up)
        assert sweep(file, out) == 3
    assert capsys.readouterr().err.startswith("deqmcl: No space left on device")
    kept = records(out)
    assert len(kept) == 2
    assert sweep(file, out) == 0
    assert kept.items() <= records(out).items()
    assert tables(out) == tables(finished)


def test_what_keeps_the_pictures_away_does_not_keep_the_tables_away(tmp_path, monkeypatch):
    def undrawn(*_, **__):
        raise RuntimeError("no pictures today")

    monkeypatch.setattr("benchmarks.report.page.page_files", undrawn)
    file, out = write_small(tmp_path, trials=1), tmp_path / "out"
    assert exit_code("sweep", file, "--out", out, "--jobs", "1") == 3
    assert {"results.csv", "trials.csv"} < files(out).keys()


def flipped(path, dice):
    content = bytearray(path.read_bytes())
    content[dice.randrange(len(content))] ^= 1 << dice.randrange(8)
    path.write_bytes(content)


def spliced(path, dice):
    """Two processes wrote at once, as on a network disk without locks."""
    content = path.read_bytes()
    here, there = sorted(dice.randrange(len(content)) for _ in range(2))
    path.write_bytes(content[:there] + content[here:])


def replaced(make):
    def fault(path, dice):
        path.unlink()
        make(path)

    return fault


FAULTS = {
    "torn": lambda path, dice: os.truncate(path, dice.randrange(path.stat().st_size)),
    "deleted": lambda path, dice: path.unlink(),
    "doubled": lambda path, dice: path.write_bytes(2 * path.read_bytes()),
    "flipped": flipped,
    "spliced": spliced,
    "zeroed": lambda path, dice: path.write_bytes(path.read_bytes()[:1000] + bytes(1000)),
    "nested": lambda path, dice: path.write_text("[" * 10**5),
    "a folder": replaced(lambda path: path.mkdir()),
    "a pipe": replaced(os.mkfifo),
}


def looked_at(code, said, done):
    assert code in (0, 2), (done, said)
    *notes, last = said.err.splitlines() or [""]
    notes += [last] if code == 0 and last else []
    assert all(note.startswith("deqmcl: ") and "left out" in note for note in notes), (done, notes)
    if code == 2:
        assert last.startswith("deqmcl: "), (done, last)
    return code == 0


def faulty(file, finished, folder, dice, capsys):
    """Spoil a file or two of a copy of a folder, report it, run the sweep again."""
    shutil.copytree(finished, folder)
    done = []
    for name in dice.choices(["trials.jsonl", "trials.jsonl", "manifest.json"], k=2):
        kind = dice.choice([*FAULTS])
        if (folder / name).is_file() and (folder / name).stat().st_size:
            FAULTS[kind](folder / name, dice)
            done.append((kind, name))
    capsys.readouterr()
    looked_at(report(folder), capsys.readouterr(), done)
    before = stored(folder) if (folder / "trials.jsonl").is_file() else {}
    if looked_at(sweep(file, folder), capsys.readouterr(), done):
        assert tables(folder) == tables(finished), done
    elif before:
        assert stored(folder) == before, done
    shutil.rmtree(folder)


@pytest.mark.skipif(sys.platform != "linux", reason="makes pipes and links")
@pytest.mark.parametrize(("seed", "cases"), [(0, 15), pytest.param(1, 300, marks=pytest.mark.slow)])
def test_a_spoilt_folder_ends_in_the_same_tables_or_a_sentence(
    file, finished, tmp_path, capsys, seed, cases
):
    dice = random.Random(seed)
    for number in range(cases):
        faulty(file, finished, tmp_path / str(number), dice, capsys)


MINE = """
import numpy as np
from localizers import PoseBelief
class Mine:
    def __init__(self, robot): pass
    def reset(self, prior, plan, rng):
        self.belief = PoseBelief(np.array(prior.mean) + {0})
        return self.belief
    def update(self, ranges, action, plan): return self.belief
"""


@pytest.fixture
def mine(tmp_path):
    plug_in = tmp_path / "mine.py"
    plug_in.write_text(MINE.format(0.0))
    file = write_small(tmp_path, trials=3)
    assert sweep(file, tmp_path / "out", "--with", f"{plug_in}:Mine") == 0
    return plug_in, file, tmp_path / "out"


def verify(out):
    return exit_code("verify", out, "--jobs", "1")


def edit(plug_in, offset):
    """Write the plug-in anew: its digest changes, and unless it is 0.0 its estimates do."""
    plug_in.write_text(MINE.format(offset) + "# edited\n")


def verified(out):
    return json.loads((out / "manifest.json").read_text()).get("verified", [])


def test_a_folder_whose_sample_agrees_goes_on_under_its_old_keys(mine, capsys):
    plug_in, file, out = mine
    before = records(out)
    edit(plug_in, 0.0)
    assert sweep(file, out, "--with", f"{plug_in}:Mine") == 2
    assert f"deqmcl verify {out}" in capsys.readouterr().err
    assert verify(out) == 0
    assert "on 4 of 9 trials; none differs" in capsys.readouterr().out
    (entry,) = verified(out)
    assert set(entry["verified"]) < before.keys()
    lose(out, 0, 1)
    kept = (out / "trials.jsonl").read_text()
    assert sweep(file, out, "--with", f"{plug_in}:Mine", "--with", "ekf") == 0
    assert (out / "trials.jsonl").read_text().startswith(kept)
    assert before.items() <= records(out).items()
    assert len(results_in(out).records) == 12
    assert report(out) == 0
    assert results_in(out).made_by.endswith("on 4 of 9 trials.")
    assert verified(out) == [entry]
    plug_in.write_text(MINE.format(0.0))  # as it was, which made the folder
    assert sweep(file, out, "--with", f"{plug_in}:Mine", "--with", "ekf") == 0


def test_a_number_that_differs_is_found_and_named_and_the_folder_is_as_it_was(mine, capsys):
    plug_in, _, out = mine
    before = files(out)
    edit(plug_in, 1.0)
    assert verify(out) == 1
    said = capsys.readouterr().err
    assert "2 of 4 trials differ" in said or "1 of 4 trials differ" in said
    assert "mine.py:Mine, world 0, filter seed 0: error at offset 0 was" in said
    assert files(out) == before


def test_what_is_interrupted_or_made_by_this_very_code_writes_nothing(copy, monkeypatch):
    before = files(copy)
    assert verify(copy) == 0
    assert files(copy) == before

    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "outcomes", stopped)
    assert verify(copy) == 130
    assert files(copy) == before


def test_a_sample_has_the_first_world_of_each_setting_and_method_and_one_in_a_hundred_by_digest():
    sweep = sweep_named("noise")
    trials = {trial.key(""): trial for trial in sweep.distinct()}
    drawn = [set(running.sample(trials, code)) for code in ("a", "b")]
    first = {trial.key("") for trial in sweep.cells()}
    assert first == drawn[0] & drawn[1] & first
    others = len(trials) - len(first)
    assert [len(keys - first) for keys in drawn] == [-(-others // 100)] * 2
    assert drawn[0] != drawn[1]
