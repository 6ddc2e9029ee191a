"""A process for other people's code, which is killed with everything it started.

Whatever such code does to its process (working folder, streams, signals, threads, random state,
``os._exit``) ends with the process. The parent kills it and waits for none of its cleanup.
"""

import atexit
import contextlib
import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from multiprocessing.connection import wait
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Thread
from typing import Any

SPAWN = multiprocessing.get_context("spawn")
_MARK = "DEQMCL_PROCESS"  # in the environment of all that the process starts
_EXEC_SECONDS = 0.02  # a program that is just being started does not show its environment yet
_OOM_SCORE = "500"  # who is killed first when memory runs out: this process, not its parent


class NoAnswerError(RuntimeError):
    """A process gave no answer in time, or ended."""


class EndedError(NoAnswerError):
    """A process ended without an answer.

    Attributes:
        code: its exit code; None if it has none yet.
    """

    def __init__(self, code: int | None) -> None:
        super().__init__(f"a separate process ended without an answer, with exit code {code}")
        self.code = code


class Isolated:
    """A process that calls ``enter`` and answers questions, and our end of the line to it."""

    def __init__(
        self, context: BaseContext, target: Callable[..., None], *arguments: object
    ) -> None:
        """Start ``target(line, *arguments)``."""
        self._line, there = context.Pipe()
        self.process: BaseProcess = context.Process(  # type: ignore[attr-defined]
            target=target, args=(there, *arguments)
        )
        self.process.start()
        there.close()  # so that the line breaks when the process dies
        atexit.register(self.kill)  # multiprocessing would wait for it

    def answer(self, timeout: float | None, *question: object) -> Any:
        """Return what the process sends next, after it was sent a question if there is one.

        Raises:
            EndedError: it ended.
            NoAnswerError: it has sent nothing after ``timeout`` s.
        """
        try:
            for one in question:
                self._line.send(one)
            if self._line.poll(timeout):
                return self._line.recv()
        except (EOFError, OSError):
            self.process.join(1)
            raise EndedError(self.process.exitcode) from None
        raise NoAnswerError(f"a separate process gave no answer within {timeout:g} s")

    def kill(self) -> None:
        """Kill the process, if it still lives, and all that it started."""
        end(self.process)

    def close(self) -> None:
        """Kill the process, wait for its end, and close the line."""
        atexit.unregister(self.kill)
        self.kill()
        self.process.join()
        self._line.close()


def enter() -> None:
    """Prepare this process to be killed as a whole; call it first.

    It leads its own session, prints to stderr, and does not outlive its parent.
    """
    with contextlib.suppress(AttributeError, OSError):  # not on Windows; it leads one already
        os.setsid()
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(_OOM_SCORE)
    with contextlib.suppress(OSError):  # stderr is closed
        os.dup2(2, 1)
    os.environ[_MARK] = str(os.getpid())
    Thread(target=_leave_with_parent, daemon=True).start()


def is_ctrl_c(error: BaseException) -> bool:
    """Whether an error is the user's Ctrl-C; in a worker it can only come from a plug-in."""
    return isinstance(error, KeyboardInterrupt) and multiprocessing.parent_process() is None


def end(process: BaseProcess) -> None:
    """Kill a process that called ``enter``, and all it started, in other sessions too."""
    if process.pid is not None:
        _kill_session(process.pid)
        process.kill()
        _kill_marked(process.pid)


def _kill_session(leader: int) -> None:
    with contextlib.suppress(AttributeError, OSError):  # not on Windows; none is left
        os.killpg(leader, signal.SIGKILL)


def _kill_marked(leader: int) -> None:
    """Kill programs that were started with the mark of a process, whatever session they are in."""
    mark = f"{_MARK}={leader}".encode()
    for pause in (0.0, _EXEC_SECONDS):
        time.sleep(pause)
        for environment in Path("/proc").glob("[0-9]*/environ"):
            with contextlib.suppress(OSError):  # it is gone, or another user's
                if mark in environment.read_bytes().split(b"\0"):
                    os.kill(int(environment.parent.name), signal.SIGKILL)


def _leave_with_parent() -> None:
    """Exit at once when the parent is gone, whatever else is running."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        _kill_marked(os.getpid())
        _kill_session(os.getpid())
        os._exit(1)
