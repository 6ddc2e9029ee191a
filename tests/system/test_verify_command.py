"""``deqmcl verify``: results that survive a change of code."""

import json

import pytest
from deqmcl_command import exit_code, files, lose, records
from sweep_command import report, sweep, write_small

from benchmarks.sweeps import running
from benchmarks.sweeps.results import results_in
from benchmarks.sweeps.sweepfile import sweep_named

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
    """A plug-in, and a folder of results of it and of MCL on three worlds."""
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


def test_a_folder_whose_sample_agrees_goes_on_under_its_old_keys_with_missing_trials_only(
    mine, capsys
):
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


def test_what_is_interrupted_or_made_by_this_very_code_writes_nothing(finished, copy, monkeypatch):
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
