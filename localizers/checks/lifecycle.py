"""Laws on the life of a localizer: reset, pickled, sent to another process."""

import multiprocessing
import os
import pickle
from itertools import islice
from multiprocessing.connection import Connection
from typing import Any

from localizers.checks.spawned import Spawned
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
from localizers.naming.isolation import enter
from localizers.naming.plugins import raised
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
    process = Spawned(_answer, task)
    try:
        answer: list[Snapshot] | str = process.answer(timeout)
        return answer
    finally:
        process.close()


def _answer(there: Connection, task: bytes) -> None:
    """Run in the spawned process."""
    enter()
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
