"""Worker processes and the loop that keeps them busy: what becomes of a call that is lost."""

import math
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from dataclasses import dataclass, field

import calls
import pytest

from benchmarks.execution import ONE_THREAD, engines, sheltered
from benchmarks.execution.engines import TRIES, Engine, Where, outcomes
from benchmarks.execution.processes import Processes, TimedOutError, WorkerDiedError
from benchmarks.sweeps.sweepfile import paper_sweep
from benchmarks.trials.stage import Outcome

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")

SOON = 20.0  # seconds in which a process that ends is gone; never waited out if all is well
DONE = Outcome(record={}, seconds=1.0)


@pytest.fixture(scope="module")
def pool():
    with Processes(1) as pool:
        yield pool


def gone(pids):
    until = time.monotonic() + SOON
    while any(map(calls.alive, pids)) and time.monotonic() < until:
        time.sleep(0.02)
    return not any(map(calls.alive, pids))


def test_a_call_gives_what_the_function_returns_or_raises_in_another_process(pool):
    assert pool.submit(calls.add, 2, 3).result() == 5
    with pytest.raises(ArithmeticError, match="too bad"):
        pool.submit(calls.fail, "too bad").result()
    first, second = (pool.submit(calls.pid).result() for _ in range(2))
    assert first == second != os.getpid()  # one process serves many calls


def test_what_a_call_forks_gives_no_answer(pool):
    assert [pool.submit(calls.fork, value).result() for value in range(5)] == [*range(5)]


@pytest.mark.parametrize(
    ("end", "how"), [(calls.die, "by signal 9"), (calls.leave, "with exit code 7")]
)
def test_a_process_that_dies_fails_its_own_call_and_the_next_call_gets_a_new_one(pool, end, how):
    before = pool.submit(calls.pid).result()
    with pytest.raises(WorkerDiedError, match=f"its worker died {how}"):
        pool.submit(end).result()
    assert pool.submit(calls.pid).result() != before
    assert gone([before])


def test_a_worker_has_one_thread_and_leaves_ctrl_c_to_its_parent(pool):
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    assert pool.submit(calls.environment, list(ONE_THREAD)).result() == (ONE_THREAD, 1)
    assert {name: os.environ.get(name) for name in ONE_THREAD} == before
    assert pool.submit(calls.interrupted).result() == "no"


def test_processes_that_start_at_once_leave_the_environment_as_it_was():
    def start(seconds):
        with sheltered():
            time.sleep(seconds)

    before = dict(os.environ)
    with ThreadPoolExecutor(4) as threads:
        [*threads.map(start, [0.001, 0.003, 0.002, 0.004] * 5)]
    assert dict(os.environ) == before


def test_a_call_that_takes_too_long_is_given_up_by_name_and_its_process_killed():
    with Processes(1, timeout=0.3) as pool:
        process = pool.submit(calls.pid).result()
        words = rf"within 0\.3 s: .*process {process}\) was killed"
        with pytest.raises(TimedOutError, match=words):
            pool.submit(calls.sleep, 1000).result()
        assert gone([process])
        assert pool.submit(calls.add, 1, 1).result() == 2


def test_leaving_kills_what_runs_and_begins_nothing_more():
    with Processes(2) as pool:
        pids = [pool.submit(calls.pid).result()]
        running = [pool.submit(calls.sleep, 1000) for _ in range(2)]
        waiting = pool.submit(calls.add, 1, 1)
        while not all(future.running() for future in running):
            time.sleep(0.01)
    assert gone(pids)
    assert not waiting.running()
    assert not waiting.done()


ORPHANS = """
import sys, time
sys.path.insert(0, {tests!r})
import calls
from benchmarks.execution.processes import Processes
if __name__ == "__main__":
    pool = Processes(2)
    first, second = pool.submit(calls.pid), pool.submit(calls.sleep, 0)
    pids = {{first.result(), second.result()}}
    busy = [pool.submit(calls.sleep, 1000) for _ in range(2)]
    print(*pids, flush=True)
    time.sleep(1000)
"""


def script(tmp_path, text):
    path = tmp_path / "script.py"
    path.write_text(text.format(tests=os.path.dirname(__file__)))
    return subprocess.Popen([sys.executable, path], stdout=subprocess.PIPE, text=True)


@pytest.mark.parametrize("killed", [True, False])
def test_workers_leave_in_mid_call_when_their_parent_is_killed_or_just_ends(tmp_path, killed):
    # as when Ctrl-C comes in the midst of leaving; busy ones sleep for a quarter of an hour
    parent = script(tmp_path, ORPHANS if killed else ORPHANS.replace("    time.sleep(1000)\n", ""))
    pids = [int(word) for word in parent.stdout.readline().split()]
    assert pids
    if killed:
        parent.send_signal(signal.SIGKILL)
    assert parent.wait(timeout=60) == (-signal.SIGKILL if killed else 0)
    assert gone(pids)


V1, V2 = "cpu/cpu.cfs_{}_us", "cpu.max"
QUOTAS = {
    "none": ({}, math.inf),
    "one and a half": ({V2: "150000 100000"}, 1.5),
    "of version 1": ({V1.format("quota"): "300000\n", V1.format("period"): "100000\n"}, 3.0),
}


@pytest.mark.parametrize("name", QUOTAS)
def test_the_quota_of_a_control_group_counts_as_its_processors(tmp_path, name, monkeypatch):
    files, share = QUOTAS[name]
    for path, text in files.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    assert engines._quota(tmp_path) == share
    monkeypatch.setattr(engines, "_quota", lambda: share)
    own = len(os.sched_getaffinity(0))
    assert engines.available_cpus() == max(1, math.ceil(min(share, own)))


CANNOT_START = """
import sys
if __name__ != "__main__":
    sys.exit(3)
sys.path.insert(0, {tests!r})
import calls
from benchmarks.execution.processes import Processes
with Processes(1) as pool:
    error = pool.submit(calls.pid).exception()
    print(type(error).__name__, error)
"""


def test_a_worker_that_cannot_start_is_told_from_one_that_died(tmp_path):
    said, _ = script(tmp_path, CANNOT_START).communicate(timeout=60)
    words = r"BrokenExecutor a worker process could not start \(exit code \d\)\n"
    assert re.fullmatch(words, said)


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


def run(scripts, timeout=None):
    executor = Scripted(scripts)
    engine = Engine(submit=executor.submit, slots=2, timeout=timeout)
    return dict(outcomes([(key, f"trial {key}") for key in "abc"], engine)), executor


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
    ended = pytest.raises(WorkerDiedError, match=r"it called exit\(7\)")
    with Where(jobs=1).engine([trial]) as engine, ended:
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
