"""Laws tried on a localizer in this process."""

import time
from dataclasses import dataclass, field
from statistics import median
from typing import Any, Literal

import numpy as np

from deqmcl_gym.validation import number, one_of
from localizers.api import RobotModel
from localizers.checks.drive import default_robot, random_drive
from localizers.checks.laws import Law
from localizers.checks.subject import LawBrokenError, LawSkippedError, Subject, beliefs
from localizers.checks.surroundings import state_of_process
from localizers.naming.plugins import absolute_name
from localizers.naming.registry import Factory, is_registered, parameters_of, resolve

Status = Literal["ok", "FAILED", "skipped"]


@dataclass(frozen=True)
class Verdict:
    """The verdict on one law.

    Attributes:
        law: its name.
        status: "ok", "FAILED" or "skipped".
        note: the reason, or a remark; may be empty.
        error: what was raised, if it failed.
    """

    law: str
    status: Status
    note: str = ""
    error: BaseException | None = field(default=None, compare=False)

    def __str__(self) -> str:
        return f"{self.status:<8} {self.law}{': ' if self.note else ''}{self.note}"


def subject_of(
    localizer: str | Factory,
    robot: RobotModel | None = None,
    *,
    timeout: float = 60.0,
    **params: Any,
) -> Subject:
    """Return the localizer under check; arguments as of ``check_localizer``."""
    before = state_of_process()
    found = absolute_name(localizer) if isinstance(localizer, str) else localizer
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
        sent=factory if here else found,
        timeout=number("the timeout", timeout, low=0, above=True),
        before=before,
    )


@dataclass(frozen=True)
class Here:
    """Tries laws in this process."""

    subject: Subject

    @property
    def name(self) -> str:
        """What the localizer is called."""
        return self.subject.name

    def verdict(self, law: Law) -> Verdict:
        """Try a law."""
        try:
            return Verdict(law.name, "ok", law(self.subject) or "")
        except LawSkippedError as skipped:
            return Verdict(law.name, "skipped", str(skipped))
        except LawBrokenError as error:
            return Verdict(law.name, "FAILED", str(error), error)

    def milliseconds_per_step(self) -> float:
        """Return the median time of an update along the drive, ms; at its second run."""
        subject = self.subject
        for _ in beliefs(subject.made(), subject.drive):
            pass
        run, times = beliefs(subject.made(), subject.drive), []
        next(run)
        for _ in range(len(subject.drive.actions)):
            before = time.perf_counter()
            next(run)
            times.append(time.perf_counter() - before)
        return 1e3 * median(times)

    def close(self) -> None:
        """Nothing was started."""
