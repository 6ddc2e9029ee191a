"""What a law watches of this process: its global state, its random numbers, what it has started."""

import os
import pickle
import random
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from localizers.checks.subject import LawBrokenError


def _set_handlers(handlers: Mapping[int, Any]) -> None:
    for number, handler in handlers.items():
        if handler is not None and handler != signal.getsignal(number):
            signal.signal(number, handler)


def _set_environment(variables: Mapping[str, str]) -> None:
    os.environ.clear()
    os.environ.update(variables)


_STATES: dict[str, tuple[Callable[[], Any], Callable[[Any], object]]] = {  # how to read and set it
    "the working folder": (os.getcwd, os.chdir),
    "signal handlers": (
        lambda: {number: signal.getsignal(number) for number in signal.valid_signals()},
        _set_handlers,
    ),
    "np.seterr": (np.geterr, lambda kept: np.seterr(**kept)),
    "np.set_printoptions": (np.get_printoptions, lambda kept: np.set_printoptions(**kept)),
    "the filters of warnings": (
        lambda: list(warnings.filters),
        lambda kept: setattr(warnings, "filters", kept),
    ),
    "os.environ": (lambda: dict(os.environ), _set_environment),
    "the recursion limit": (sys.getrecursionlimit, sys.setrecursionlimit),
    "sys.path": (lambda: list(sys.path), lambda kept: setattr(sys, "path", kept)),
}


ADDED_BY_IMPORTS = ("the filters of warnings", "os.environ", "sys.path")


def process_state() -> dict[str, Any]:
    """Return the global state of this process, by name."""
    return {name: read() for name, (read, _) in _STATES.items()}


def changes_since(before: Mapping[str, Any]) -> list[str]:
    """Name what is not as it was."""
    return [name for name, state in process_state().items() if state != before[name]]


@contextmanager
def process_state_kept() -> Iterator[None]:
    """Put the global state of this process back after a block."""
    before = process_state()
    try:
        yield
    finally:
        for name in changes_since(before):
            _STATES[name][1](before[name])


@contextmanager
def no_global_rng(remedy: str) -> Iterator[None]:
    """Refuse a block that uses the global generators of NumPy or Python, which are put back.

    Raises:
        LawBrokenError: it used one; ``remedy`` says what to do instead.
    """

    def states() -> tuple[Any, Any]:
        return np.random.get_state(), random.getstate()  # noqa: NPY002

    held = states()
    try:
        np.random.seed(2_718_281)  # noqa: NPY002
        random.seed(2_718_281)
        before = pickle.dumps(states())
        yield
        after = pickle.dumps(states())
    finally:
        np.random.set_state(held[0])  # noqa: NPY002
        random.setstate(held[1])
    if after != before:
        raise LawBrokenError(f"it uses the global random numbers of numpy or random: {remedy}")


def running() -> dict[str, str]:
    """Name this process's threads and, as far as /proc shows them, the processes it started."""
    names = {f"thread {own.ident}": f"the thread {own.name!r}" for own in threading.enumerate()}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it is gone
            state, parent = stat.read_text().rpartition(")")[2].split()[:2]
            if state != "Z" and parent == str(os.getpid()):
                names[f"process {stat.parent.name}"] = f"the process {stat.parent.name}"
    return names


@contextmanager
def safe_path() -> Iterator[None]:
    """Let Python processes that are started here find no modules in the working folder."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before
