"""A sweep that is stopped, killed, hung or loses a Dask worker goes on as if nothing was."""

import os
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pytest
from deqmcl_command import DEQMCL, files, process, records
from sweep_command import sweep, tables, write_hostile, write_small

from benchmarks.execution import engines

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")

PATIENCE = 60.0  # seconds; never waited out if all is well


def _hear_ctrl_c():
    """A shell's background jobs ignore it, and so would what they start."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Running:
    """A sweep in processes of its own group, which can be told from all others."""

    def __init__(self, file, out, *more):
        self.out = out
        self._mark = uuid.uuid4().hex
        words = [DEQMCL, "sweep", file, "--out", out, "--jobs", "2", *more]
        self.process = subprocess.Popen(
            [str(word) for word in words],
            env=os.environ | {"SWEEP_MARK": self._mark},
            start_new_session=True,
            preexec_fn=_hear_ctrl_c,  # noqa: PLW1509 (it does no more than set a signal)
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def pids(self):
        found = []
        for folder in Path("/proc").iterdir():
            try:
                if folder.name.isdigit() and self._mark.encode() in (
                    (folder / "environ").read_bytes()
                ):
                    found.append(int(folder.name))
            except OSError:
                continue
        return found

    def wait_for_trials(self, count):
        until(lambda: len(records(self.out)) >= count, self.process)

    def ended(self):
        """Exit code and what was said; no process of it is left."""
        out, err = self.process.communicate(timeout=PATIENCE)
        until(lambda: not self.pids())
        return self.process.returncode, out, err


def until(condition, process=None):
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "it takes too long"
        assert process is None or process.poll() is None, process.communicate()
        time.sleep(0.01)


def test_a_sweep_that_is_killed_again_and_again_ends_as_if_nothing_had_been(tmp_path):
    file, finished, out = write_small(tmp_path, trials=6), tmp_path / "finished", tmp_path / "out"
    assert sweep(file, finished) == 0
    for count, kill in ((2, os.killpg), (5, os.kill)):  # all of it, or the parent alone
        running = Running(file, out)
        running.wait_for_trials(count)
        kept = records(out)
        kill(running.process.pid, signal.SIGKILL)
        assert running.ended()[0] == -signal.SIGKILL
        assert kept.items() <= records(out).items()
    assert sweep(file, out) == 0
    assert tables(out) == tables(finished)
    assert records(out) == records(finished)
    assert not [name for name in files(out) if name.endswith(".tmp")]


@pytest.mark.parametrize(
    ("how", "times", "send", "code"),
    [
        (signal.SIGINT, 5, os.killpg, 130),  # as a terminal does; one after another is one
        (signal.SIGTERM, 1, os.kill, 143),
    ],
    ids=["Ctrl-C", "SIGTERM"],
)
def test_a_sweep_that_is_told_to_stop_stops_in_mid_trial(tmp_path, how, times, send, code):
    file = write_small(tmp_path, trials=1)
    hangs = write_hostile(tmp_path, "hang", "update")
    running = Running(file, tmp_path / "out", "--with", hangs)
    running.wait_for_trials(2)  # what is left hangs
    for _ in range(times):
        send(running.process.pid, how)
        time.sleep(0.02)
    ended, out, said = running.ended()
    assert (ended, out) == (code, "")
    assert said.endswith("deqmcl: interrupted; finished trials are kept.\n")
    assert "Traceback" not in said
    assert len(records(running.out)) == 2


TURNED = """
import os, signal
from benchmarks.console import stoppable
try:
    with stoppable(leaving=True):
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:  # as NumPy does while it is imported
            raise ImportError("numpy cannot be imported")
except KeyboardInterrupt:
    print("interrupted")
"""
PARSED = """
import os, signal, sys
from benchmarks import cli
cli.import_module = lambda _: os.kill(os.getpid(), signal.SIGINT)
sys.argv = ["deqmcl", "sweep"]
sys.exit(cli.main())
"""
DROPPED = """
import ctypes, os, signal, sys, time
from benchmarks.console import Terminated, stoppable
number = int(sys.argv[1])
def callback():
    os.kill(os.getpid(), number)
    for _ in range(1000):  # here the handler raises, and what it raises is dropped
        pass
    return 0
of_c = ctypes.CFUNCTYPE(ctypes.c_int)(callback)
try:
    with stoppable(leaving=True):
        of_c()
        time.sleep(60)
except Terminated:
    print("terminated")
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.parametrize(
    ("script", "words", "ended"),
    [
        pytest.param(TURNED, (), (0, "interrupted\n", ""), id="a library"),
        pytest.param(PARSED, (), (130, "", "deqmcl: interrupted.\n"), id="reading"),
        pytest.param(DROPPED, (signal.SIGINT,), (0, "interrupted\n", ""), id="Ctrl-C in C"),
        pytest.param(DROPPED, (signal.SIGTERM,), (0, "terminated\n", ""), id="SIGTERM in C"),
    ],
)
def test_a_signal_is_not_lost_wherever_it_comes(script, words, ended):
    command = [sys.executable, "-c", script, *(str(int(word)) for word in words)]
    done = process(*command, preexec_fn=_hear_ctrl_c, timeout=PATIENCE / 2)
    assert (done.returncode, done.stdout, done.stderr) == ended


@pytest.mark.slow  # every process of the cluster loads all anew
def test_a_cluster_that_loses_a_worker_gives_the_numbers_of_one_process(tmp_path):
    distributed = pytest.importorskip("distributed")
    file, flag = write_small(tmp_path, trials=3), tmp_path / "started"
    dies = write_hostile(tmp_path, "die once", "update")
    assert sweep(file, tmp_path / "here", "--with", dies) == 0
    flag.touch()
    local = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**local) as cluster:
        address = cluster.scheduler_address
        words = ("--out", tmp_path / "there", "--with", dies, "--jobs", "2", "--dask", address)
        there = process(DEQMCL, "sweep", file, *words)
    assert there.returncode == 0, there.stderr
    assert not flag.exists()  # a worker found it and died
    assert there.stdout.startswith("small: 9 of 9 trials finished.")
    assert tables(tmp_path / "there") == tables(tmp_path / "here")
    assert records(tmp_path / "there") == records(tmp_path / "here")


def test_a_scheduler_that_does_not_answer_is_bad_input(tmp_path, refusal, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(engines, "CONNECT_SECONDS", 0.1)
    given = ("--out", tmp_path / "out", "--dask", "tcp://127.0.0.1:9")
    said = "deqmcl: the Dask scheduler 'tcp://127.0.0.1:9' cannot be reached"
    refusal(["sweep", write_small(tmp_path, trials=1), *given], said)
    assert not (tmp_path / "out").exists()
