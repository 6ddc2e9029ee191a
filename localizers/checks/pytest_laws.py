"""The laws as a pytest parametrization."""

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from deqmcl_gym.validation import one_of
from localizers.checks.laws import LAWS, Law
from localizers.checks.run import Examination, examined
from localizers.checks.subject import LawBrokenError
from localizers.models.robot import RobotModel
from localizers.naming.registry import Factory

if TYPE_CHECKING:
    import pytest


def parametrize_with_laws(
    localizer: str | Factory,
    robot: RobotModel | None = None,
    *,
    expected_failures: Mapping[str, str] | None = None,
    timeout: float = 60.0,
    **params: Any,
) -> "pytest.MarkDecorator":
    """Return a pytest decorator that gives a test each law in turn, as ``law``.

    ``@parametrize_with_laws(MyLocalizer)`` above ``def test_it_keeps(law): law()``.

    Args:
        localizer, robot, timeout, params: as of ``check_localizer``.
        expected_failures: reasons by name of the law; a law that is kept after all then fails.

    Raises:
        InputError: an expected failure is of no law; else as ``check_localizer``.
    """
    import pytest

    expected = dict(expected_failures or {})
    for name in expected:
        one_of("law", name, [law.name for law in LAWS])
    examination = examined(localizer, robot, timeout=timeout, **params)

    def case(law: Law) -> Any:
        marks = (
            [pytest.mark.xfail(reason=expected[law.name], strict=True, raises=LawBrokenError)]
            if law.name in expected
            else []
        )
        return pytest.param(partial(_tried, law, examination), id=law.name, marks=marks)

    return pytest.mark.parametrize("law", [case(law) for law in LAWS])


def _tried(law: Law, examination: Examination) -> None:
    import pytest

    verdict = examination.verdict(law)
    if verdict.status == "skipped":
        pytest.skip(verdict.note)
    if verdict.error is not None:
        raise verdict.error
