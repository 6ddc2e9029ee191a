"""Dask, by its own ``Executor``: a cluster that runs already, or processes of this machine."""

import contextlib
import logging
import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from benchmarks.execution.starting import ONE_THREAD
from deqmcl_gym.validation import InputError, in_words

CONNECT_SECONDS = 10  # how long a scheduler may take to answer
_CLOSE_SECONDS = 1


def check(scheduler: str | None) -> None:
    """See whether Dask is installed, and a scheduler answers and has workers.

    Raises:
        InputError: it is not, or does not.
    """
    require()
    from distributed.comm.addressing import resolve_address

    if scheduler is not None:
        with _reaching(scheduler):
            resolve_address(scheduler)
        with cluster(0, scheduler):
            pass


def require() -> Any:
    """Return the package ``distributed``.

    Raises:
        InputError: it is not installed.
    """
    try:
        import distributed
    except ImportError:
        raise InputError(
            "Dask is not installed: run pip install 'deqmcl-gym[dask]', or leave out "
            "--executor dask."
        ) from None
    return distributed


@contextmanager
def cluster(workers: int, scheduler: str | None) -> Iterator[tuple[Executor, int]]:
    """Give the executor of a cluster and how many threads it has.

    Args:
        workers: processes to start, if there is no scheduler.
        scheduler: address of one that runs; it is left running.

    Raises:
        InputError: the scheduler does not answer, or has no workers.
    """
    place: Any = _local(workers) if scheduler is None else contextlib.nullcontext(scheduler)
    with place as address, _client(address) as client:
        threads = sum(client.nthreads().values())
        if threads == 0:
            raise InputError(f"the Dask scheduler {scheduler} has no workers: start some.")
        yield client.get_executor(retries=0), threads


@contextmanager
def _local(workers: int) -> Iterator[Any]:
    """Start worker processes of one thread each; at the end, kill them in whatever they do."""
    own = require().LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        dashboard_address=None,
        env=ONE_THREAD,
        silence_logs=logging.CRITICAL,
    )
    try:
        yield own
    finally:
        for nanny in own.workers.values():  # one looks after each process, and would restart it
            nanny.auto_restart = False
            with contextlib.suppress(OSError, TypeError):  # it is gone
                os.kill(nanny.pid, signal.SIGKILL)
        with contextlib.suppress(TimeoutError):
            own.close(timeout=_CLOSE_SECONDS)


@contextmanager
def _client(address: Any) -> Iterator[Any]:
    made = require().Client
    client = made.__new__(made)
    try:
        with _reaching(address):
            client.__init__(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except InputError:
        client.status = "closed"  # or it tries to close what was never open, and prints that
        raise
    try:
        yield client
    finally:
        with contextlib.suppress(TimeoutError):
            client.close(timeout=_CLOSE_SECONDS)


@contextmanager
def _reaching(address: Any) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # each transport has its own
        raise InputError(
            f"the Dask scheduler {address!r} cannot be reached ({in_words(error)}): give an "
            "address like tcp://host:8786."
        ) from None
