"""Worker processes: what they answer, and what becomes of a call whose process is lost."""

import math
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import calls
import pytest

from benchmarks.execution import ONE_THREAD, engines, sheltered
from benchmarks.execution.processes import (
    Processes,
    TimedOutError,
    WorkerDiedError,
)

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")

SOON = 20.0  # seconds in which a process that ends is gone; never waited out if all is well


@pytest.fixture(scope="module")
def pool():
    with Processes(1) as pool:
        yield pool


def gone(pids):
    """Whether all these processes end soon."""
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
    after = pool.submit(calls.pid).result()
    assert after != before
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
        with pytest.raises(
            TimedOutError, match=rf"within 0\.3 s: .*process {process}\) was killed"
        ):
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


def test_workers_leave_when_their_parent_is_killed_even_in_mid_call(tmp_path):
    parent = script(tmp_path, ORPHANS)
    pids = [int(word) for word in parent.stdout.readline().split()]
    assert pids
    parent.send_signal(signal.SIGKILL)
    parent.communicate()
    assert gone(pids)


def test_a_command_that_ends_without_leaving_ends_its_workers_too(tmp_path):
    # As when Ctrl-C comes in the midst of leaving; busy ones sleep for a quarter of an hour.
    parent = script(tmp_path, ORPHANS.replace("    time.sleep(1000)\n", ""))
    pids = [int(word) for word in parent.stdout.readline().split()]
    assert parent.wait(timeout=60) == 0
    assert pids
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
