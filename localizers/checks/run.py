"""Try a localizer against the laws."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from localizers.checks.apart import Apart
from localizers.checks.laws import LAWS, Here, Law, Verdict, subject_of
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
        return Report(examination.name, tuple(examination.verdicts()))
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

    def verdicts(self) -> Iterator[Verdict]:
        """Try all laws in turn."""
        return map(self.verdict, LAWS)

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
