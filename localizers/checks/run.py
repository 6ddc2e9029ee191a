"""Try a localizer against the laws, on its own or as a pytest parametrization."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from deqmcl_gym.validation import one_of
from localizers.checks.apart import Apart
from localizers.checks.laws import LAWS, Here, Law, Verdict, subject_of
from localizers.checks.subject import LawBrokenError
from localizers.models.robot import RobotModel
from localizers.naming.registry import Factory, is_plug_in


@dataclass(frozen=True)
class Report:
    """The verdicts on all laws.

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

    def __repr__(self) -> str:
        return f"<{self.name}: {len(self.failed)} of {len(self.verdicts)} laws failed>"

    def __str__(self) -> str:
        return "\n".join([f"{self.name}:", *map(str, self.verdicts)])


def check_localizer(
    localizer: str | Factory,
    robot: RobotModel | None = None,
    *,
    timeout: float = 60.0,
    **params: Any,
) -> Report:
    """Try a localizer against all ``LAWS``; its own exceptions become verdicts.

    Args:
        localizer: a name (see ``localizers.resolve``), or a factory itself.
        robot: to make it for; by default eight beams in a small room.
        timeout: s that a law may take, imports included.
        params: given to the factory.

    Raises:
        InputError: the name cannot be resolved, or a parameter is unknown.
    """
    examination = examined(localizer, robot, timeout=timeout, **params)
    try:
        return Report(examination.name, tuple(map(examination.verdict, LAWS)))
    finally:
        examination.close()


class Examination:
    """Tries laws on a localizer, each at most once and after those it needs."""

    def __init__(self, place: Apart | Here) -> None:
        self._place = place
        self._tried: dict[Law, Verdict] = {}
        self.name, self.close = place.name, place.close
        self.milliseconds_per_step = place.milliseconds_per_step

    def verdict(self, law: Law) -> Verdict:
        """Try a law; skipped if one that it needs is broken."""
        if law not in self._tried:
            self._tried[law] = self._try(law)
        return self._tried[law]

    def _try(self, law: Law) -> Verdict:
        need = law.needs
        while need is not None:
            if self.verdict(need).status == "FAILED":
                return Verdict(law.name, "skipped", f"it fails {need.name!r}")
            need = need.needs
        return self._place.verdict(law)


def examined(
    localizer: str | Factory,
    robot: RobotModel | None = None,
    *,
    timeout: float = 60.0,
    **params: Any,
) -> Examination:
    """Return the examination of a localizer; arguments as of ``check_localizer``.

    A plug-in is loaded and tried in a separate process. A factory is tried in this one, where it is
    already loaded and a debugger can see it.
    """
    if isinstance(localizer, str) and is_plug_in(localizer):
        return Examination(Apart(localizer, robot, timeout, params))
    return Examination(Here(subject_of(localizer, robot, timeout=timeout, **params)))


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
