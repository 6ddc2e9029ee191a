"""Engines that run trials, in this process, others or Dask's; what keeps them busy."""

import contextlib
import logging
import math
import os
import pickle
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.execution.processes import GUEST_SECONDS, Processes, TimedOutError, WorkerDiedError
from benchmarks.trials import Trial
from benchmarks.trials.stage import Outcome, attempt, guest_of
from deqmcl_gym.validation import InputError, in_words, integer, number
from localizers.digests import is_users
from localizers.registry import LOCALIZER

TRIES = 3  # of a trial whose worker dies
CONNECT_SECONDS = 10  # how long a scheduler may take to answer
_ALIKE = 64  # most trials of one episode that wait for the worker that has driven it
_LOOK_SECONDS = 2
_AGAIN = "finished trials are kept, run the command again for the rest"
_InFlight = dict[Future[Outcome], tuple[str, Trial, float]]  # key, trial, when it was submitted
Submit = Callable[[Trial, str], Future[Outcome]]  # of a trial and its key; can raise InputError


@dataclass(frozen=True, kw_only=True)
class Engine:
    """What trials are submitted to."""

    submit: Submit
    slots: int  # trials in flight at a time
    timeout: float | None = None  # s until a trial is given up; None: the engine sees to it
    lost: Callable[[], str] = str  # says why nothing more will come of it; "" if it works


@dataclass(frozen=True, kw_only=True)
class Where:
    """Where trials run. No part of a sweep's identity: the numbers do not depend on it."""

    jobs: int | None = None  #: trials at a time; None is one per processor, or thread of Dask
    dask: str | None = None  #: address of Dask's scheduler
    timeout: float | None = None  #: seconds that one trial may take; None waits for ever

    def __post_init__(self) -> None:
        if self.jobs is not None:
            integer("--jobs", self.jobs, low=1)
        if self.timeout is not None:
            number("--timeout", self.timeout, low=0, high=1e6, above=True)

    def check(self) -> None:
        """See whether the engine can be had, before anything is written."""
        if self.dask is not None:
            with _dask(self.dask):
                pass

    @contextmanager
    def engine(self, trials: Collection[Trial]) -> Iterator[Engine]:
        """Start an engine for these trials, and end it with all that still runs."""
        if self.dask is not None:
            with _dask(self.dask) as engine:
                patient = self.timeout is None and any(map(guest_of, trials))
                timeout = GUEST_SECONDS if patient else self.timeout
                yield replace(engine, slots=self.jobs or engine.slots, timeout=timeout)
            return
        workers = max(1, min(self.jobs or available_cpus(), len(trials)))
        with Processes(workers, timeout=self.timeout) as pool:
            sent = _sender(pool)
            if workers == 1 and self.timeout is None:
                yield Engine(submit=partial(_run_here, sent), slots=1)
            else:  # enough wait beside the workers that each has episodes of its own
                alike = max(Counter(trial.episode for trial in trials).values(), default=1)
                yield Engine(submit=sent, slots=workers * min(alike, _ALIKE) + 1)


def _run_here(elsewhere: Submit, trial: Trial, key: str) -> Future[Outcome]:
    """Run a trial here, or in a process of its own if it has plug-ins that others can load."""
    if guest_of(trial):
        return elsewhere(trial, key)
    future: Future[Outcome] = Future()
    try:
        future.set_result(attempt(trial, key))
    except SystemExit as end:
        future.set_exception(WorkerDiedError(f"it called exit({end.code!r})"))
    except Exception as error:
        future.set_exception(error)
    return future


def _sender(executor: Any) -> Submit:
    """Return what submits trials, each with the localizer registered in this process, if any."""
    packed, pooled = dict[str, bytes](), isinstance(executor, Processes)

    def submit(trial: Trial, key: str) -> Future[Outcome]:
        how = {"guest": guest_of(trial), "group": trial.episode} if pooled else {}
        if (name := trial.localizer) in LOCALIZER.added and name not in packed:
            packed[name] = _packed(name)
        sent: Future[Outcome] = executor.submit(_attempt, packed.get(name), trial, key, **how)
        return sent

    return submit


