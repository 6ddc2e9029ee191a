"""How worker processes are started. Loads nothing heavy: workers load while the command does."""

import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import forkserver, resource_tracker

ONE_THREAD = {
    "NUMBA_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "BLIS_NUM_THREADS": "1",
    "VECLIB_MAXIMUM_THREADS": "1",
}
# multiprocessing runs ``python -c``, which would look into the working folder first; the value,
# which may be any text, tells ours from the user's
_SAFE_PATH = {"PYTHONSAFEPATH": "deqmcl"}
_ENVIRONMENT = ONE_THREAD | _SAFE_PATH

_ONE_STARTS = threading.RLock()  # two at once would restore the environment of each other

_SOCKET, _SOCKET_NAME = 107, "/pymp-xxxxxxxx/listener-xxxxxxxx"  # bytes of a path; what is appended

# Where forking is safe, workers are forked from a process that has loaded all that they need.
if sys.platform == "linux":
    CONTEXT = multiprocessing.get_context("forkserver")
    CONTEXT.set_forkserver_preload(["benchmarks.execution.preload"])
else:
    CONTEXT = multiprocessing.get_context("spawn")


def prepare() -> None:
    """Begin to load what workers will need; return at once."""
    if sys.platform == "linux":
        with sheltered():
            forkserver.ensure_running()


def _refuse_long_folder() -> None:
    """Refuse a TMPDIR in which the socket of worker processes has too long a path."""
    folder = tempfile.gettempdir()
    if sys.platform == "linux" and len(os.fsencode(folder)) > _SOCKET - len(_SOCKET_NAME):
        from deqmcl_gym.validation import InputError

        raise InputError(
            f"TMPDIR is {folder}, which is too long for the sockets of worker processes: set it to "
            f"a folder of at most {_SOCKET - len(_SOCKET_NAME)} bytes."
        )


@contextmanager
def sheltered() -> Iterator[None]:
    """Let processes started here have one thread and our modules, and leave Ctrl-C to this one.

    A process inherits the environment, which libraries read when they are loaded, and the signal
    mask, which multiprocessing's resource tracker, started with the first one, would clear.
    """
    _refuse_long_folder()
    masked = hasattr(signal, "pthread_sigmask")
    with _ONE_STARTS:
        before = {name: os.environ.get(name) for name in _ENVIRONMENT}
        os.environ.update(_ENVIRONMENT)
        if masked:
            resource_tracker.ensure_running()
            mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            if masked:
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            for name in _ENVIRONMENT:
                del os.environ[name]
            os.environ.update({name: value for name, value in before.items() if value is not None})


def unshelter() -> None:
    """Let programs that a worker starts find their modules as ever."""
    if _SAFE_PATH.items() <= os.environ.items():
        del os.environ["PYTHONSAFEPATH"]
