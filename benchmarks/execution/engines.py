"""The engines a sweep can run on, and what keeps them busy with trials.

An engine gives an ``Executor`` for as long as it is needed: this process, processes of this
machine, Dask's (a cluster that runs already, or processes), or one of the user's.
"""

import contextlib
import importlib
import logging
import math
import os
import pickle
import signal
import sys
import sysconfig
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.execution.processes import PATIENCE, Processes, TimedOutError, WorkerDiedError
from benchmarks.execution.starting import ONE_THREAD
from benchmarks.trials.attempt import Outcome, attempt
from benchmarks.trials.plugins import guest_of
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError, in_words, integer, number
from localizers.digests import OURS
from localizers.naming.own_process import safe_path
from localizers.registry import LOCALIZER

CONNECT_SECONDS = 10  # how long a scheduler may take to answer
_CLOSE_SECONDS, _LOOK_SECONDS = 1, 2


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
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what is lost, we say
    return distributed


@contextmanager
def cluster(workers: int, scheduler: str | None) -> Iterator[tuple[Executor, int, Any]]:
    """Give the executor of a cluster, how many threads it has, and the client.

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
        yield client.get_executor(retries=0), threads, client


@contextmanager
def _local(workers: int) -> Iterator[Any]:
    """Start worker processes of one thread each; at the end, kill them in whatever they do."""
    made = require().LocalCluster
    with safe_path():
        own = made(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            env={**ONE_THREAD, "PYTHONSAFEPATH": ""},
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


TRIES = 3  # of a trial whose worker dies

_InFlight = dict[Future[Outcome], tuple[str, Trial, float]]  # key, trial, when it was submitted


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


@dataclass(frozen=True, kw_only=True)
class Where:
    """Where trials run. No part of a sweep's identity: the numbers do not depend on it.

    Attributes:
        jobs: trials at a time; None: one per processor, or per thread of the Dask cluster.
        executor: "process", "dask" or "module:factory".
        scheduler: address of a Dask scheduler; None starts a cluster on this machine.
        timeout: seconds that one trial may take; None waits for ever.
    """

    jobs: int | None = None
    executor: str = "process"
    scheduler: str | None = None
    timeout: float | None = None

    def __post_init__(self) -> None:
        if self.jobs is not None:
            integer("--jobs", self.jobs, low=1)
        if self.timeout is not None:
            number("--timeout", self.timeout, low=0, high=1e6, above=True)
        if self.scheduler is not None and self.executor != "dask":
            raise InputError(
                f"--scheduler is for Dask, but the executor is {self.executor!r}: "
                "give --executor dask."
            )
        if self.executor not in ("process", "dask") and ":" not in self.executor:
            raise InputError(
                f"the executor is {self.executor!r}, but must be process, dask or module:factory."
            )

    def check(self) -> None:
        """See whether the engine can be had, before anything is written.

        Raises:
            InputError: it is not installed, or there is none of this name or address.
        """
        if self.executor == "dask":
            check(self.scheduler)
        elif self.executor != "process":
            _factory(self.executor)

    @contextmanager
    def engine(self, trials: Collection[Trial]) -> Iterator[Engine]:
        """Start an engine for these trials, and end it with all that still runs.

        Raises:
            InputError: it cannot be had, or does not know a localizer that is registered here.
        """
        guests = any(map(guest_of, trials))
        timeout = PATIENCE if guests and self.timeout is None else self.timeout
        if self.executor == "dask":
            place = cluster(self.jobs or available_cpus(), self.scheduler)
            with place as (executor, threads, client):
                _refuse_unknown(executor, trials)

                def lost() -> str:
                    gone = client.status not in ("running", "connecting")
                    return "the Dask scheduler is lost" if gone else ""

                slots = self.jobs or threads
                yield Engine(executor=executor, slots=slots, timeout=timeout, lost=lost)
        elif self.executor == "process":
            workers = max(1, min(self.jobs or available_cpus(), len(trials)))
            with Processes(
                workers, timeout=self.timeout, guest_of=lambda trial, *_: guest_of(trial)
            ) as executor:
                here = workers == 1 and self.timeout is None
                own = ThisProcess(executor) if here else Sending(executor)
                _refuse_unknown(own, trials)
                # one trial waits beside the workers, so that none waits for the store
                yield Engine(executor=own, slots=1 if here else workers + 1)
        else:
            with _made_by(self.executor) as executor:
                _refuse_unknown(executor, trials)
                yield Engine(
                    executor=executor, slots=self.jobs or available_cpus(), timeout=timeout
                )


def _refuse_unknown(executor: Executor, trials: Iterable[Trial]) -> None:
    """Refuse a localizer that is registered here, but not where its trials run."""
    asked = {(t.localizer, guest_of(t)): t for t in trials if LOCALIZER.is_registered(t.localizer)}
    for trial in asked.values():
        with contextlib.suppress(RuntimeError):  # the process died: its trials will tell
            if not executor.submit(_knows, trial).result():
                raise InputError(
                    f"the localizer {trial.localizer!r} is registered in this process only, but "
                    "its trials would run in others, which it cannot be sent to: leave out "
                    "the executor, take agents and scenarios of ours, or name it as file.py:NAME."
                )


def _knows(trial: Trial) -> bool:
    return LOCALIZER.is_registered(trial.localizer)


class ThisProcess(Executor):
    """Runs each call where it is submitted, those of guests in their own processes.

    Of other people's code only what was given to ``localizers.register`` is run here: this process
    has loaded it already, and no other knows it.
    """

    def __init__(self, guests: Processes) -> None:
        self._guests = guests

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call ``fn``; if that would end this process, its future fails as a dead worker's."""
        if self._guests.guest_of(*args):
            return self._guests.submit(fn, *args, **kwargs)
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except SystemExit as end:
            future.set_exception(WorkerDiedError(f"it called exit({end.code!r})"))
        except Exception as error:
            future.set_exception(error)
        return future


