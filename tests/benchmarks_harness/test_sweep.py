"""Trials: each depends on itself alone, fails alone, and comes to a record or a reason."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from deqmcl_command import records
from refusals import refused

import localizers
from benchmarks.console import FailedWarning
from benchmarks.execution.engines import Where
from benchmarks.report.page import write_report
from benchmarks.setup.overrides import Named
from benchmarks.sweeps import Sweep
from benchmarks.sweeps.results import results_in
from benchmarks.sweeps.running import Options, begun, run_missing
from benchmarks.sweeps.store import writing
from benchmarks.sweeps.sweepfile import paper_sweep
from benchmarks.trials import Method, stage
from benchmarks.trials.stage import Stage, provenance_of

CALLS = ("__init__", "reset", "update", "points")
ONE_JOB = Where(jobs=1)


def suite(localizers=("mcl", "dead-reckoning"), trials=2):
    return paper_sweep(localizers=localizers, trials=trials, lag=4, particles=15).distinct()


def run(trials, out):
    made = provenance_of(trials)
    named = {made.key(trial): trial for trial in trials}
    with writing(out) as store:
        run_missing(named, store, Options(where=Where(jobs=1), progress=False), made)
    return store, named


def reasons(store, keys):
    return [store.failure(key) for key in keys]


def test_all_methods_run_on_one_world_before_any_runs_on_the_next(tmp_path, ran):
    run(suite(trials=3), tmp_path)
    assert [trial.trial for trial in ran] == [0, 0, 1, 1, 2, 2]


def test_workers_that_loaded_other_code_than_the_sweep_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(stage, "key_of", lambda trial: "another")
    (reason,) = set(reasons(*run(suite(), tmp_path)))
    assert "its worker loaded other code" in reason
    assert records(tmp_path) == {}


def test_a_trial_of_no_steps_is_no_success(tmp_path, monkeypatch):
    trials = suite(["dead-reckoning"], trials=1)
    first = list(Stage.of(trials[0]).moments())[:1]
    monkeypatch.setattr(Stage, "moments", lambda *_: first)
    assert reasons(*run(trials, tmp_path)) == ["it processed 0 steps"]


class Sure:
    POSE = (1.0, 2.0, 0.0)

    def __init__(self, robot):
        pass

    def reset(self, prior, plan, rng):
        return localizers.PoseBelief(self.POSE)

    def update(self, ranges, action, plan):
        return localizers.PoseBelief(self.POSE)


def broken(call, **methods):
    """A localizer that is its own belief, and fails in one of its calls."""

    def fail(*_):
        raise ArithmeticError(f"broken in {call}")

    itself = {name: lambda self, *_: self for name in CALLS[1:3]}
    points = {"points": lambda self, offset=0: (np.zeros((1, 3)), np.ones(1)), call: fail}
    return type("Broken", (Sure,), itself | points | methods)


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        *((broken(call), f"ArithmeticError: broken in {call}") for call in CALLS),
        (broken("none", update=lambda *_: None), "update (step 1) returned NoneType"),
        (lambda robot: sys.exit(0), "SystemExit: 0"),
    ],
)
def test_a_localizer_that_fails_fails_its_own_trials_alone(tmp_path, made, reason):
    with localizers.registered("bad", made):
        bad, good = reasons(*run(suite(["bad", "dead-reckoning"], trials=1), tmp_path))
    assert reason in bad
    assert good is None
    assert len(records(tmp_path)) == 1


def swept(out, names=("sure",), where=ONE_JOB, **said):
    methods = tuple(Method(name=name) for name in names)
    sweep = Sweep(title="t", localizers=methods, trials=2, params={"particles": 15}, **said)
    with begun(sweep, out, Options(where=where, progress=False), command=[]) as running:
        return running.results()


def errors(results):
    return results.table.loc[results.table["offset"] == 0, "error"].tolist()


def test_a_class_changed_in_memory_is_not_taken_for_that_of_the_results(tmp_path, monkeypatch):
    with localizers.registered("sure", Sure):
        (own,) = errors(swept(tmp_path))
        assert [own] == errors(swept(tmp_path))
        monkeypatch.setattr(Sure, "POSE", (300.0, 2.0, 0.0))
        with refused("plug-ins.sure was", "new --out"):
            swept(tmp_path)
        assert errors(swept(tmp_path / "new")) != [own]


def test_results_of_what_cannot_be_read_are_not_gone_on_with(tmp_path, monkeypatch):
    monkeypatch.setattr(Sure, "SOURCE", (one for one in ()), raising=False)
    monkeypatch.setattr(Sure, "__module__", "a_cell")
    with localizers.registered("sure", Sure):
        assert swept(tmp_path).failures == []
        with refused("results of 'sure'", "cannot be read", "file.py"):
            swept(tmp_path)


def test_what_cannot_go_along_is_refused_before_anything_runs(tmp_path):
    unsendable = (one for one in ())
    with (
        localizers.registered("sure", lambda robot: [Sure(robot), unsendable][0]),
        refused("'sure' cannot be sent to other processes", "jobs=1", "file.py:NAME"),
    ):
        swept(tmp_path / "new", where=Where(jobs=2))
    assert records(tmp_path / "new") == {}


def test_trials_that_fail_are_told_in_python_too(tmp_path):
    told = pytest.warns(FailedWarning, match="2 of 4 trials failed.*broken in reset")
    with localizers.registered("bad", broken("reset")), told:
        swept(tmp_path, ("dead-reckoning", "bad"))


class Nearly(Sure):
    """Believes in two poses, whose weights add up to nearly 1."""

    OFF = 0.0

    def update(self, ranges, action, plan):
        return self

    def points(self, offset=0):
        poses = np.array([self.POSE, (300.0, 290.0, 0.0)])
        return None if offset else (poses, np.array([0.5, 0.5 + self.OFF]))


@pytest.mark.parametrize(
    ("agent", "off", "fails"), [("wall-follower", 2e-3, True), ("greedy", 9e-4, False)]
)
def test_weights_add_up_to_1_or_not_whoever_drives(tmp_path, monkeypatch, agent, off, fails):
    monkeypatch.setattr(Nearly, "OFF", off)
    (trial,) = suite(["mcl"], trials=1)
    there = {"scenario": "lost", "localizer": "nearly", "params": {}, "lag": 0}
    lost = replace(trial, **there, agent=Named(agent), world={"horizon": 10})
    with localizers.registered("nearly", Nearly):
        (reason,) = reasons(*run([lost], tmp_path))
    assert ("add up to 1" in str(reason)) == fails
    assert (reason is None) == (not fails)


def test_names_and_paths_are_taken_as_text_and_what_is_no_name_is_refused(tmp_path):
    how = Options(where=ONE_JOB, progress=False)
    sweep = Sweep(title="t", localizers=["mcl"], agent="open-loop", trials=1, lag=4)
    assert sweep.localizers == (Method(name="mcl"),)
    with begun(sweep, str(tmp_path / "out"), how, command=[]) as running:
        results = running.results()
    assert results_in(str(tmp_path / "out")).records == results.records
    assert write_report(str(tmp_path / "out"), results)
    with refused("name of a localizer or agent is", "Sure", "registered"):
        Sweep(title="t", localizers=[Sure])
    with refused("localizers is 'mcl'", "a list"):
        Sweep(title="t", localizers="mcl")
    with refused("the results are", "folder first"):
        write_report(results, tmp_path)
