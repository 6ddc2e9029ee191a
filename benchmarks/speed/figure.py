"""What is compared with what, and what came out."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.speed.timing import Effort, Job, rates

_PER_SECOND = {"µs/step": 1e6, "µs/scan": 1e6, "ms/trial": 1e3}  # units of time, in a second


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


@dataclass(frozen=True, kw_only=True)
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


def is_time(unit: str) -> bool:
    """Whether less is faster."""
    return unit in _PER_SECOND


def in_unit(rate: float, unit: str) -> float:
    """Return a rate per second, as a time if ``unit`` is one."""
    return _PER_SECOND[unit] / rate if is_time(unit) else rate
