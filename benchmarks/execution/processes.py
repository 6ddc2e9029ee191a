"""Processes of this machine, a pool that outlives the death of any of them.

Unlike ``ProcessPoolExecutor`` it can tell whose call a process died of, and end one that hangs:
one thread looks after one process, and starts another when there is no answer.
"""

import atexit
import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Hashable
from concurrent.futures import BrokenExecutor, Future
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from typing import Any, NamedTuple, Self

from benchmarks.execution import CONTEXT, sheltered, unshelter
from deqmcl_gym.validation import InputError, in_words

# Seconds a thread gets to end. It may never: a Ctrl-C that comes while futures are waited for can
# leave one of them locked. Its process is killed by then, and it dies with this one.
_FAREWELL = 1.0
_HELD = 8  # guests for whose next call a worker keeps a process
GUEST_SECONDS = 3600.0  # that a call of a guest may take if nobody says otherwise
_Call = tuple[Callable[..., Any], tuple[Any, ...]]


class _Waiting(NamedTuple):
    future: Future[Any]
    guest: str
    group: Hashable
    call: _Call


class WorkerDiedError(RuntimeError):
    """The process that ran a call ended before it answered."""


class TimedOutError(RuntimeError):
    """A call took too long; the process that ran it was killed."""


class Processes:
    """``workers`` processes of one thread each, at work at a time; each starts with its first call.

    A future fails with ``WorkerDiedError`` or ``TimedOutError`` when its process died or took more
    than ``timeout`` seconds (None: ``GUEST_SECONDS`` of a guest, else for ever); a new process
    takes the next call. Leaving the context kills what still runs, and what it started. Calls of
    different guests never share a process, which waits for its guest until ``_HELD`` others came.
    Calls of one group are made by one process, as long as there are others for the other processes.
    """

    def __init__(self, workers: int, *, timeout: float | None = None) -> None:
        self._timeout = timeout
        self._lock = threading.Lock()  # of what follows
        self._called = threading.Condition(self._lock)
        self._calls: list[_Waiting] = []
        self._groups: dict[int, Hashable] = {}  # that of the last call of each thread
        self._closed = False
        self._living: set[_Worker] = set()
        self._threads = [
            threading.Thread(target=self._look_after_one, daemon=True) for _ in range(workers)
        ]
        for thread in self._threads:
            thread.start()
        # Ctrl-C may come in the midst of leaving: multiprocessing would wait for those left
        atexit.register(self._kill)

    def submit(
        self, fn: Callable[..., Any], *args: Any, guest: str = "", group: Hashable = None
    ) -> Future[Any]:
        """Have ``fn(*args)`` run by the next free process: of a group, with a guest's code."""
        future: Future[Any] = Future()
        with self._called:
            self._calls.append(_Waiting(future, guest, group, (fn, args)))
            self._called.notify()
        return future

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End all processes; what still runs is killed, what waits is not begun."""
        self._kill()
        atexit.unregister(self._kill)
        for thread in self._threads:
            thread.join(_FAREWELL)

    def _kill(self) -> None:
        with self._called:
            self._closed = True
            self._called.notify_all()
            for worker in self._living:
                worker.kill()

    def _look_after_one(self) -> None:
        held: dict[str, _Worker] = {}  # by guest, the one called last at the end
        while (waiting := self._next_call()) is not None:
            future, guest, _, call = waiting
            if not future.set_running_or_notify_cancel():
                continue
            try:
                patience = GUEST_SECONDS if guest and self._timeout is None else self._timeout
                held[guest] = held.pop(guest) if guest in held else self._new_worker()
                future.set_result(held[guest].returned(call, patience))
            except BaseException as error:
                if guest in held:
                    self._end(held.pop(guest))
                future.set_exception(error)
            if len(held) > _HELD:
                self._end(held.pop(next(iter(held))))
        for worker in held.values():
            self._end(worker)

    def _next_call(self) -> _Waiting | None:
        """Wait for a call: of this thread's group, else of nobody's, else the first; None: end."""
        me = threading.get_ident()
        with self._called:
            while not (self._calls or self._closed):
                self._called.wait()
            if self._closed:
                return None
            last, taken = self._groups.pop(me, None), set(self._groups.values())
            ranks = [2 * (call.group != last) + (call.group in taken) for call in self._calls]
            waiting = self._calls.pop(ranks.index(min(ranks)))
            self._groups[me] = waiting.group
            return waiting

    def _new_worker(self) -> "_Worker":
        with self._lock:
            if self._closed:
                raise WorkerDiedError("the sweep is being stopped")
            worker = _Worker()
            self._living.add(worker)
        return worker

    def _end(self, worker: "_Worker") -> None:
        with self._lock:
            self._living.discard(worker)
        worker.close()


class _Worker:
    """A process that makes calls, and our end of the line to it."""

    def __init__(self) -> None:
        self._line, remote = CONTEXT.Pipe()
        self._process = CONTEXT.Process(target=work, args=(remote,))
        with sheltered():
            self._process.start()
        remote.close()  # so that the line breaks when the process dies
        self._ready = False

    def returned(self, call: _Call, timeout: float | None) -> Any:
        """Return what a call returns, or raise what it raised, or why there is no answer."""
        try:
            if not self._ready:
                self._line.recv()  # imports take their time, which is not the call's
                self._ready = True
            self._line.send(call)
            if not self._line.poll(timeout):
                raise TimedOutError(
                    f"no result within {timeout:g} s: its worker (process {self._process.pid}) was "
                    "killed"
                )
            returned, value = self._line.recv()
        except (EOFError, OSError):
            self._process.join(1)
            code = self._process.exitcode or 0
            if not self._ready and code > 0:
                why = f"a worker process could not start (exit code {code})"
                raise BrokenExecutor(why) from None
            how = f"by signal {-code}" if code < 0 else f"with exit code {code}"
            raise WorkerDiedError(f"its worker died {how}") from None
        if not returned:
            raise value
        return value

    def kill(self) -> None:
        """Kill the process, if it still lives, and what it started."""
        if self._process.pid is not None:
            _kill_session(self._process.pid)
            self._process.kill()

    def close(self) -> None:
        """Kill the process, wait for its end, and close the line."""
        self.kill()
        self._process.join()
        self._line.close()


def work(line: Connection) -> None:
    """Answer each (function, arguments) by (True, result) or (False, exception), until the end.

    It leads its own session, prints to stderr, and ends with the line or its parent.
    """
    if hasattr(os, "register_at_fork"):  # what a call forks does not answer for it
        os.register_at_fork(after_in_child=line.close)
    with contextlib.suppress(AttributeError, OSError):  # not on Windows
        os.setsid()
    with contextlib.suppress(OSError):  # killed before its parent when memory runs out
        Path("/proc/self/oom_score_adj").write_text("500")
    with contextlib.suppress(OSError):  # stderr is closed
        os.dup2(2, 1)
    unshelter()
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    load_trials()
    with contextlib.suppress(EOFError, OSError):  # the parent has hung up
        line.send("ready")
        while True:
            function, arguments = line.recv()
            try:
                answer = ForkingPickler.dumps((True, function(*arguments)))
            except BaseException as error:  # nobody but the call itself stops a worker so
                answer = ForkingPickler.dumps((False, _portable(error)))
            line.send_bytes(answer)
    os._exit(0)  # waits for no thread that a plug-in has left


def _leave_with_parent() -> None:
    """Exit at once when the parent is gone, whatever else is running."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        _kill_session(os.getpid())
        os._exit(1)


def _kill_session(leader: int) -> None:
    with contextlib.suppress(AttributeError, OSError):  # not on Windows; none is left
        os.killpg(leader, signal.SIGKILL)


def load_trials() -> None:
    """Load what trials need before the first of them is timed."""
    import cv2

    import benchmarks.trials.stage  # noqa: F401

    cv2.setNumThreads(1)


def _portable(error: BaseException) -> Exception:
    """Return an error that the parent can read without the plug-in it may be from."""
    home = type(error).__module__
    if isinstance(error, Exception) and home in ("builtins", InputError.__module__):
        with contextlib.suppress(Exception):
            ForkingPickler.dumps(error)
            return error
    return RuntimeError(in_words(error))
