"""Whether a localizer keeps the laws that the benchmarks rely on: ``check_localizer(name)``.

``deqmcl check NAME`` prints the same; ``parametrize_with_laws`` makes a pytest test of each law.
Both functions load and run a localizer in this process, where a debugger sees it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from typing import TYPE_CHECKING, Any, Literal

from deqmcl_gym.validation import one_of
from localizers.checks.laws import LAWS, Law, Laws
from localizers.checks.subject import (
    LawBrokenError,
    LawSkippedError,
    Subject,
    default_robot,
    localizer_drive,
    state_kept,
)
from localizers.kinds import is_ctrl_c, raised
from localizers.models import RobotModel
from localizers.registry import Factory

if TYPE_CHECKING:
    import pytest

__all__ = [
    "LAWS",
    "LawVerdict",
    "Report",
    "check_localizer",
    "default_robot",
    "law_name",
    "parametrize_with_laws",
]


@dataclass(frozen=True)
class LawVerdict:
    """The verdict on one law; the note is a reason or a remark."""

    law: str
    status: Literal["ok", "FAILED", "skipped"]
    note: str = ""
    error: BaseException | None = field(default=None, compare=False)

    def __str__(self) -> str:
        return f"{self.status:<8} {self.law}{': ' if self.note else ''}{self.note}"


@dataclass(frozen=True)
class Report:
    """The verdicts on laws; each is tried, by ``attempt``, when it is asked for."""

    name: str
    laws: Laws
    attempt: Callable[[Law], LawVerdict]  # which remembers what it has tried

    @property
    def verdicts(self) -> tuple[LawVerdict, ...]:
        """One per law, in their order."""
        return tuple(map(self.verdict, self.laws))

    @property
    def failed(self) -> tuple[LawVerdict, ...]:
        """Those of the laws that failed."""
        return tuple(verdict for verdict in self.verdicts if verdict.status == "FAILED")

    @property
    def passed(self) -> bool:
        """Whether no law failed."""
        return not self.failed

    def __str__(self) -> str:
        return "\n".join([f"{self.name}:", *map(str, self.verdicts)])

    __repr__ = __str__

    def verdict(self, law: str | Law) -> LawVerdict:
        """Return the verdict on a law, or on that of a name; after a need that failed, skip it."""
        if isinstance(law, str):
            law = next(candidate for candidate in self.laws if law_name(candidate) == law)
        need = self.laws[law]
        while need is not None and self.verdict(need).status != "FAILED":
            need = self.laws[need]
        if need is not None:
            return LawVerdict(law_name(law), "skipped", f"it fails {law_name(need)!r}")
        return self.attempt(law)


def law_name(law: Law) -> str:
    """Return the name of a law, such as "same rng same result"."""
    return law.__name__.replace("_", " ")


def check_localizer(
    localizer: str | Factory, robot: RobotModel | None = None, **params: Any
) -> Report:
    """Return the verdicts of all ``LAWS`` on a localizer, by name or a factory, made for a robot.

    By default that has eight beams in a small room. The localizer's own exceptions become verdicts;
    a name that cannot be resolved or an unknown parameter raises ``InputError``.
    """
    return report_of(localizer_drive(localizer, robot, **params), LAWS)


def report_of(subject: Subject, laws: Laws) -> Report:
    """Return the verdicts of laws that are tried in this process."""
    return Report(subject.name, laws, cache(partial(verdict_on, subject)))


def verdict_on(subject: Subject, law: Law) -> LawVerdict:
    """Try a law in this process, whose state is put back."""
    name = law_name(law)
    try:
        with state_kept():
            return LawVerdict(name, "ok", law(subject) or "")
    except LawSkippedError as reason:
        return LawVerdict(name, "skipped", str(reason))
    except LawBrokenError as reason:
        return LawVerdict(name, "FAILED", str(reason), reason)
    except BaseException as error:
        if is_ctrl_c(error):
            raise
        return LawVerdict(name, "FAILED", f"it raised {raised(error)}", error)


def parametrize_with_laws(
    localizer: str | Factory,
    robot: RobotModel | None = None,
    *,
    expected_failures: Mapping[str, str] | None = None,
    **params: Any,
) -> "pytest.MarkDecorator":
    """Return a pytest decorator that gives a test each law in turn, as ``law``.

    ``@parametrize_with_laws(MyLocalizer)`` above ``def test_it_keeps(law): law()``.

    ``expected_failures`` has reasons by name of the law; one that is kept after all then fails, one
    of no law raises ``InputError``. All else is as of ``check_localizer``.
    """
    import pytest

    report, reasons = check_localizer(localizer, robot, **params), expected_failures or {}
    names = list(map(law_name, LAWS))
    for name in reasons:
        one_of("law", name, names)

    def hold(law: str) -> None:
        verdict = report.verdict(law)
        if verdict.status == "skipped":
            pytest.skip(verdict.note)
        if verdict.error is not None:
            raise verdict.error

    marks = {n: pytest.mark.xfail(reason=why, strict=True) for n, why in reasons.items()}
    cases = [pytest.param(partial(hold, n), id=n, marks=marks.get(n, ())) for n in names]
    return pytest.mark.parametrize("law", cases)
