"""A worker process: answers calls until the line breaks, and does not outlive its parent."""

import contextlib
import multiprocessing
import os
import threading
from multiprocessing.connection import Connection, wait


def work(line: Connection) -> None:
    """Answer each (function, arguments) with (True, result) or (False, exception)."""
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    load()
    with contextlib.suppress(EOFError, OSError):  # the parent has hung up
        line.send("ready")
        while True:
            function, arguments = line.recv()
            try:
                answer = True, function(*arguments)
            except Exception as error:
                answer = False, error
            line.send(answer)


def load() -> None:
    """Load what trials need before the first of them is timed."""
    import cv2

    import benchmarks.trials.attempt  # noqa: F401

    cv2.setNumThreads(1)


def _leave_with_parent() -> None:
    """End at once when the parent is gone, whatever the trial is doing."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
