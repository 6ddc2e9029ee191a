"""Laws tried in a separate process, which contains whatever a localizer does."""

import os
import traceback
from collections.abc import Mapping
from multiprocessing.connection import Connection
from typing import Any

from deqmcl_gym.validation import InputError, in_words, number
from localizers.checks.laws import LAWS, Here, Law, Verdict, subject_of
from localizers.checks.subject import LawBrokenError
from localizers.models.robot import RobotModel
from localizers.naming.plugins import SPAWN, NoAnswerError, OwnProcess, enter


class Apart:
    """Tries laws on a plug-in in a process that loads it; a new one if that ends or hangs."""

    def __init__(
        self, name: str, robot: RobotModel | None, timeout: float, params: Mapping[str, Any]
    ) -> None:
        """Load the plug-in; arguments as of ``check_localizer``.

        Raises:
            InputError: the name cannot be resolved, or a parameter is unknown.
        """
        self.name = name
        self._timeout = number("the timeout", timeout, low=0, above=True)
        self._asked = name, robot, self._timeout / 2, dict(params)  # half for what a law starts
        self._process: OwnProcess | None = None
        self._unsaid: LawBrokenError | None = None
        try:
            self._started()
        except LawBrokenError as error:
            self._unsaid = error  # the first law says so

    def verdict(self, law: Law) -> Verdict:
        """Try a law."""
        try:
            status, note, shown = self._answer(LAWS.index(law))
        except LawBrokenError as error:
            return Verdict(law.name, "FAILED", str(error), error)
        if status != "FAILED":
            return Verdict(law.name, status, note)
        broken = LawBrokenError(note)
        broken.add_note(shown)
        return Verdict(law.name, status, note, broken)

    def milliseconds_per_step(self) -> float:
        """Return the median time of an update along the drive, ms; at its second run."""
        answer: float = self._answer(None)
        return answer

    def close(self) -> None:
        """Kill the process and all that it started."""
        if self._process is not None:
            self._process.close()
            self._process = None

    def _answer(self, question: int | None) -> Any:
        if self._unsaid is not None:
            error, self._unsaid = self._unsaid, None
            raise error
        process = self._process or self._started()
        try:
            return process.answer(self._timeout, question)
        except NoAnswerError as error:
            self.close()
            raise LawBrokenError(str(error)) from None

    def _started(self) -> OwnProcess:
        self._process = OwnProcess(SPAWN, _try_laws, *self._asked)
        try:
            refusal: str | None = self._process.answer(self._timeout)
        except NoAnswerError as error:
            self.close()
            raise LawBrokenError(str(error)) from None
        if refusal is not None:
            self.close()
            raise InputError(refusal)
        return self._process


def _try_laws(
    line: Connection, name: str, robot: RobotModel | None, timeout: float, params: dict[str, Any]
) -> None:
    """Answer questions until killed: the number of a law, or None for the time of a step."""
    enter(line)
    try:
        here = Here(subject_of(name, robot, timeout=timeout, **params))
    except BaseException as error:
        line.send(str(error) if isinstance(error, InputError) else in_words(error))
        os._exit(0)
    line.send(None)
    try:
        while True:
            line.send(_answer(here, line.recv()))
    finally:  # waits for no thread
        os._exit(0)


def _answer(here: Here, question: int | None) -> Any:
    if question is None:
        return here.milliseconds_per_step()
    verdict = here.verdict(LAWS[question])
    shown = "".join(traceback.format_exception(verdict.error)) if verdict.error else ""
    return verdict.status, verdict.note, shown
