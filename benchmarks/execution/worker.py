"""A worker process: answers calls until the line breaks, and does not outlive its parent."""

import contextlib
import os
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import Any

from deqmcl_gym.validation import InputError, in_words
from localizers.naming.isolation import enter


def work(line: Connection) -> None:
    """Answer each (function, arguments) with (True, result) or (False, exception)."""
    enter()
    load()
    with contextlib.suppress(EOFError, OSError):  # the parent has hung up
        line.send("ready")
        while True:
            line.send_bytes(_answer(*line.recv()))
    os._exit(0)  # waits for no thread that a plug-in has left


def load() -> None:
    """Load what trials need before the first of them is timed."""
    import cv2

    import benchmarks.trials.attempt  # noqa: F401

    cv2.setNumThreads(1)


def _answer(function: Callable[..., Any], arguments: tuple[Any, ...]) -> memoryview:
    try:
        return ForkingPickler.dumps((True, function(*arguments)))
    except BaseException as error:  # nobody but the call itself stops a worker so
        return ForkingPickler.dumps((False, _portable(error)))


def _portable(error: BaseException) -> Exception:
    """Return an error that the parent can read without the plug-in it may be from."""
    ours = type(error) is InputError or (
        isinstance(error, Exception) and type(error).__module__ == "builtins"
    )
    if ours:
        with contextlib.suppress(Exception):
            ForkingPickler.dumps(error)
            return error  # type: ignore[return-value]
    return RuntimeError(in_words(error))
