"""A sweep that is stopped, killed or hung: what stays, and that it goes on as if nothing was."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pytest
from deqmcl_command import DEQMCL, exit_code, files
from sweep_command import lines, sweep, tables, trial_files, write_small

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")

TROUBLED = Path(__file__).with_name("troubled.py")
PATIENCE = 60.0  # seconds; never waited out if all is well


def _hear_ctrl_c():
    """A shell's background jobs ignore it, and so would what they start."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Running:
    """A sweep in processes of its own group, which can be told from all others."""

    def __init__(self, file, out, *more, script=None, flag=""):
        self.out = out
        self._mark = uuid.uuid4().hex
        program = (DEQMCL,) if script is None else (sys.executable, script)
        words = [*program, "sweep", file, "--out", out, "--jobs", "2", *more]
        self.process = subprocess.Popen(
            [str(word) for word in words],
            env=os.environ | {"SWEEP_MARK": self._mark, "TROUBLED_FLAG": str(flag)},
            start_new_session=True,
            preexec_fn=_hear_ctrl_c,  # noqa: PLW1509 (it does no more than set a signal)
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def pids(self):
        """Its processes that live."""
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
        until(lambda: len(list((self.out / "trials").glob("*.json"))) >= count, self.process)

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


@pytest.fixture
def sleepy(tmp_path):
    return write_small(tmp_path, trials=1)


def test_a_sweep_that_is_killed_again_and_again_ends_as_if_nothing_had_been(tmp_path):
    file, finished, out = write_small(tmp_path, trials=6), tmp_path / "finished", tmp_path / "out"
    assert sweep(file, finished) == 0
    for count, kill in ((2, os.killpg), (5, os.kill)):  # all of it, or the parent alone
        running = Running(file, out)
        running.wait_for_trials(count)
        kept = trial_files(out)
        kill(running.process.pid, signal.SIGKILL)
        code, _, _ = running.ended()
        assert code == -signal.SIGKILL
        assert kept.items() <= trial_files(out).items()
    assert sweep(file, out) == 0
    assert tables(out) == tables(finished)
    assert trial_files(out) == trial_files(finished)
    assert not [name for name in files(out) if name.endswith(".tmp")]


@pytest.mark.parametrize("cases", [2, pytest.param(25, marks=pytest.mark.slow)])
def test_signals_at_any_moment_leave_what_the_next_run_ends_as_if_nothing_had_been(tmp_path, cases):
    file, finished, out = write_small(tmp_path, trials=6), tmp_path / "finished", tmp_path / "out"
    assert sweep(file, finished) == 0
    dice = random.Random(cases)
    for case in range(cases):
        how = dice.choice([signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
        running = Running(file, out)
        time.sleep(dice.uniform(0.0, 3.0))
        running.process.send_signal(how)
        code, _, said = running.ended()
        assert code in (0, 128 + how, -how), (case, how, said)
        assert "Traceback" not in said, (case, how)
        if case % 3 == 2:
            shutil.rmtree(out, ignore_errors=True)
    assert sweep(file, out) == 0
    assert tables(out) == tables(finished)
    assert trial_files(out) == trial_files(finished)
    assert not list(out.rglob(".deqmcl*"))


@pytest.mark.parametrize(
    ("how", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)], ids=["Ctrl-C", "SIGTERM"]
)
def test_a_sweep_that_is_told_to_stop_stops_in_mid_trial(sleepy, tmp_path, how, code):
    running = Running(sleepy, tmp_path / "out", "--with", "sleep", script=TROUBLED)
    running.wait_for_trials(2)  # what is left sleeps for a quarter of an hour
    if how == signal.SIGINT:
        os.killpg(running.process.pid, how)  # as a terminal does
    else:
        running.process.send_signal(how)
    ended, out, said = running.ended()
    assert (ended, out) == (code, "")
    assert said.endswith("deqmcl: interrupted; finished trials are kept.\n")
    assert "Traceback" not in said
    assert len(trial_files(running.out)) == 2
    assert not (running.out / ".deqmcl.lock").exists()


def test_a_trial_that_hangs_is_named_and_its_worker_killed_and_the_rest_is_done(sleepy, tmp_path):
    with_it = ("--with", "sleep,mcl-map", "--timeout", "2")
    running = Running(sleepy, tmp_path / "out", *with_it, script=TROUBLED)
    code, said, err = running.ended()
    assert code == 3
    assert said.startswith("small: 3 of 4 trials finished, 1 failed.")
    assert "first: sleep, trial 0: no result within 2 s: its worker (process " in err
    assert "sleep" not in {line["method"] for line in lines(running.out)}


def test_a_trial_whose_worker_dies_is_tried_again_and_fails_if_that_goes_on(tmp_path):
    file, flag = write_small(tmp_path, trials=1), tmp_path / "flag"
    flag.touch()
    with_them = ("--with", "die-once", "--with", "die,die-once")
    running = Running(file, tmp_path / "out", *with_them, script=TROUBLED, flag=flag)
    code, said, err = running.ended()
    assert not flag.exists()
    assert code == 3
    assert said.startswith("small: 3 of 4 trials finished, 1 failed.")
    assert "die, trial 0: lost 3 times by its worker; last: WorkerDiedError: its worker" in err
    assert "by signal 9" in err
    assert "die-once" in {line["method"] for line in lines(running.out)}


def test_one_ctrl_c_after_another_is_one_ctrl_c(sleepy, tmp_path):
    running = Running(sleepy, tmp_path / "out", "--with", "sleep", script=TROUBLED)
    running.wait_for_trials(1)
    for _ in range(5):
        running.process.send_signal(signal.SIGINT)
        time.sleep(0.02)
    code, _, said = running.ended()
    assert code == 130
    assert said.endswith("deqmcl: interrupted; finished trials are kept.\n")
    assert "Traceback" not in said


@pytest.mark.parametrize("command", ["sweep", "run --localizer mcl", "paper", "list"])
def test_a_working_folder_that_is_gone_is_named_before_anything_is_run(
    tmp_path, monkeypatch, capsys, command
):
    gone, out = tmp_path / "gone", tmp_path / "out"
    given = [*command.split(), *([write_small(tmp_path)] if command == "sweep" else [])]
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert exit_code(*given, *(["--out", out] if command != "list" else [])) == 2
    assert "the current folder is gone: change to one that exists." in capsys.readouterr().err
    assert not out.exists()


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
    ("number", "how"), [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated")]
)
def test_a_signal_that_comes_in_a_callback_of_c_is_not_lost(number, how):
    script = [sys.executable, "-c", DROPPED, str(int(number))]
    heard = {"preexec_fn": _hear_ctrl_c, "timeout": PATIENCE / 2}
    done = subprocess.run(script, capture_output=True, text=True, check=True, **heard)
    assert (done.stdout, done.stderr) == (f"{how}\n", "")
