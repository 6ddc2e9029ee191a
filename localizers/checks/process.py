"""What laws watch of this process: its global state, its threads and the processes it started."""

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

GLOBAL_RNG = "the global random numbers of numpy or random"
ADDED_BY_IMPORTS = ("the filters of warnings", "os.environ", "sys.path", GLOBAL_RNG)


def _set_handlers(handlers: Mapping[int, Any]) -> None:
    for number, handler in handlers.items():
        if handler is not None and handler != signal.getsignal(number):
            signal.signal(number, handler)


def _set_environment(variables: Mapping[str, str]) -> None:
    os.environ.clear()
    os.environ.update(variables)


def _global_rng() -> bytes:
    return pickle.dumps((np.random.get_state(), random.getstate()))  # noqa: NPY002


def _set_global_rng(states: bytes) -> None:
    of_numpy, of_random = pickle.loads(states)
    np.random.set_state(of_numpy)  # noqa: NPY002
    random.setstate(of_random)


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
    GLOBAL_RNG: (_global_rng, _set_global_rng),
}


def state() -> dict[str, Any]:
    """Return the global state of this process, by name."""
    return {name: read() for name, (read, _) in _STATES.items()}


def changes_since(before: Mapping[str, Any]) -> list[str]:
    """Name what is not as it was."""
    return [name for name, now in state().items() if now != before[name]]


@contextmanager
def state_kept() -> Iterator[None]:
    """Put the global state of this process back after a block."""
    before = state()
    try:
        yield
    finally:
        for name in changes_since(before):
            _STATES[name][1](before[name])


def running() -> dict[str, str]:
    """Name this process's threads and, as far as /proc shows them, the processes it started."""
    names = {f"thread {one.ident}": f"the thread {one.name!r}" for one in threading.enumerate()}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it is gone
            state, parent = stat.read_text().rpartition(")")[2].split()[:2]
            if state != "Z" and parent == str(os.getpid()):
                names[f"process {stat.parent.name}"] = f"the process {stat.parent.name}"
    return names
