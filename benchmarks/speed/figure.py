"""What is compared with what, and what came out."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec

from benchmarks.speed.timing import Effort, Job, rates

MICROSECONDS = "µs/step"
_APART = {"particles": "particles==0.4"}  # wants another NumPy than the extra ``peers``
Sides = tuple[Job, Job | float]  # a number is what others say of theirs, in the figure's unit


class UnavailableError(Exception):
    """A figure cannot be measured here; the text says why."""


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A ratio of two rates, or, if the unit is ``MICROSECONDS``, of two times.

    Attributes:
        name: of the figure.
        task: what both sides do.
        ours, other: who they are.
        unit: of both sides.
        target: the least ratio of rates, or the largest of times, that is aimed at.
        sides: makes both jobs; raises ``UnavailableError`` where that is impossible.
        peer: a package of the extra ``peers`` that the other side needs.
    """

    name: str
    task: str
    ours: str
    other: str
    unit: str
    sides: Callable[[], Sides]
    target: float | None = None
    peer: str | None = None

    @property
    def aim(self) -> str:
        """The target in signs."""
        if self.target is None:
            return ""
        return f"{'≤' if self.unit == MICROSECONDS else '≥'} {self.target:,g}"


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A figure's two sides in its unit."""

    figure: Figure
    ours: float
    other: float

    @property
    def ratio(self) -> float:
        """Ours over the other's: how many times our rate, or our time, is theirs."""
        return self.ours / self.other

    @property
    def reached(self) -> bool | None:
        """Whether the target is; None if there is none."""
        target = self.figure.target
        if target is None:
            return None
        return self.ratio <= target if self.figure.unit == MICROSECONDS else self.ratio >= target


def measured(figure: Figure, effort: Effort) -> Measured:
    """Measure a figure.

    Raises:
        UnavailableError: with the reason.
    """
    job, beside = figure.sides()
    if isinstance(beside, Job):
        ours, other = (in_unit(rate, figure.unit) for rate in rates([job, beside], effort))
    else:
        ours, other = in_unit(rates([job], effort)[0], figure.unit), beside
    return Measured(figure=figure, ours=ours, other=other)


def in_unit(rate: float, unit: str) -> float:
    """Return a rate per second, as a time if ``unit`` is one."""
    return 1e6 / rate if unit == MICROSECONDS else rate


def _is_there(package: str) -> bool:
    try:
        return find_spec(package) is not None
    except ModuleNotFoundError:  # not even the package that it is part of
        return False


def require(package: str) -> None:
    """Refuse to go on without an optional package.

    Raises:
        UnavailableError: naming the pip command.
    """
    if not _is_there(package):
        wanted = _APART.get(package, "deqmcl-gym[peers]")
        raise UnavailableError(f"not installed (pip install '{wanted}'; see docs/speed.md)")