def _packed(name: str) -> bytes:
    """Return a registered localizer as bytes, with the code of its module if that is one's own."""
    import cloudpickle

    factory = made_by = LOCALIZER.resolve(name)
    while isinstance(made_by, partial):
        made_by = made_by.func
    home: Any = sys.modules.get(getattr(made_by, "__module__", ""))
    file = getattr(home, "__file__", None)
    try:
        with ExitStack() as stack:
            if file is not None and is_users(file):
                cloudpickle.register_pickle_by_value(home)
                stack.callback(cloudpickle.unregister_pickle_by_value, home)
            return bytes(cloudpickle.dumps(factory))
    except Exception as error:
        raise InputError(
            f"the localizer {name!r} cannot be sent to other processes ({in_words(error)}): give "
            "jobs=1, or name it as file.py:NAME."
        ) from None


def _attempt(packed: bytes | None, trial: Trial, key: str) -> Outcome:
    name = trial.localizer
    if packed is not None and LOCALIZER.received.get(name) != packed:
        LOCALIZER.added[name], LOCALIZER.received[name] = pickle.loads(packed), packed
    return attempt(trial, key)


@contextmanager
def _dask(scheduler: str) -> Iterator[Engine]:
    try:
        import distributed
    except ImportError:
        raise InputError(
            "Dask is not installed: run pip install 'deqmcl-gym[dask]', or leave out --dask."
        ) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what is lost, we say
    connected: Any = distributed.Client
    try:
        client = connected(scheduler, timeout=CONNECT_SECONDS, set_as_default=False)
    except Exception as error:  # each transport has its own
        raise InputError(
            f"the Dask scheduler {scheduler!r} cannot be reached ({in_words(error)}): give an "
            "address like tcp://host:8786."
        ) from None
    try:
        if (threads := sum(client.nthreads().values())) == 0:
            raise InputError(f"the Dask scheduler {scheduler} has no workers: start some.")

        def lost() -> str:
            works = client.status in ("running", "connecting")
            return "" if works else "the Dask scheduler is lost"

        yield Engine(submit=_sender(client.get_executor(retries=0)), slots=threads, lost=lost)
    finally:
        with contextlib.suppress(TimeoutError):
            client.close(timeout=1)


def available_cpus() -> int:
    """Return how many processors this process may use, at least 1: by affinity and by quota."""
    affinity = getattr(os, "sched_getaffinity", None)  # not everywhere
    cpus = len(affinity(0)) if affinity else os.cpu_count() or 1
    return max(1, math.ceil(min(cpus, _quota())))


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

    No more than ``engine.slots`` are in flight. A trial whose worker died is tried again; one that
    hangs is not, and keeps its slot. An engine that breaks, or hangs in all its slots, raises
    ``RuntimeError``.
    """
    waiting = deque(jobs)
    tries: Counter[str] = Counter()
    in_flight: _InFlight = {}
    hung = 0
    while waiting or in_flight:
        if hung == engine.slots:
            raise RuntimeError(f"all {hung} workers hang; {_AGAIN}.")
        while waiting and len(in_flight) + hung < engine.slots:
            key, trial = waiting.popleft()
            future = engine.submit(trial, key)
            in_flight[future] = key, trial, time.monotonic()
            if future.done():
                break  # an engine that runs it here: take it at once
        for future in _landed(in_flight, engine):
            key, trial, _ = in_flight.pop(future)
            if not future.done():
                hung += 1
                yield key, Outcome(reason=f"no result within {engine.timeout:g} s")
                continue
            tries[key] += 1
            if outcome := _outcome(future, tries[key]):
                yield key, outcome
            else:
                waiting.appendleft((key, trial))


def _landed(in_flight: _InFlight, engine: Engine) -> set[Future[Outcome]]:
    """Wait for futures that are done, or have been in flight for too long."""
    longest = engine.timeout or math.inf
    first = min(began for _, _, began in in_flight.values())
    while True:
        left = max(0.0, first + longest - time.monotonic())
        if done := wait(in_flight, min(left, _LOOK_SECONDS), FIRST_COMPLETED).done:
            return done
        late = time.monotonic() - longest
        if over := {future for future, (_, _, began) in in_flight.items() if began <= late}:
            return over
        if why := engine.lost():
            raise RuntimeError(f"{why}; {_AGAIN}.")


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
        lost = Outcome(reason=f"lost {tries} times by its worker; last: {in_words(error)}")
        return None if tries < TRIES else lost