class Sending(Executor):
    """Processes that are sent what was registered here with each trial of it, unless they know it.

    They know what a script registers at its top level, which they run, too.
    """

    def __init__(self, processes: Processes) -> None:
        self._processes = processes
        self._packed: dict[str, bytes] = {}

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have ``fn(trial, …)`` run by a process that knows the trial's localizer.

        Raises:
            InputError: the localizer is registered here only, and cannot be sent.
        """
        trial, *rest = args
        if not LOCALIZER.is_registered(name := trial.localizer):
            return self._processes.submit(fn, *args, **kwargs)
        if name not in self._packed:
            self._packed[name] = b"" if self._is_known(trial) else _packed(name)
        if not (packed := self._packed[name]):
            return self._processes.submit(fn, *args, **kwargs)
        return self._processes.submit(_with_sent, trial, packed, fn, *rest)

    def _is_known(self, trial: Trial) -> bool:
        try:
            return bool(self._processes.submit(_knows, trial).result())
        except RuntimeError:  # the process died: its trials will tell
            return True


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
    if not LOCALIZER.is_registered(trial.localizer):
        LOCALIZER.receive(trial.localizer, pickle.loads(packed))
    return fn(trial, *rest)


def available_cpus() -> int:
    """Return how many processors this process may use, at least 1: by affinity and by quota."""
    affinity = getattr(os, "sched_getaffinity", None)  # not everywhere
    own = len(affinity(0)) if affinity else os.cpu_count() or 1
    return max(1, math.ceil(min(own, _quota())))


def _quota(groups: Path = Path("/sys/fs/cgroup")) -> float:
    """Processors' worth of time that a container gets; ∞ without a limit."""
    first = [groups / "cpu" / f"cpu.cfs_{part}_us" for part in ("quota", "period")]
    for files in ([groups / "cpu.max"], first):  # control groups of versions 2 and 1
        with contextlib.suppress(OSError, ValueError):  # none there; "max" is no number
            quota, period = map(int, " ".join(file.read_text() for file in files).split())
            return quota / period if quota > 0 else math.inf
    return math.inf


