"""The loop that keeps an engine busy, on engines that misbehave as told."""

import sys
from collections import Counter
from concurrent.futures import BrokenExecutor, Future
from dataclasses import dataclass, field

import pytest

from benchmarks.execution import engines
from benchmarks.execution.engines import TRIES, Engine, Where, outcomes
from benchmarks.execution.processes import TimedOutError, WorkerDiedError
from benchmarks.sweeps.sweepfile import paper_sweep
from benchmarks.trials.stage import Outcome

DONE = Outcome(record={}, seconds=1.0)


@dataclass
class Scripted:
    """Answers each trial with the next entry of its script; ``None`` never answers."""

    scripts: dict = field(default_factory=dict)
    submitted: list = field(default_factory=list)

    def submit(self, trial, key):
        self.submitted.append(key)
        script = self.scripts.get(key, [DONE])
        answer = script[min(Counter(self.submitted)[key], len(script)) - 1]
        future = Future()
        if isinstance(answer, BaseException):
            future.set_exception(answer)
        elif answer is not None:
            future.set_result(answer)
        return future


def run(scripts, keys="abc", slots=2, timeout=None):
    executor = Scripted(scripts)
    engine = Engine(submit=executor.submit, slots=slots, timeout=timeout)
    return dict(outcomes([(key, f"trial {key}") for key in keys], engine)), executor


@pytest.mark.parametrize("losses", range(TRIES))
def test_a_trial_whose_worker_dies_is_tried_again_and_the_others_are_not(losses):
    found, executor = run({"b": [WorkerDiedError("gone")] * losses + [DONE]})
    assert found == dict.fromkeys("abc", DONE)
    assert Counter(executor.submitted) == {"a": 1, "b": 1 + losses, "c": 1}


@pytest.mark.parametrize(
    ("loss", "said"),
    [
        (WorkerDiedError("died by signal 11"), "WorkerDiedError: died by signal 11"),
        (SystemExit(0), "SystemExit: 0"),
    ],
)
def test_a_trial_that_keeps_ending_its_workers_fails_with_the_reason_after_three_tries(loss, said):
    found, executor = run({"b": [loss]})
    assert Counter(executor.submitted) == {"a": 1, "b": TRIES, "c": 1}
    assert found["b"] == Outcome(reason=f"lost 3 times by its worker; last: {said}")
    assert found["a"] == found["c"] == DONE


def test_a_trial_that_would_end_this_process_is_lost_like_a_dead_worker(monkeypatch):
    monkeypatch.setattr(engines, "attempt", lambda trial, key: sys.exit(7))
    (trial,) = paper_sweep(localizers=["mcl"], trials=1).distinct()
    with (
        Where(jobs=1).engine([trial]) as engine,
        pytest.raises(WorkerDiedError, match=r"it called exit\(7\)"),
    ):
        engine.submit(trial, "a").result()


def test_a_trial_that_timed_out_is_not_tried_again():
    found, executor = run({"b": [TimedOutError("no result within 5 s")]})
    assert Counter(executor.submitted)["b"] == 1
    assert found["b"] == Outcome(reason="no result within 5 s")


def test_an_engine_that_never_answers_is_given_up_after_the_timeout_and_the_rest_goes_on():
    found, _ = run({"b": [None]}, timeout=0.05)
    assert found["a"] == found["c"] == DONE
    assert found["b"] == Outcome(reason="no result within 0.05 s")


def test_a_hung_trial_keeps_its_slot_and_an_engine_that_hangs_in_all_ends_the_sweep():
    executor = Scripted({"a": [None], "b": [None]})
    engine = Engine(submit=executor.submit, slots=2, timeout=0.05)
    found = []
    with pytest.raises(RuntimeError, match="all 2 workers hang"):
        found += outcomes([(key, key) for key in "abcd"], engine)
    assert executor.submitted == ["a", "b"]


def test_a_broken_engine_ends_the_sweep():
    with pytest.raises(RuntimeError, match=r"the executor broke \(all is lost\)"):
        run({"b": [BrokenExecutor("all is lost")]})


def test_an_engine_that_is_lost_without_a_word_ends_the_sweep(monkeypatch):
    monkeypatch.setattr(engines, "_LOOK_SECONDS", 0.01)
    engine = Engine(submit=Scripted({"a": [None]}).submit, slots=2, lost=lambda: "it is gone")
    with pytest.raises(RuntimeError, match="it is gone; finished trials are kept"):
        list(outcomes([("a", "a")], engine))


def test_no_more_trials_are_in_flight_than_there_are_slots():
    executor = Scripted({key: [None] for key in "abcdef"})
    engine = Engine(submit=executor.submit, slots=3, timeout=0.05)
    running = outcomes([(key, key) for key in "abcdef"], engine)
    next(running)
    assert executor.submitted == ["a", "b", "c"]
    running.close()
