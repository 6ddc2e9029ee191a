"""The engines a sweep can run on, and what keeps them busy with trials.

An engine gives an ``Executor`` for as long as it is needed: this process, processes of this
machine, Dask's (a cluster that runs already, or processes), or one of the user's.
"""

import contextlib
import math
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.execution import executors
from benchmarks.execution.executors import Engine, Sending
from benchmarks.execution.processes import PATIENCE, Processes, TimedOutError, WorkerDiedError
from benchmarks.trials.attempt import Outcome, attempt
from benchmarks.trials.plugins import guest_of
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError, in_words, integer, number

TRIES = 3  # of a trial whose worker dies
_LOOK_SECONDS = 2

_InFlight = dict[Future[Outcome], tuple[str, Trial, float]]  # key, trial, when it was submitted


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
        """See whether the engine can be had, before anything is written."""
        if self.executor == "dask":
            executors.distributed()
            if self.scheduler is not None:
                with executors.dask(0, self.scheduler):
                    pass
        elif self.executor != "process":
            executors.factory(self.executor)

    @contextmanager
    def engine(self, trials: Collection[Trial]) -> Iterator[Engine]:
        """Start an engine for these trials, and end it with all that still runs."""
        jobs = self.jobs or available_cpus()
        if self.executor == "process":
            place = self._processes(max(1, min(jobs, len(trials))))
        elif self.executor == "dask":
            place = self._elsewhere(executors.dask(jobs, self.scheduler), trials)
        else:
            place = self._elsewhere(executors.made_by(self.executor, jobs), trials)
        with place as engine:
            yield engine

    @contextmanager
    def _elsewhere(
        self, place: AbstractContextManager[Engine], trials: Collection[Trial]
    ) -> Iterator[Engine]:
        """Give an engine that does not look after the time of its trials."""
        guests = any(map(guest_of, trials))
        timeout = PATIENCE if guests and self.timeout is None else self.timeout
        with place as engine:
            sending, slots = Sending(engine.executor), self.jobs or engine.slots
            yield replace(engine, executor=sending, slots=slots, timeout=timeout)

    @contextmanager
    def _processes(self, workers: int) -> Iterator[Engine]:
        with Processes(
            workers, timeout=self.timeout, guest_of=lambda trial, *_: guest_of(trial)
        ) as processes:
            if workers == 1 and self.timeout is None:
                yield Engine(executor=ThisProcess(processes), slots=1)
            else:  # one trial waits beside the workers, so that none waits for the store
                yield Engine(executor=Sending(processes), slots=workers + 1)


class ThisProcess(Executor):
    """Runs each call where it is submitted, those of guests in their own processes.

    Of other people's code only what was given to ``localizers.register`` is run here: this process
    has loaded it already, and no other knows it.
    """

    def __init__(self, guests: Processes) -> None:
        self._guests, self._sending = guests, Sending(guests)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call ``fn``; if that would end this process, its future fails as a dead worker's."""
        if self._guests.guest_of(*args):
            return self._sending.submit(fn, *args, **kwargs)
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except SystemExit as end:
            future.set_exception(WorkerDiedError(f"it called exit({end.code!r})"))
        except Exception as error:
            future.set_exception(error)
        return future


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
