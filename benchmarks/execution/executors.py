"""Executors past the processes of this machine: of Dask or of the user; what they are sent."""

import contextlib
import importlib
import logging
import os
import pickle
import signal
import sys
import sysconfig
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.execution.starting import ONE_THREAD, sheltered
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError, in_words
from localizers.digests import OURS
from localizers.registry import LOCALIZER

CONNECT_SECONDS = 10  # how long a scheduler may take to answer
_CLOSE_SECONDS = 1


@dataclass(frozen=True, kw_only=True)
class Engine:
    """What trials are submitted to.

    Attributes:
        executor: any ``concurrent.futures.Executor``.
        slots: trials in flight at a time.
        timeout: seconds after which a trial in flight is given up; None if the executor sees to it.
        lost: says why nothing more will come of it; "" if it works.
    """

    executor: Executor
    slots: int
    timeout: float | None = None
    lost: Callable[[], str] | None = None


def distributed() -> Any:
    """Return the package ``distributed``."""
    try:
        import distributed
    except ImportError:
        raise InputError(
            "Dask is not installed: run pip install 'deqmcl-gym[dask]', or leave out "
            "--executor dask."
        ) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what is lost, we say
    return distributed


@contextmanager
def dask(workers: int, scheduler: str | None) -> Iterator[Engine]:
    """Connect to a cluster."""
    package = distributed()
    with ExitStack() as stack:
        address = scheduler or stack.enter_context(_local(package, workers))
        try:
            client = package.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
        except Exception as error:  # each transport has its own
            raise InputError(
                f"the Dask scheduler {address!r} cannot be reached ({in_words(error)}): give an "
                "address like tcp://host:8786."
            ) from None
        stack.callback(_close, client)
        if (threads := sum(client.nthreads().values())) == 0:
            raise InputError(f"the Dask scheduler {scheduler} has no workers: start some.")

        def lost() -> str:
            gone = client.status not in ("running", "connecting")
            return "the Dask scheduler is lost" if gone else ""

        yield Engine(executor=client.get_executor(retries=0), slots=threads, lost=lost)


@contextmanager
def _local(package: Any, workers: int) -> Iterator[Any]:
    """Start worker processes of one thread each; at the end, kill them in whatever they do."""
    with sheltered():
        cluster = package.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            dashboard_address=None,
            env={**ONE_THREAD, "PYTHONSAFEPATH": ""},
            silence_logs=logging.CRITICAL,
        )
    try:
        yield cluster
    finally:
        for nanny in cluster.workers.values():  # one looks after each process, and would restart it
            nanny.auto_restart = False
            with contextlib.suppress(OSError, TypeError):  # it is gone
                os.kill(nanny.pid, signal.SIGKILL)
        _close(cluster)


def _close(connected: Any) -> None:
    with contextlib.suppress(TimeoutError):
        connected.close(timeout=_CLOSE_SECONDS)


@contextmanager
def made_by(name: str, slots: int) -> Iterator[Engine]:
    """Call ``module:factory``; shut down what it returns at the end."""
    try:
        executor = factory(name)()
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            f"the executor {name!r} cannot be made ({in_words(error)}){_MUST}"
        ) from error
    if not isinstance(executor, Executor) or type(executor).submit is Executor.submit:
        kind = type(executor).__name__
        raise InputError(f"the executor {name!r} returned an object of type {kind}{_MUST}")
    try:
        yield Engine(executor=executor, slots=slots)
    finally:
        executor.shutdown(wait=False, cancel_futures=True)


def factory(name: str) -> Callable[[], Executor]:
    """Return what ``module:factory`` leads to."""
    module, _, attribute = name.partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except Exception as error:
        raise InputError(
            f"the executor {name!r} cannot be loaded ({in_words(error)}){_MUST}"
        ) from None
    if not callable(found):
        raise InputError(f"the executor {name!r} is of type {type(found).__name__}{_MUST}")
    return found  # type: ignore[no-any-return]


_MUST = (
    ": give module:factory, a function without arguments that returns a "
    "concurrent.futures.Executor that runs what is submitted."
)


class Sending(Executor):
    """An executor that is sent what was registered in this process with each trial of it."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._packed: dict[str, bytes] = {}

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have ``fn(trial, …)`` run where the trial's localizer is known."""
        trial, *rest = args
        if (name := trial.localizer) not in LOCALIZER.added:
            return self._executor.submit(fn, *args, **kwargs)
        if name not in self._packed:
            self._packed[name] = _packed(name)
        return self._executor.submit(_with_sent, trial, self._packed[name], fn, *rest)


def _packed(name: str) -> bytes:
    """Return a registered localizer as bytes, with the code of its module if that is one's own."""
    import cloudpickle

    factory: Any = LOCALIZER.resolve(name)
    whole = factory
    while isinstance(whole, partial):
        whole = whole.func
    home = sys.modules.get(getattr(whole, "__module__", ""))
    ours = [Path(__file__).parents[2] / package for package in OURS]
    installed = [*map(Path, (sys.prefix, *sysconfig.get_paths().values())), *ours]
    file = getattr(home, "__file__", None)
    try:
        with contextlib.ExitStack() as stack:
            if (
                home is not None
                and file is not None
                and not any(Path(file).is_relative_to(place) for place in installed)
            ):
                cloudpickle.register_pickle_by_value(home)
                stack.callback(cloudpickle.unregister_pickle_by_value, home)
            return bytes(cloudpickle.dumps(factory))
    except Exception as error:
        raise InputError(
            f"the localizer {name!r} cannot be sent to other processes ({in_words(error)}): give "
            "jobs=1, or name it as file.py:NAME."
        ) from None


def _with_sent(trial: Trial, packed: bytes, fn: Callable[..., Any], *rest: Any) -> Any:
    if trial.localizer not in LOCALIZER.added:
        LOCALIZER.added[trial.localizer] = pickle.loads(packed)
        LOCALIZER.received.add(trial.localizer)
    return fn(trial, *rest)
