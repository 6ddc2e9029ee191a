"""Laws on the life of a localizer and on its side effects.

It is reset, pickled and sent to another process; it leaves the process as it was.
"""

import contextlib
import decimal
import gc
import io
import locale
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from localizers.checks.subject import (
    LawBrokenError,
    LawSkippedError,
    Snapshot,
    Subject,
    beliefs,
    continued,
    history,
    require_same,
    snapshot,
)
from localizers.naming.plugins import SPAWN, NoAnswerError, OwnProcess, enter, raised
from localizers.naming.registry import made_by, resolve

_HALF = 6


def answers_in_time(subject: Subject) -> None:
    """In a separate process it reaches the end of the drive, in time and without a crash."""
    if multiprocessing.parent_process() is not None:  # this is one, and its parent waits
        subject.history()
        return
    try:
        task = _task(subject)
    except LawBrokenError as reason:
        raise LawSkippedError("it cannot be sent to a separate process") from reason
    _asked(task, subject.timeout)


def reset_starts_anew(subject: Subject) -> None:
    """After reset, a used localizer answers as a new one does."""
    used = subject.made()
    for _ in islice(beliefs(used, subject.drive, seed=1), _HALF):
        pass
    require_same(
        subject.history(used),
        subject.history(),
        "after reset the localizer remembers its previous run",
    )


def picklable(subject: Subject) -> None:
    """A copy made by pickle continues as the original does, whether new or halfway."""
    expected = subject.history()
    require_same(subject.history(_copy(subject.made())), expected, "a pickled copy differs")
    localizer = subject.made()
    first = islice(beliefs(localizer, subject.drive), _HALF + 1)
    run = [snapshot(belief, t) for t, belief in enumerate(first)]
    rest = continued(_copy(localizer), subject.drive, _HALF)
    run.extend(snapshot(belief, t) for t, belief in enumerate(rest, start=_HALF + 1))
    require_same(run, expected, "a copy pickled halfway differs")


def runs_in_a_worker(subject: Subject) -> None:
    """In a spawned process, found there again by its name, it answers the same."""
    answer = _asked(_task(subject), subject.timeout)
    if isinstance(answer, str):
        raise LawBrokenError(f"in a spawned process: {answer}")
    require_same(answer, subject.history(), "a spawned process gives different results")


def _copy(localizer: Any) -> Any:
    try:
        return pickle.loads(pickle.dumps(localizer))
    except Exception as error:
        raise LawBrokenError(f"pickle cannot copy it: {type(error).__name__}: {error}") from error


def _task(subject: Subject) -> bytes:
    """All that another process needs to run it."""
    try:
        return pickle.dumps(
            (subject.sent, subject.name, dict(subject.params), subject.robot, subject.drive)
        )
    except Exception as error:
        raise LawBrokenError(
            f"it cannot be sent to another process ({type(error).__name__}: {error}): check it by "
            "its name, as package.module:NAME or path/to/file.py:NAME"
        ) from error


def _asked(task: bytes, timeout: float) -> list[Snapshot] | str:
    """Let a spawned process run the localizer; return what it computed, or what it raised."""
    process = OwnProcess(SPAWN, _answer, task)
    try:
        answer: list[Snapshot] | str = process.answer(timeout)
        return answer
    except NoAnswerError as error:
        raise LawBrokenError(str(error)) from None
    finally:
        process.close()


def _answer(there: Connection, task: bytes) -> None:
    """Run in the spawned process."""
    enter(there)
    answer: list[Snapshot] | str
    try:
        sent, name, params, robot, drive = pickle.loads(task)
        factory = resolve(sent) if isinstance(sent, str) else sent
        answer = history(made_by(factory, name, robot, **params), drive)
    except LawBrokenError as error:
        answer = str(error)
    except BaseException as error:
        answer = f"it raised {raised(error)}"
    there.send(answer)
    os._exit(0)  # waits for no thread


_GRACE = 1.0  # s that threads and processes may take to end
_ADDED = ("the filters of warnings", "os.environ", "sys.path")
_STREAMS = "sys.stdin, sys.stdout or sys.stderr"


@dataclass(frozen=True)
class _State:
    """How to read and set one part of a process's global state."""

    read: Callable[[], Any]
    set: Callable[[Any], object]


