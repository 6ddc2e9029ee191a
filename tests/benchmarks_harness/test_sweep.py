"""Trials: each depends on itself alone, fails alone, and comes to a record or a reason."""

import math
import sys
from functools import partial

import numpy as np
import pytest
from deqmcl_command import files

import localizers
from benchmarks.execution.engines import Where
from benchmarks.sweeps.running import Options, run_missing
from benchmarks.sweeps.store import Store
from benchmarks.sweeps.suites import paper_suite
from benchmarks.trials import attempt
from benchmarks.trials.plugins import provenance_of
from benchmarks.trials.stage import Stage


def suite(localizers=("mcl", "dead-reckoning"), trials=2, lag=4, particles=15):
    return paper_suite(localizers=localizers, trials=trials, lag=lag, particles=particles)


def run(trials, out):
    """Run trials; return the store and the trials by key."""
    store, made = Store(out), provenance_of(trials)
    named = {made.key(trial): trial for trial in trials}
    run_missing(named, store, Options(where=Where(jobs=1), progress=False), made)
    return store, named


def reasons(store, keys):
    """Why trials failed; None of those that did not."""
    return [store.failure(key, trial) for key, trial in keys.items()]


def test_the_order_in_which_trials_run_changes_no_result(tmp_path):
    run(suite(), tmp_path / "a")
    run(suite()[::-1], tmp_path / "b")
    assert files(tmp_path / "a" / "trials") == files(tmp_path / "b" / "trials")


def test_all_methods_run_on_one_world_before_any_runs_on_the_next(tmp_path, ran):
    run(suite(trials=3), tmp_path)
    assert [trial.trial for trial in ran] == [0, 0, 1, 1, 2, 2]


def test_workers_that_loaded_other_code_than_the_sweep_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(attempt, "key_of", lambda trial: "another")
    (reason,) = set(reasons(*run(suite(), tmp_path)))
    assert "its worker loaded other code" in reason
    assert not (tmp_path / "trials").exists()


class Nowhere:
    """A belief that puts the robot nowhere at one offset, from step 4 on."""

    def __init__(self, offset, x):
        self.step, self._offset, self._x = 0, offset, x

    def reset(self, prior, plan, rng):
        return self

    def update(self, ranges, action, plan):
        self.step += 1
        return self

    def points(self, offset=0):
        x = self._x if offset == self._offset and self.step > 3 else 1.0
        return np.array([[x, 50.0, 0.0]]), np.ones(1)


def test_a_trial_of_no_steps_is_no_success(tmp_path, monkeypatch):
    trials = suite(["dead-reckoning"], trials=1)
    first = list(Stage.of(trials[0]).moments())[:1]
    monkeypatch.setattr(Stage, "moments", lambda _: first)
    assert reasons(*run(trials, tmp_path)) == ["it processed 0 steps"]


class Broken:
    """A localizer that fails in one of its calls."""

    def __init__(self, where):
        self._where = where
        self._fail("make")

    def reset(self, prior, plan, rng):
        self._fail("reset")
        return self

    def update(self, ranges, action, plan):
        self._fail("update")
        return None if self._where == "none" else self

    def points(self, offset=0):
        self._fail("points")
        return np.zeros((1, 3)), np.ones(1)

    def _fail(self, where):
        if self._where == where:
            raise ArithmeticError(f"broken in {where}")


CALLS = ("make", "reset", "update", "points")


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        *((partial(Broken, call), f"ArithmeticError: broken in {call}") for call in CALLS),
        (partial(Broken, "none"), "AttributeError"),
        (partial(sys.exit, 0), "SystemExit: 0"),
        (partial(Nowhere, 0, math.nan), "at offset 0 has poses that are not finite"),
        (partial(Nowhere, 2, 1e300), "at offset 2 has poses that are not finite or huge"),
    ],
)
def test_a_localizer_that_fails_fails_its_trials_with_the_reason_and_the_others_are_kept(
    tmp_path, monkeypatch, made, reason
):
    with localizers.registered("bad", lambda robot: made()):
        bad, good = reasons(*run(suite(["bad", "dead-reckoning"], trials=1), tmp_path))
    assert reason in bad
    assert good is None
    assert len(files(tmp_path / "trials")) == 1
