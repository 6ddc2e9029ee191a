"""What is compared with what: jobs that take turns, and the ratio of their rates."""

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from tabulate import tabulate

_PER_SECOND = {"µs/step": 1e6, "µs/scan": 1e6, "ms/trial": 1e3}  # units of time, in a second


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


@dataclass(frozen=True)
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


@dataclass(frozen=True)
class Side:
    """Who does the work, and what makes its job."""

    who: str
    job: Callable[[], Job]


@dataclass(frozen=True)
class Published:
    """What somebody else measured on another machine, in the unit of ours."""

    who: str
    value: float


@dataclass(frozen=True)
class Figure:
    """A rate or a time of ours beside another.

    Attributes:
        name: of the figure.
        what: both sides do.
        unit: of both sides.
        ours, other: the sides.
        target: the least ratio of rates, or the largest of times, that is aimed at.
    """

    name: str
    what: str
    unit: str
    ours: Side
    other: Side | Published
    target: float | None = None


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A figure's two sides in its unit; ours over the other's, NaN beside another machine's."""

    figure: Figure
    ours: float
    other: float
    ratio: float

    @property
    def verdict(self) -> str:
        """Whether the target is reached, in a word; "" without a target."""
        target = self.figure.target
        if target is None:
            return ""
        reached = self.ratio <= target if is_time(self.figure.unit) else self.ratio >= target
        return "yes" if reached else "missed"


def measured(figure: Figure, effort: Effort) -> Measured:
    """Measure a figure.

    Raises:
        ImportError: the other side is not installed.
    """
    ours, other = figure.ours, figure.other
    if isinstance(other, Published):
        (rate,) = rates([ours.job()], effort)
        mine, theirs, ratio = in_unit(rate, figure.unit), other.value, math.nan
    else:
        seen = rates([ours.job(), other.job()], effort)
        mine, theirs = (in_unit(rate, figure.unit) for rate in seen)
        ratio = mine / theirs
    return Measured(figure=figure, ours=mine, other=theirs, ratio=ratio)


def figures_table(rows: Iterable[Measured], style: str) -> str:
    """Return the figures as a table; ``style`` is a format of tabulate."""
    lines = []
    for row in rows:
        unit, target = row.figure.unit, row.figure.target
        aim = "" if target is None else f"{'≤' if is_time(unit) else '≥'} {target:,g}"
        sides = amount(row.ours, unit), amount(row.other, unit)
        lines.append([row.figure.name, *sides, three_digits(row.ratio), aim, row.verdict])
    header = ["figure", "ours", "other", "ratio", "target", "reached"]
    align = ("left", "right", "right", "right", "right", "left")
    return tabulate(lines, header, tablefmt=style, disable_numparse=True, colalign=align)


def is_time(unit: str) -> bool:
    """Whether less is faster."""
    return unit in _PER_SECOND


def in_unit(rate: float, unit: str) -> float:
    """Return a rate per second, as a time if ``unit`` is one."""
    return _PER_SECOND[unit] / rate if is_time(unit) else rate


def amount(value: float, unit: str) -> str:
    """Three digits and the unit: 203 M rays/s."""
    if value >= 1e4 and not is_time(unit):
        size, prefix = (1e6, "M") if value >= 1e6 else (1e3, "k")
        return f"{three_digits(value / size)} {prefix} {unit}"
    return f"{three_digits(value)} {unit}"


def three_digits(value: float) -> str:
    """At least three digits, no exponent; "" for NaN."""
    places = 0 if value >= 100 else 1 if value >= 10 else 2
    return "" if math.isnan(value) else f"{value:,.{places}f}"


def digits(value: float) -> str:
    """Six digits, for CSV files; "" for NaN."""
    return "" if math.isnan(value) else f"{value:.6g}"
