"""Trials: each is run once, depends on itself alone, and fails alone."""

import math
import re

import numpy as np
import pytest

from benchmarks.execution.engines import Where
from benchmarks.sweeps.running import Options, TrialsFailedError, run_missing, run_trials
from benchmarks.sweeps.store import Store
from benchmarks.sweeps.suites import paper_suite
from benchmarks.tables.comparison import results_csv
from benchmarks.tables.panels import comparisons
from benchmarks.tables.table_1 import trials_csv
from benchmarks.trials import attempt, plugins
from benchmarks.trials.episode import trial_moments
from benchmarks.trials.spec import Trial
from localizers.naming import registry


def suite(localizers=("mcl", "dead-reckoning"), trials=2, lag=4, particles=15):
    return paper_suite(
        scenario="paper", localizers=localizers, trials=trials, seed=0, lag=lag, particles=particles
    )


def run(trials, out, jobs=1):
    return run_trials(trials, Store(out), jobs=jobs, progress=False)


def here(**how):
    return Options(where=Where(jobs=1), progress=False, **how)


def results(out):
    """Contents of the files of finished trials, by name."""
    return {path.name: path.read_bytes() for path in (out / "trials").iterdir()}


@pytest.fixture
def runs(monkeypatch):
    """The trials that were run rather than found."""
    ran = []

    def noted(trial: Trial, room):
        ran.append(trial)
        return trial_moments(trial, room)

    monkeypatch.setattr(attempt, "trial_moments", noted)
    return ran


def test_a_finished_sweep_is_not_run_again_and_gives_the_same_tables(tmp_path, runs):
    first = run(suite(), tmp_path)
    assert sorted(runs, key=suite().index) == suite()
    runs.clear()
    written = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    again = run(suite(), tmp_path)
    assert runs == []
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")} == written
    assert again == first
    assert results_csv(comparisons(again)) == results_csv(comparisons(first))
    assert trials_csv(again) == trials_csv(first)


@pytest.mark.parametrize("damage", [lambda p: p.unlink(), lambda p: p.write_bytes(b'{"schema')])
def test_only_a_lost_or_damaged_trial_is_run_again_and_comes_back_byte_for_byte(
    tmp_path, runs, damage
):
    run(suite(), tmp_path)
    before = results(tmp_path)
    lost = suite()[1]
    damage(tmp_path / "trials" / f"{plugins.key_of(lost)}.json")
    runs.clear()
    run(suite(), tmp_path)
    assert runs == [lost]
    assert results(tmp_path) == before


def test_a_larger_sweep_runs_only_what_is_new(tmp_path, runs):
    run(suite(), tmp_path)
    runs.clear()
    records = run(suite(trials=3), tmp_path)
    assert [(trial.localizer, trial.trial) for trial in runs] == [("mcl", 2), ("dead-reckoning", 2)]
    assert len(records) == 6


def test_a_changed_parameter_is_another_trial(tmp_path, runs):
    run(suite(["mcl"], trials=1), tmp_path)
    run(suite(["mcl"], trials=1, particles=16), tmp_path)
    assert [dict(trial.params) for trial in runs] == [{"particles": 15}, {"particles": 16}]
    assert len(results(tmp_path)) == 2


def test_results_of_other_code_are_not_taken_for_ours(tmp_path, runs, monkeypatch):
    run(suite(["mcl"], trials=1), tmp_path)
    monkeypatch.setattr(plugins, "provenance", lambda: "other code")
    run(suite(["mcl"], trials=1), tmp_path)
    assert len(runs) == 2


def test_the_order_in_which_trials_run_changes_no_result(tmp_path):
    forward = run(suite(), tmp_path / "a")
    backward = run(suite()[::-1], tmp_path / "b")
    assert results(tmp_path / "a") == results(tmp_path / "b")
    for record in [*forward, *backward]:
        record.pop("seconds")
    assert backward[::-1] == forward


def test_records_come_in_the_order_asked_for(tmp_path):
    trials = suite()[::-1]
    assert [record["trial"] for record in run(trials, tmp_path)] == [t.canonical() for t in trials]


def test_more_workers_than_trials_are_no_trouble_and_no_trials_are_no_work(tmp_path):
    assert len(run(suite(["dead-reckoning"], trials=1), tmp_path, jobs=64)) == 1
    assert run([], tmp_path, jobs=2) == []


def test_workers_that_loaded_other_code_than_the_sweep_are_refused(tmp_path, monkeypatch):
    keys = {trial: plugins.key_of(trial) for trial in suite()}
    monkeypatch.setattr(attempt, "key_of", lambda trial: "another")
    store = Store(tmp_path)
    run_missing({key: trial for trial, key in keys.items()}, store, here())
    reasons = {store.failure(key)["reason"] for key in keys.values()}
    assert len(reasons) == 1
    assert "its worker loaded other code" in reasons.pop()
    assert not (tmp_path / "trials").exists()


def test_results_that_vanish_during_a_sweep_are_missed(tmp_path, monkeypatch):
    monkeypatch.setattr(Store, "put", lambda *_: None)
    with pytest.raises(TrialsFailedError, match="2 of 2 finished trials have gone"):
        run(suite(["dead-reckoning"]), tmp_path)


def test_all_methods_run_on_one_world_before_any_runs_on_the_next(tmp_path, runs):
    run(suite(trials=3), tmp_path)
    assert [trial.trial for trial in runs] == [0, 0, 1, 1, 2, 2]


