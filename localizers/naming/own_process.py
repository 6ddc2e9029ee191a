"""A process of its own, which its parent kills with all that is in its session."""

import atexit
import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection, wait
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Thread
from typing import Any

SPAWN = multiprocessing.get_context("spawn")
SAFE_PATH = {"PYTHONSAFEPATH": "deqmcl"}  # in the environment; any text switches it on
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


class OwnProcess:
    """A process that calls ``enter`` and answers questions, and our end of the line to it."""

    def __init__(
        self, context: BaseContext, target: Callable[..., None], *arguments: object
    ) -> None:
        """Start ``target(line, *arguments)``."""
        self._line, there = context.Pipe()
        self.process: BaseProcess = context.Process(  # type: ignore[attr-defined]
            target=target, args=(there, *arguments)
        )
        with safe_path():
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
        """Kill the process, if it still lives, and all that is in its session."""
        end(self.process)

    def close(self) -> None:
        """Kill the process, wait for its end, and close the line."""
        atexit.unregister(self.kill)
        self.kill()
        self.process.join()
        self._line.close()


@contextlib.contextmanager
def safe_path() -> Iterator[None]:
    """Let interpreters that start now find nothing in the working folder, until they ``enter``.

    multiprocessing starts them by ``python -c``, which looks there first.
    """
    before = {name: os.environ[name] for name in SAFE_PATH if name in os.environ}
    os.environ.update(SAFE_PATH)
    try:
        yield
    finally:
        del os.environ["PYTHONSAFEPATH"]
        os.environ.update(before)


def enter(line: Connection) -> None:
    """Prepare this process to be killed as a whole; call it first.

    It leads its own session, prints to stderr, and does not outlive its parent. What a plug-in
    forks is not on the line: answers come from this process alone.
    """
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=line.close)
    with contextlib.suppress(AttributeError, OSError):  # not on Windows; it leads one already
        os.setsid()
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(_OOM_SCORE)
    with contextlib.suppress(OSError):  # stderr is closed
        os.dup2(2, 1)
    if SAFE_PATH.items() <= os.environ.items():  # its programs start as ever
        del os.environ["PYTHONSAFEPATH"]
    Thread(target=_leave_with_parent, daemon=True).start()


def end(process: BaseProcess) -> None:
    """Kill a process that called ``enter``, and all that is in its session."""
    if process.pid is not None:
        _kill_session(process.pid)
        process.kill()


def _kill_session(leader: int) -> None:
    with contextlib.suppress(AttributeError, OSError):  # not on Windows; none is left
        os.killpg(leader, signal.SIGKILL)


def _leave_with_parent() -> None:
    """Exit at once when the parent is gone, whatever else is running."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        _kill_session(os.getpid())
        os._exit(1)