def outcomes(
    jobs: Iterable[tuple[str, Trial]], engine: Engine
) -> Generator[tuple[str, Outcome], None, None]:
    """Run (key, trial) pairs; yield (key, outcome) as they finish.

    No more than ``engine.slots`` are in flight, so that what is stopped or lost is little. A trial
    that its engine loses (its worker died) is tried again; one that hangs is not, and keeps its
    slot: what else is sent to that worker would wait behind it.

    Raises:
        RuntimeError: the engine itself broke, or hangs in all its slots.
    """
    waiting = deque(jobs)
    tries: Counter[str] = Counter()
    in_flight: _InFlight = {}
    hung: list[Future[Outcome]] = []
    while waiting or in_flight:
        if len(hung) == engine.slots:
            raise RuntimeError(
                f"all {len(hung)} workers hang; finished trials are kept, run the command again "
                "for the rest."
            )
        while waiting and len(in_flight) + len(hung) < engine.slots:
            key, trial = waiting.popleft()
            future = engine.executor.submit(attempt, trial, key)
            in_flight[future] = key, trial, time.monotonic()
            if future.done():
                break  # an engine that runs it here: take it at once
        for future in _landed(in_flight, engine):
            key, trial, _ = in_flight.pop(future)
            if not future.done():
                hung.append(future)
                yield key, Outcome(reason=f"no result within {engine.timeout:g} s")
                continue
            tries[key] += 1
            outcome = _outcome(future, tries[key])
            if outcome is None:
                waiting.appendleft((key, trial))
            else:
                yield key, outcome


def _landed(in_flight: _InFlight, engine: Engine) -> set[Future[Outcome]]:
    """Wait for futures that are done, or have been in flight for too long."""
    first, longest = min(began for _, _, began in in_flight.values()), engine.timeout or math.inf
    while True:
        left = max(0.0, first + longest - time.monotonic())
        patience = min(left, math.inf if engine.lost is None else _LOOK_SECONDS)
        limit = None if math.isinf(patience) else patience
        if done := wait(in_flight, timeout=limit, return_when=FIRST_COMPLETED).done:
            return done
        late = time.monotonic() - longest
        if over := {future for future, (_, _, began) in in_flight.items() if began <= late}:
            return over
        if engine.lost is not None and (why := engine.lost()):
            raise RuntimeError(f"{why}; finished trials are kept, run the command again.")


def _outcome(future: Future[Outcome], tries: int) -> Outcome | None:
    """Return what came of a trial; None to try again."""
    try:
        return future.result()
    except TimedOutError as error:
        return Outcome(reason=str(error))
    except BrokenExecutor as error:
        words = str(error) or in_words(error)
        raise RuntimeError(f"the executor broke ({words}); finished trials are kept.") from error
    except (Exception, SystemExit) as error:  # of the engine: a trial's own errors are outcomes
        if tries < TRIES:
            return None
        return Outcome(reason=f"lost {tries} times by its worker; last: {in_words(error)}")


def _factory(name: str) -> Callable[[], Executor]:
    module, _, attribute = name.partition(":")
    try:
        factory = getattr(importlib.import_module(module), attribute)
    except Exception as error:
        raise InputError(
            f"the executor {name!r} cannot be loaded ({in_words(error)}): give module:factory, a "
            "function without arguments that returns a concurrent.futures.Executor."
        ) from None
    if not callable(factory):
        kind = type(factory).__name__
        raise InputError(f"the executor {name!r} is of type {kind}, but must be a function.")
    return factory  # type: ignore[no-any-return]


@contextmanager
def _made_by(name: str) -> Iterator[Executor]:
    factory = _factory(name)
    try:
        executor = factory()
    except Exception as error:
        raise InputError(
            f"the executor {name!r} cannot be made ({in_words(error)}): give a function without "
            "arguments that returns a concurrent.futures.Executor."
        ) from error
    if not isinstance(executor, Executor) or type(executor).submit is Executor.submit:
        raise InputError(
            f"the executor {name!r} returned an object of type {type(executor).__name__}, but "
            "must return a concurrent.futures.Executor that runs what is submitted."
        )
    try:
        yield executor
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
