"""Whether a localizer keeps the laws that the benchmarks rely on: ``check_localizer(name)``.

``deqmcl check NAME`` prints the same; ``parametrize_with_laws`` makes a pytest test of each law.
Both functions load and run a localizer in this process, where a debugger sees it.
"""

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from deqmcl_gym.validation import one_of
from localizers.checks.laws import LAWS
from localizers.checks.subject import default_robot, localizer_drive
from localizers.checks.verdicts import LawVerdict, Report, law_name, report_of
from localizers.models.robot import RobotModel
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


def check_localizer(
    localizer: str | Factory, robot: RobotModel | None = None, **params: Any
) -> Report:
    """Return the verdicts of all ``LAWS`` on a localizer; its own exceptions become verdicts.

    Args:
        localizer: a name (see ``localizers.resolve``), or a factory itself.
        robot: to make it for; by default eight beams in a small room.
        params: given to the factory.

    Raises:
        InputError: the name cannot be resolved, or a parameter is unknown.
    """
    return report_of(localizer_drive(localizer, robot, **params), LAWS)


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

    report, reasons = check_localizer(localizer, robot, **params), expected_failures or {}
    for name in reasons:
        one_of("law", name, report.needs)
    cases = []
    for name in report.needs:
        marks = [pytest.mark.xfail(reason=reasons[name], strict=True)] if name in reasons else []
        cases.append(pytest.param(partial(_hold, report, name), id=name, marks=marks))
    return pytest.mark.parametrize("law", cases)


def _hold(report: Report, law: str) -> None:
    import pytest

    verdict = report.verdict(law)
    if verdict.status == "skipped":
        pytest.skip(verdict.note)
    if verdict.error is not None:
        raise verdict.error
