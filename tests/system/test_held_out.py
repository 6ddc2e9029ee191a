"""``deqmcl sweep --held-out``: a seed that follows from what is handed in and a later value."""

import hashlib
import json

import pytest
from deqmcl_command import exit_code
from sweep_command import sweep, trial_files, write_small

from benchmarks.sweeps import manifest
from benchmarks.sweeps.held_out import HeldOut, submission
from benchmarks.sweeps.results import recorded_sweep

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
VALUE, ORIGIN = "8f3c20aa", "a beacon, round 7, 2026-11-24"


def held_out(file, out, value=VALUE, *more):
    return sweep(file, out, "--held-out", value, "--origin", ORIGIN, *more)


def handed_in(folder, offset=0.0):
    """Write a plug-in and a sweep file into a folder; return both."""
    folder.mkdir(exist_ok=True)
    plug_in = folder / "mine.py"
    plug_in.write_text(MINE.format(offset))
    return plug_in, write_small(folder, trials=1)


def seed_of(folder, offset=0.0, value=VALUE):
    plug_in, file = handed_in(folder, offset)
    assert held_out(file, folder / "out", value, "--with", f"{plug_in}:Mine") == 0
    return manifest.read(folder / "out").sweep["seed"]


def test_the_seed_follows_from_the_recorded_value_and_what_was_handed_in(tmp_path):
    seed = seed_of(tmp_path)
    made = manifest.read(tmp_path / "out")
    assert made.sweep["held_out"] == {"value": VALUE, "origin": ORIGIN}
    digest = submission(made.sweep, made.made)
    said = hashlib.sha256(f"{digest}\n{VALUE}".encode()).hexdigest()
    assert seed == int(said, 16) >> 204  # 256 - 13 * 4 bits
    trials = map(json.loads, trial_files(tmp_path / "out").values())
    assert {one["trial"]["seed"] for one in trials} == {seed}
    assert recorded_sweep(tmp_path / "out", made).canonical() == made.sweep


def test_the_public_run_and_the_held_out_run_are_of_one_submission(tmp_path):
    plug_in, file = handed_in(tmp_path)
    digests = []
    for name, more in (("a", ()), ("b", ("--held-out", VALUE, "--origin", ORIGIN))):
        assert sweep(file, tmp_path / name, "--with", f"{plug_in}:Mine", *more) == 0
        made = manifest.read(tmp_path / name)
        digests.append(submission(made.sweep, made.made))
    assert digests[0] == digests[1]


def test_another_value_or_plug_in_gives_another_seed_and_another_folder_the_same(tmp_path):
    first = seed_of(tmp_path / "a")
    assert seed_of(tmp_path / "b") == first
    others = seed_of(tmp_path / "c", value="8f3c20ab"), seed_of(tmp_path / "d", offset=1.0)
    assert len({first, *others}) == 3


def test_a_run_resumes_with_its_value_and_is_refused_with_another(tmp_path, refusal):
    _, file = handed_in(tmp_path)
    out = tmp_path / "out"
    assert held_out(file, out) == 0
    before = trial_files(out)
    assert held_out(file, out) == 0
    assert trial_files(out) == before
    words = 'held_out.value was "8f3c20aa" and is "other"'
    refusal(["sweep", file, "--out", out, "--held-out", "other", "--origin", ORIGIN], words)
    assert trial_files(out) == before


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("--held-out", "a"), "--held-out needs --origin"),
        (("--origin", "a"), "--origin is of --held-out"),
        (("--held-out", "a", "--origin", "b", "--seed", "1"), "leave out --seed"),
        (("--held-out", " a", "--origin", "b"), "--held-out is ' a'"),
        (("--held-out", "a", "--origin", ""), "--origin is ''"),
    ],
)
def test_options_that_would_let_somebody_choose_are_refused(given, words, tmp_path, refusal):
    refusal(["sweep", write_small(tmp_path), "--out", tmp_path / "out", *given], words)


def test_a_sweep_file_cannot_say_that_its_seed_is_held_out(tmp_path, refusal):
    file = write_small(tmp_path)
    text = file.read_text()
    file.write_text(f'held_out = {{ value = "a", origin = "b" }}\nseed = 1\n{text}')
    refusal(["sweep", file, "--out", tmp_path / "out"], "held_out")
    assert exit_code("sweep", file, "--out", tmp_path / "out") == 2


def test_a_value_gives_each_submission_a_seed_below_two_to_the_53():
    value = HeldOut(value=VALUE, origin=ORIGIN)
    seeds = {value.seed(f"{number:064x}") for number in range(1000)}
    assert len(seeds) == 1000
    assert max(seeds) < 2**53