def _set_handlers(kept: Mapping[int, Any]) -> None:
    for number, handler in kept.items():
        if handler is not None and handler != signal.getsignal(number):
            signal.signal(number, handler)


def _decimal() -> dict[str, Any]:
    now = decimal.getcontext()
    names = ("prec", "rounding", "Emin", "Emax", "capitals", "clamp")
    trapped = [kind for kind, on in now.traps.items() if on]
    return {name: getattr(now, name) for name in names} | {"traps": trapped}


def _set_environment(kept: Mapping[str, str]) -> None:
    os.environ.clear()
    os.environ.update(kept)


def _set_streams(kept: Sequence[Any]) -> None:
    sys.stdin, sys.stdout, sys.stderr = kept


_STATES = {
    "the working folder": _State(os.getcwd, os.chdir),
    _STREAMS: _State(lambda: [sys.stdin, sys.stdout, sys.stderr], _set_streams),
    "signal handlers": _State(
        lambda: {number: signal.getsignal(number) for number in signal.valid_signals()},
        _set_handlers,
    ),
    "np.seterr": _State(np.geterr, lambda kept: np.seterr(**kept)),
    "np.set_printoptions": _State(np.get_printoptions, lambda kept: np.set_printoptions(**kept)),
    "the filters of warnings": _State(
        lambda: list(warnings.filters), lambda kept: setattr(warnings, "filters", list(kept))
    ),
    "the locale": _State(
        partial(locale.setlocale, locale.LC_ALL), partial(locale.setlocale, locale.LC_ALL)
    ),
    "the context of decimal": _State(
        _decimal, lambda kept: decimal.setcontext(decimal.Context(**kept))
    ),
    "os.environ": _State(lambda: dict(os.environ), _set_environment),
    "the recursion limit": _State(sys.getrecursionlimit, sys.setrecursionlimit),
    "sys.path": _State(lambda: list(sys.path), lambda kept: setattr(sys, "path", list(kept))),
}


def state_of_process() -> dict[str, Any]:
    """Return this process's global state, by name."""
    return {name: state.read() for name, state in _STATES.items()}


def process_state_untouched(subject: Subject) -> None:
    """Working folder, streams, signal handlers, np.seterr, warnings and the like stay as they are.

    An import may add to the filters of warnings, to os.environ and to sys.path, as many do.
    """
    imported = [n for n, b in subject.before.items() if subject.loaded[n] != b and n not in _ADDED]
    if imported:
        raise LawBrokenError(
            f"its import changes {', '.join(imported)} for its whole process: change it in a call, "
            "which puts it back before it returns"
        )
    held = state_of_process()
    quiet = [io.StringIO() for _ in range(3)]  # a stream replaced before would not be noticed
    before = {**subject.before, _STREAMS: quiet}
    try:
        set_state(before)
        subject.history()
        touched = [name for name, now in state_of_process().items() if now != before[name]]
    finally:
        set_state(held)
    if touched:
        raise LawBrokenError(
            f"it changes {', '.join(touched)} for its whole process: put back what a call changes "
            "before it returns"
        )


def nothing_left_running(subject: Subject) -> None:
    """A second after the localizer is gone, no thread and no process that it started runs on."""
    threads, processes = set(threading.enumerate()), _children()
    subject.history()
    gc.collect()
    until = time.monotonic() + _GRACE
    while True:
        left = [f"the thread {t.name!r}" for t in threading.enumerate() if t not in threads]
        left += [f"the process {number}" for number in sorted(_children() - processes)]
        if not left:
            return
        if time.monotonic() > until:
            more = f" and {len(left) - 1} more" if left[1:] else ""
            raise LawBrokenError(f"it leaves {left[0]}{more} running: end what it starts")
        time.sleep(0.01)


def set_state(states: Mapping[str, Any]) -> None:
    """Set what ``state_of_process`` returned."""
    for name, kept in states.items():
        _STATES[name].set(kept)


def _children() -> set[int]:
    """Ids of the processes that this one started, as far as /proc shows them."""
    found = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it is gone
            state, parent = stat.read_text().rpartition(")")[2].split()[:2]
            if state != "Z" and parent == str(os.getpid()):
                found.add(int(stat.parent.name))
    return found
