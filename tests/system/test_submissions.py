"""``deqmcl leaderboard --verify``: what a submission says of itself is checked, not believed."""

import json
import shutil

import numpy as np
import pytest
from deqmcl_command import exit_code, files, lines
from sweep_command import sweep, write_small

from benchmarks.sweeps import manifest, submissions
from benchmarks.sweeps.held_out import submission
from benchmarks.sweeps.results import recorded_sweep
from benchmarks.sweeps.store import _checksum, _json
from benchmarks.sweeps.sweepfile import read_sweep

MINE = """
import numpy as np
from localizers import PoseBelief
class Mine:
    def __init__(self, robot): pass
    def reset(self, prior, plan, rng):
        self.belief = PoseBelief(np.array(prior.mean))
        return self.belief
    def update(self, ranges, action, plan): return self.belief
"""
VALUE = "8f3c20aa"
HELD_OUT = ("--held-out", VALUE, "--origin", "a beacon, round 7, 2026-11-24")
ALL = ("--verify", "--share", "100%", "--jobs", "1")


@pytest.fixture(scope="module")
def handed_in(tmp_path_factory):
    """A suite's file, and a folder with a plug-in, a public and a held-out run.

    It is not where it was made: the path in its manifests is that of no file.
    """
    root = tmp_path_factory.mktemp("handed_in")
    there, file = root / "there", write_small(root)
    there.mkdir()
    plug_in = there / "mine.py"
    plug_in.write_text(MINE)
    for name, how in (("public", ()), ("held-out", HELD_OUT), ("chosen", ("--seed", "7"))):
        assert sweep(file, there / name, "--with", f"{plug_in}:Mine", *how) == 0
    return file, there.rename(root / "here")


@pytest.fixture
def mine(handed_in, tmp_path, monkeypatch):
    """A copy of the submission, to be spoilt; what it was run on is a suite."""
    file, folder = handed_in
    monkeypatch.setattr(submissions, "SUITES", {"small": read_sweep(file)})
    return shutil.copytree(folder, tmp_path / "mine")


def board(mine, *names, more=ALL):
    out = mine.parent / "board"
    return exit_code("leaderboard", *(mine / name for name in names), "--out", out, *more)


def labels(mine):
    return {row["label"] for row in lines(mine.parent / "board", "leaderboard.csv")}


def edit_trial(folder, method, *, sign):
    """Make an error of a method smaller, with the checksum that belongs to it or the old one."""
    for path in sorted((folder / "trials").iterdir()):
        held = json.loads(path.read_text())
        if held["trial"]["localizer"].endswith(method):
            held["scores"][0]["error"] /= 2
            checksum = held.pop("checksum")
            path.write_text(_json(held | {"checksum": _checksum(held) if sign else checksum}))
            return


def edit_manifest(folder, **said):
    path = folder / "manifest.json"
    content = json.loads(path.read_text())
    content["identity"]["sweep"] |= said
    path.write_text(json.dumps(content))


def hide_plug_in(folder):
    """Take the plug-in's digest from the manifest and from the names of the trials."""
    path = folder / "manifest.json"
    before, content = manifest.read(folder), json.loads(path.read_text())
    content["identity"]["plug-ins"] = {}
    path.write_text(json.dumps(content))
    for trial in recorded_sweep(folder, before).distinct():
        old, new = before.made.key(trial), manifest.read(folder).made.key(trial)
        for kind in ("trials", "timings"):
            file = folder / kind / f"{old}.json"
            held = json.loads(file.read_text()) | {"key": new}
            del held["checksum"]
            file.unlink()
            text = _json(held | {"checksum": _checksum(held)})
            (folder / kind / f"{new}.json").write_text(text)


@pytest.mark.parametrize(
    ("names", "more", "label"),
    [
        (("public",), (), "reported"),
        (("public", "held-out"), (), "reported"),
        (("public",), ALL, "re-run"),
        (("public", "held-out"), ALL, "re-run"),
        (("public", "held-out"), (*ALL, "--looked-up", VALUE), "re-run held-out"),
    ],
)
def test_a_label_is_earned_by_this_very_command(names, more, label, mine, capsys):
    before = files(mine)
    assert board(mine, *names, more=more) == 0
    assert labels(mine) == {label}
    assert files(mine) == before
    said = capsys.readouterr().out
    assert ("6 of 6 trials run again, none differs" in said) == ("--verify" in more)


def test_public_and_held_out_scores_and_their_gap_are_those_of_the_trials(mine):
    assert board(mine, "public", "held-out", more=()) == 0
    errors = {
        name: {
            method: np.array(
                [
                    float(row["error"])
                    for row in lines(mine / name)
                    if row["method"].endswith(method) and row["offset"] == "0"
                ]
            )
            for method in ("mcl", "Mine")
        }
        for name in ("public", "held-out")
    }
    (row,) = (r for r in lines(mine.parent / "board", "leaderboard.csv") if r["method"] == "Mine")
    apart = {name: own["Mine"] - own["mcl"] for name, own in errors.items()}
    for column, name in (("public", "public"), ("held_out", "held-out")):
        assert float(row[column]) == pytest.approx(errors[name]["Mine"].mean())
        assert float(row[f"{column}_diff"]) == pytest.approx(apart[name].mean())
    gap = apart["held-out"].mean() - apart["public"].mean()
    assert float(row["gap"]) == pytest.approx(gap)
    assert float(row["gap_low"]) <= gap <= float(row["gap_high"])
    text = (mine.parent / "board" / "leaderboard.md").read_text(encoding="utf-8")
    digest = submission(*(getattr(manifest.read(mine / "public"), n) for n in ("sweep", "made")))
    assert text.count(digest) == 2  # one submission, two runs
    assert f"{VALUE} (a beacon, round 7, 2026-11-24)" in text


