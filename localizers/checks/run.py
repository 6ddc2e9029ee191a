"""Try a localizer against the laws."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median
from typing import Any, Literal

import numpy as np

from deqmcl_gym.validation import number, one_of
from localizers.api import RobotModel
from localizers.checks.drive import default_robot, random_drive
from localizers.checks.laws import LAWS, Law
from localizers.checks.subject import LawBrokenError, LawSkippedError, Subject, beliefs
from localizers.naming.registry import Factory, is_registered, parameters_of, resolve

Status = Literal["ok", "FAILED", "skipped"]


@dataclass(frozen=True)
class Verdict:
    """What came of one law.

    Attributes:
        law: its name.
        status: "ok", "FAILED" or "skipped".
        note: the reason, or what was noticed; may be empty.
        error: what was raised, if it failed.
    """

    law: str
    status: Status
    note: str = ""
    error: BaseException | None = field(default=None, compare=False)

    def __str__(self) -> str:
        return f"{self.status:<8} {self.law}{': ' if self.note else ''}{self.note}"


@dataclass(frozen=True)
class Report:
    """What came of all laws.

    Attributes:
        name: of the localizer.
        verdicts: one per law, in their order.
    """

    name: str
    verdicts: tuple[Verdict, ...]

    @property
    def passed(self) -> bool:
        """Whether no law failed."""
        return not self.failed

    @property
    def failed(self) -> tuple[Verdict, ...]:
        """Verdicts of the laws that failed."""
        return tuple(verdict for verdict in self.verdicts if verdict.status == "FAILED")

    def __str__(self) -> str:
        return "\n".join([f"{self.name}:", *map(str, self.verdicts)])


def check_localizer(
    localizer: str | Factory,
    robot: RobotModel | None = None,
    *,
    timeout: float = 60.0,
    **params: Any,
) -> Report:
    """Try a localizer against all ``LAWS``; nothing it does is raised.

    Args:
        localizer: a name (see ``localizers.resolve``), or a factory itself.
        robot: what it is made for; a small room and eight beams if not given.
        timeout: s that a spawned process may take, its imports included.
        params: given to the factory.

    Raises:
        InputError: the name cannot be resolved, or a parameter is unknown.
    """
    subject = subject_of(localizer, robot, timeout=timeout, **params)
    return Report(subject.name, tuple(Examination(subject).verdicts()))


def subject_of(
    localizer: str | Factory,
    robot: RobotModel | None = None,
    *,
    timeout: float = 60.0,
    **params: Any,
) -> Subject:
    """Return what is to be checked; arguments as of ``check_localizer``."""
    factory = resolve(localizer) if isinstance(localizer, str) else localizer
    name = localizer if isinstance(localizer, str) else getattr(factory, "__name__", repr(factory))
    known = parameters_of(factory)
    for param in params:
        if known is not None:
            one_of(f"parameter of localizer {name!r}", param, known)
    model = default_robot() if robot is None else robot
    here = not isinstance(localizer, str) or is_registered(localizer)
    return Subject(
        name=name,
        factory=factory,
        params=params,
        robot=model,
        drive=random_drive(model, np.random.default_rng(0)),
        sent=factory if here else localizer,
        timeout=number("the timeout", timeout, low=0, above=True),
    )


class Examination:
    """Tries laws on a localizer, each at most once, those that it needs before."""

    def __init__(self, subject: Subject) -> None:
        self.subject = subject
        self._tried: dict[Law, Verdict] = {}

    def verdict(self, law: Law) -> Verdict:
        """Try a law; skipped if one that it needs is broken."""
        if law not in self._tried:
            self._tried[law] = self._try(law)
        return self._tried[law]

    def verdicts(self) -> Iterator[Verdict]:
        """Try all laws in turn."""
        return map(self.verdict, LAWS)

    def _try(self, law: Law) -> Verdict:
        need = law.needs
        while need is not None:
            if self.verdict(need).status == "FAILED":
                return Verdict(law.name, "skipped", f"it fails {need.name!r}")
            need = need.needs
        try:
            return Verdict(law.name, "ok", law(self.subject) or "")
        except LawSkippedError as skipped:
            return Verdict(law.name, "skipped", str(skipped))
        except LawBrokenError as error:
            return Verdict(law.name, "FAILED", str(error), error)


def milliseconds_per_step(subject: Subject) -> float:
    """Return the median time of an update along the drive, ms; at its second run."""
    for _ in beliefs(subject.made(), subject.drive):
        pass
    run, times = beliefs(subject.made(), subject.drive), []
    next(run)
    for _ in range(len(subject.drive.actions)):
        before = time.perf_counter()
        next(run)
        times.append(time.perf_counter() - before)
    return 1e3 * median(times)
