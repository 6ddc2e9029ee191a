"""Whether a localizer keeps the laws that the benchmarks rely on: ``check_localizer(name)``.

``deqmcl check NAME`` prints the same; ``parametrize_with_laws`` makes a pytest test of each law.
A localizer is loaded and run in this process, where a debugger sees it and Ctrl-C ends it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

import numpy as np

from deqmcl_gym.validation import one_of
from localizers.checks.laws import LAWS
from localizers.checks.process import changes_since, process_state, process_state_kept
from localizers.checks.subject import (
    Law,
    LawBrokenError,
    Laws,
    LawSkippedError,
    Subject,
    default_robot,
    random_drive,
)
from localizers.kinds import absolute_name, parameters_of, raised
from localizers.models.robot import RobotModel
from localizers.registry import LOCALIZER, Factory, resolve

if TYPE_CHECKING:
    import pytest

_T = TypeVar("_T")
__all__ = [
    "LAWS",
    "LawBrokenError",
    "LawSkippedError",
    "LawVerdict",
    "Laws",
    "Report",
    "check_localizer",
    "default_robot",
    "law_name",
    "parametrize_with_laws",
]


@dataclass(frozen=True)
class LawVerdict:
    """The verdict on one law.

    Attributes:
        law: its name.
        status: "ok", "FAILED" or "skipped".
        note: the reason, or a remark; may be empty.
        error: what was raised, if it failed.
    """

    law: str
    status: Literal["ok", "FAILED", "skipped"]
    note: str = ""
    error: Exception | None = field(default=None, compare=False)

    def __str__(self) -> str:
        return f"{self.status:<8} {self.law}{': ' if self.note else ''}{self.note}"


@dataclass(frozen=True)
class Report(Generic[_T]):
    """The verdicts on all laws; each law is tried when it is asked for, after those it needs.

    Attributes:
        name: of what is checked.
        laws: in the order in which they are tried.
        subject: what they are about.
        file: that the subject is written in: where it raised an exception is told as a line of it.
    """

    name: str
    laws: Laws[_T]
    subject: _T
    file: str | None = None
    _tried: dict[Law[_T], LawVerdict] = field(default_factory=dict, init=False, repr=False)

    @property
    def verdicts(self) -> tuple[LawVerdict, ...]:
        """One per law, in their order."""
        return tuple(map(self.verdict, self.laws))

    @property
    def failed(self) -> tuple[LawVerdict, ...]:
        """Verdicts of the laws that failed."""
        return tuple(verdict for verdict in self.verdicts if verdict.status == "FAILED")

    @property
    def passed(self) -> bool:
        """Whether no law failed."""
        return not self.failed

    def __str__(self) -> str:
        return "\n".join([f"{self.name}:", *map(str, self.verdicts)])

    def verdict(self, law: Law[_T]) -> LawVerdict:
        """Try a law, unless one that it needs is broken; the process is put back as it was."""
        if law not in self._tried:
            self._tried[law] = self._verdict(law)
        return self._tried[law]

    def _verdict(self, law: Law[_T]) -> LawVerdict:
        name, need = law_name(law), self.laws[law]
        while need is not None:
            if self.verdict(need).status == "FAILED":
                return LawVerdict(name, "skipped", f"it fails {law_name(need)!r}")
            need = self.laws[need]
        try:
            with process_state_kept():
                return LawVerdict(name, "ok", law(self.subject) or "")
        except LawSkippedError as reason:
            return LawVerdict(name, "skipped", str(reason))
        except LawBrokenError as reason:
            return LawVerdict(name, "FAILED", str(reason), reason)
        except Exception as error:
            return LawVerdict(name, "FAILED", f"it raised {raised(error, self.file)}", error)


def law_name(law: Callable[..., object]) -> str:
    """Return the name of a law, such as "same rng same result"."""
    return law.__name__.replace("_", " ")


def check_localizer(
    localizer: str | Factory, robot: RobotModel | None = None, **params: Any
) -> Report[Subject]:
    """Return the verdicts of all ``LAWS`` on a localizer; its own exceptions become verdicts.

    Args:
        localizer: a name (see ``localizers.resolve``), or a factory itself.
        robot: to make it for; by default eight beams in a small room.
        params: given to the factory.

    Raises:
        InputError: the name cannot be resolved, or a parameter is unknown.
    """
    robot = default_robot() if robot is None else robot
    before = process_state()
    if isinstance(localizer, str):
        name, factory = localizer, resolve(localizer)
        sent = factory if name in LOCALIZER.added else absolute_name(name)
    else:
        name, factory, sent = getattr(localizer, "__name__", repr(localizer)), localizer, localizer
    known = parameters_of(factory)
    for param in params:
        if known is not None:
            one_of(f"parameter of localizer {name!r}", param, known)
    drive = random_drive(robot, np.random.default_rng(0))
    subject = Subject(
        name=name, factory=factory, params=params, robot=robot, drive=drive, sent=sent,
        imported=tuple(changes_since(before)),
    )  # fmt: skip
    return Report(name, LAWS, subject, subject.file)


def parametrize_with_laws(
    localizer: str | Factory,
    robot: RobotModel | None = None,
    *,
    expected_failures: Mapping[str, str] | None = None,
    **params: Any,
) -> "pytest.MarkDecorator":
    """Return a pytest decorator that gives a test each law in turn, as ``law``.

    ``@parametrize_with_laws(MyLocalizer)`` above ``def test_it_keeps(law): law()``.

    Args:
        localizer, robot, params: as of ``check_localizer``.
        expected_failures: reasons by name of the law; a law that is kept after all then fails.

    Raises:
        InputError: an expected failure is of no law; else as ``check_localizer``.
    """
    import pytest

    expected, names = expected_failures or {}, {law_name(law): law for law in LAWS}
    for name in expected:
        one_of("law", name, names)
    report = check_localizer(localizer, robot, **params)
    cases = []
    for name, law in names.items():
        reason = expected.get(name)
        marks = [pytest.mark.xfail(reason=reason, strict=True)] if reason is not None else []
        cases.append(pytest.param(partial(_hold, report, law), id=name, marks=marks))
    return pytest.mark.parametrize("law", cases)


def _hold(report: Report[Subject], law: Law[Subject]) -> None:
    import pytest

    verdict = report.verdict(law)
    if verdict.status == "skipped":
        pytest.skip(verdict.note)
    if verdict.error is not None:
        raise verdict.error