TAMPERED = {
    "a result that was edited": (
        "public",
        lambda mine: edit_trial(mine / "public", "Mine", sign=False),
        "was changed after it was written: its checksum does not match",
    ),
    "a result that was edited, with a new checksum": (
        "public",
        lambda mine: edit_trial(mine / "public", "Mine", sign=True),
        "1 of 6 trials differ from those before; the first is",
    ),
    "a baseline that was made worse": (
        "public",
        lambda mine: edit_trial(mine / "public", "mcl", sign=True),
        "error at offset 0 was",
    ),
    "a trial that is missing": (
        "public",
        lambda mine: next((mine / "public" / "trials").iterdir()).unlink(),
        "1 of 6 trials were not run",
    ),
    "a public seed that was chosen": (
        "chosen",
        lambda mine: None,
        "it is of no suite, small being the nearest (seed was 0 and is 7)",
    ),
    "a held-out seed that was chosen": (
        "chosen",
        lambda mine: edit_manifest(
            mine / "chosen", held_out={"value": VALUE, "origin": "a beacon"}
        ),
        "its seed is 7, but ",
    ),
    "another public value than that of the run": (
        "held-out",
        lambda mine: edit_manifest(
            mine / "held-out", held_out={"value": "other", "origin": "a beacon"}
        ),
        "follows from the digest of what was handed in and the public value",
    ),
    "another file of the plug-in": (
        "public",
        lambda mine: (mine / "mine.py").write_text(MINE.replace("prior.mean)", "prior.mean) * 1")),
        "mine.py is not what made the results (SHA-256 ",
    ),
    "a plug-in that was not handed in": (
        "public",
        lambda mine: (mine / "mine.py").unlink(),
        "mine.py, which it was run with, is not here",
    ),
    "a plug-in of which the manifest says nothing": (
        "public",
        lambda mine: hide_plug_in(mine / "public"),
        "its manifest has no digest of mine.py",
    ),
    "a table that was edited": (
        "public",
        lambda mine: (mine / "public" / "results.csv").write_text("error\n0\n"),
        "results.csv",
    ),
    "fewer worlds than the suite has": (
        "public",
        lambda mine: edit_manifest(mine / "public", trials=1),
        "trials was 2 and is 1",
    ),
}


@pytest.mark.parametrize("what", TAMPERED)
def test_what_was_tampered_with_is_refused_in_a_sentence(what, mine, capsys):
    name, tamper, words = TAMPERED[what]
    tamper(mine)
    assert board(mine, *dict.fromkeys(("public", name))) == 1
    said = [
        line
        for line in capsys.readouterr().err.splitlines()
        if not line.endswith(("…", " left"))  # of long waits
    ]
    assert any(words in line for line in said), said
    assert all(line.startswith(f"deqmcl: {mine / name}: ") for line in said), said
    assert all(line.endswith(".") for line in said), said
    assert not (mine.parent / "board").exists()


def test_all_that_is_wrong_is_said_at_once(mine, capsys):
    next((mine / "public" / "trials").iterdir()).unlink()
    edit_manifest(mine / "held-out", held_out={"value": "other", "origin": "a beacon"})
    assert board(mine, "public", "held-out") == 1
    said = capsys.readouterr().err
    assert "trials were not run" in said
    assert "follows from the digest" in said


def test_code_of_which_nobody_has_the_digest_gives_no_held_out_seed(mine, monkeypatch, capsys):
    monkeypatch.setattr(submissions, "code_digest", lambda: "0" * 64)
    assert board(mine, "public", "held-out") == 1
    assert "verify it by the version of deqmcl-gym that made it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("names", "more", "words"),
    [
        (("held-out",), (), "is the held-out run of a submission that no other folder has"),
        (("public",), ("--looked-up", VALUE), "--looked-up is of --verify"),
        (("public",), ("--jobs", "1"), "--jobs is of --verify"),
        (("public",), (*ALL, "--looked-up", VALUE), "--looked-up is of held-out runs"),
        (("public", "held-out"), (*ALL, "--looked-up", "other"), "--looked-up"),
        (("public",), ("--verify", "--share", "2"), "--share is 2"),
    ],
)
def test_folders_and_options_that_do_not_go_together_are_refused(names, more, words, mine, refusal):
    folders = [mine / name for name in names]
    refusal(["leaderboard", *folders, "--out", mine.parent / "board", *more], words)
    assert not (mine.parent / "board").exists()


def test_two_held_out_runs_of_one_submission_are_refused(mine, refusal):
    shutil.copytree(mine / "held-out", mine / "again")
    folders = [mine / name for name in ("public", "held-out", "again")]
    refusal(["leaderboard", *folders], "are held-out runs of one submission")
