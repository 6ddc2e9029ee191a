"""CPU time of jobs that take turns."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median

Clock = Callable[[], float]


@dataclass(frozen=True, kw_only=True)
class Job:
    """Work that can be done again and again.

    Attributes:
        call: does it once.
        amount: how many units (rays, steps) that is.
    """

    call: Callable[[], object]
    amount: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How long to measure.

    Attributes:
        repeats: how often each job has its turn.
        seconds: of CPU time, which a turn takes at least.
    """

    repeats: int
    seconds: float


def rates(jobs: Sequence[Job], effort: Effort, clock: Clock = time.process_time) -> list[float]:
    """Units per second of CPU time of each job, the median of its turns.

    The jobs take turns (first, second, …, first, second, …), so that what else the machine does
    meets all of them.
    """
    calls = [_calls(job, effort.seconds, clock) for job in jobs]
    turns: list[list[float]] = [[] for _ in jobs]
    for _ in range(effort.repeats):
        for job, count, seen in zip(jobs, calls, turns, strict=True):
            seen.append(job.amount * count / _seconds(job, count, clock))
    return [median(seen) for seen in turns]


def _calls(job: Job, seconds: float, clock: Clock) -> int:
    """How many calls fill a turn; found by doubling, after a first call that may compile."""
    job.call()
    count = 1
    while (taken := _seconds(job, count, clock)) < seconds / 2:
        count *= 2
    return max(1, round(count * seconds / taken))


def _seconds(job: Job, count: int, clock: Clock) -> float:
    call = job.call
    start = clock()
    for _ in range(count):
        call()
    return max(clock() - start, 1e-9)  # a clock that did not tick in so short a time