def test_a_failed_trial_is_run_again_only_if_asked(tmp_path, monkeypatch, runs):
    monkeypatch.setitem(registry._FACTORIES, "broken", lambda robot: Broken("reset"))
    trials = {plugins.key_of(t): t for t in suite(["broken", "dead-reckoning"])}
    store = Store(tmp_path)
    run_missing(trials, store, here())
    assert len(runs) == 4
    run_missing(trials, store, here())
    assert len(runs) == 4
    run_missing(trials, store, here(retry_failed=True))
    assert [trial.localizer for trial in runs[4:]] == ["broken"] * 2


def test_a_trial_that_succeeds_at_last_is_failed_no_more(tmp_path):
    store = Store(tmp_path)
    (trial,) = suite(["dead-reckoning"], trials=1)
    key = plugins.key_of(trial)
    store.put_failure(key, trial.canonical(), "bad luck")
    run_missing({key: trial}, store, here(retry_failed=True))
    assert store.failure(key) is None
    assert store.get(key) is not None


def test_fail_fast_stops_at_the_first_failure(tmp_path, monkeypatch, runs):
    monkeypatch.setitem(registry._FACTORIES, "broken", lambda robot: Broken("reset"))
    trials = {plugins.key_of(t): t for t in suite(["dead-reckoning", "broken"], trials=5)}
    run_missing(trials, Store(tmp_path), here(fail_fast=True))
    assert [trial.localizer for trial in runs] == ["dead-reckoning", "broken"]


class Nowhere:
    """A belief whose points are not finite from a step on."""

    def __init__(self):
        self.step = 0

    def reset(self, prior, plan, rng):
        return self

    def update(self, ranges, action, plan):
        self.step += 1
        return self

    def points(self, offset=0):
        if offset:
            return None
        return np.array([[math.nan if self.step > 3 else 1.0, 50, 0]]), np.ones(1)


def test_a_belief_that_is_not_finite_fails_the_trial_and_names_the_state(tmp_path, monkeypatch):
    monkeypatch.setitem(registry._FACTORIES, "nowhere", lambda robot: Nowhere())
    with pytest.raises(TrialsFailedError, match="belief of state 4 at offset 0 is not finite"):
        run(suite(["nowhere"], trials=1), tmp_path)


class NowhereBetween(Nowhere):
    """A belief whose error is finite where it is scored, and not between: in the profile alone."""

    def points(self, offset=0):
        x = 1.0 if offset in (-4, 0, 4) else 1e300  # its square is infinite
        return np.array([[x, 50, 0]]), np.ones(1)


def between():
    """One trial that gives no record that can be stored, and one that does."""
    return {plugins.key_of(t): t for t in suite(["nowhere-between", "dead-reckoning"], trials=1)}


def test_a_record_that_is_not_finite_fails_its_trial_and_the_others_are_kept(
    tmp_path, monkeypatch, runs
):
    monkeypatch.setitem(registry._FACTORIES, "nowhere-between", lambda robot: NowhereBetween())
    (bad, good), store = between(), Store(tmp_path)
    run_missing(between(), store, here())
    assert store.failure(bad)["reason"] == "its record holds a number that is not finite"
    assert store.get(good) is not None
    runs.clear()
    run_missing(between(), store, here())
    assert runs == []


def test_fail_fast_stops_at_a_record_that_is_not_finite_too(tmp_path, monkeypatch, runs):
    monkeypatch.setitem(registry._FACTORIES, "nowhere-between", lambda robot: NowhereBetween())
    run_missing(between(), Store(tmp_path), here(fail_fast=True))
    assert [trial.localizer for trial in runs] == ["nowhere-between"]


def test_a_trial_of_no_steps_is_no_success(tmp_path, monkeypatch):
    trial = Trial(
        scenario="paper",
        localizer="dead-reckoning",
        params=(),
        lag=0,
        seed=0,
        trial=0,
    )
    first = list(trial_moments(trial))[:1]
    monkeypatch.setattr(attempt, "trial_moments", lambda *_: first)
    with pytest.raises(TrialsFailedError, match="it processed 0 steps"):
        run([trial], tmp_path)


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

    def _fail(self, where):
        if self._where == where:
            raise ArithmeticError(f"broken in {where}")


@pytest.mark.parametrize("where", ["make", "reset", "update", "points", "none"])
def test_a_localizer_that_fails_fails_its_trials_with_the_reason_and_the_others_are_kept(
    tmp_path, monkeypatch, runs, where
):
    monkeypatch.setitem(registry._FACTORIES, "broken", lambda robot: Broken(where))
    trials = suite(["broken", "dead-reckoning"])
    reason = "AttributeError" if where == "none" else f"ArithmeticError: broken in {where}"
    with pytest.raises(TrialsFailedError, match="2 of 4 trials failed") as caught:
        run(trials, tmp_path)
    assert re.search(f"broken, trial 0: {reason}", str(caught.value))
    assert len(results(tmp_path)) == 2
    runs.clear()
    assert len(run(suite(["dead-reckoning"]), tmp_path)) == 2
    assert runs == []  # kept


def test_what_a_method_has_no_use_for_does_not_reach_it(tmp_path):
    rows = {lag: comparisons(run(suite(["mcl"], lag=lag), tmp_path)) for lag in (0, 5, 20, 300)}
    assert all(row.offset == 0 for own in rows.values() for row in own)
    kept = [
        {k: v for k, v in row.scores.items() if k != "error_window"} for (row,) in rows.values()
    ]
    assert all(row == kept[0] for row in kept)
    window = [row.scores["error_window"].mean for (row,) in rows.values()]
    assert window[0] == rows[0][0].error.mean
    assert len({*window[:3]}) == 3
    assert math.isnan(window[3])


def test_every_trial_tells_how_many_steps_and_scans_it_saw(tmp_path):
    for record in run(suite(trials=1), tmp_path):
        assert record["steps_done"] == record["scans_used"] == 204  # the paper scenario's lap
