"""Rates of jobs that take turns."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median


@dataclass(frozen=True)
class Job:
    """Work that can be done again and again.

    Attributes:
        call: does it once.
        amount: how many units (rays, steps) that is.
        clock: measures seconds; CPU time by default.
    """

    call: Callable[[], object]
    amount: float = 1.0
    clock: Callable[[], float] = time.process_time


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How often each job has its turn, and the seconds that a turn takes at least."""

    repeats: int
    seconds: float


def rates(jobs: Sequence[Job], effort: Effort) -> list[float]:
    """Units per second of each job, the median of its turns.

    The jobs take turns (first, second, …, first, second, …), so that what else the machine does
    meets all of them.
    """
    calls = [_calls(job, effort.seconds) for job in jobs]
    turns = [
        [job.amount * count / _seconds(job, count) for job, count in zip(jobs, calls, strict=True)]
        for _ in range(effort.repeats)
    ]
    return [median(seen) for seen in zip(*turns, strict=True)]


def _calls(job: Job, seconds: float) -> int:
    """How many calls fill a turn; found by doubling, after a first call that may compile."""
    job.call()
    count = 1
    while (taken := _seconds(job, count)) < seconds / 2:
        count *= 2
    return max(1, round(count * seconds / taken))


def _seconds(job: Job, count: int) -> float:
    call, clock = job.call, job.clock
    start = clock()
    for _ in range(count):
        call()
    return max(clock() - start, 1e-9)  # a clock that did not tick in so short a time
