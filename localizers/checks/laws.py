"""The laws that every localizer keeps, in the order in which they are tried on it."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from inspect import cleandoc
from statistics import median
from typing import Any, Literal

import numpy as np

from deqmcl_gym.validation import number, one_of
from localizers.checks import answers, lifecycle, randomness
from localizers.checks.lifecycle import state_of_process
from localizers.checks.subject import (
    LawBrokenError,
    LawSkippedError,
    Subject,
    beliefs,
    default_robot,
    random_drive,
)
from localizers.models.robot import RobotModel
from localizers.naming.plugins import absolute_name, is_ctrl_c, raised
from localizers.naming.registry import Factory, is_registered, parameters_of, resolve


@dataclass(frozen=True)
class Law:
    """A named law.

    Attributes:
        holds: tests a localizer; returns a remark, if there is any.
        needs: the law that must hold before this one can be tried.
    """

    holds: Callable[[Subject], str | None]
    needs: "Law | None" = None

    @property
    def name(self) -> str:
        """Its name, such as "same rng same result"."""
        return self.holds.__name__.replace("_", " ")

    @property
    def text(self) -> str:
        """What it requires."""
        return cleandoc(self.holds.__doc__ or "")

    def __call__(self, subject: Subject) -> str | None:
        """Return a remark, if there is any.

        Raises:
            LawBrokenError: the law is broken; whatever the localizer itself raises breaks it too.
            LawSkippedError: the law does not apply to this localizer.
        """
        try:
            return self.holds(subject)
        except (LawBrokenError, LawSkippedError):
            raise
        except BaseException as error:
            if is_ctrl_c(error):
                raise
            raise LawBrokenError(f"it raised {raised(error, subject.file)}") from error


_IN_TIME = Law(lifecycle.answers_in_time)
_MADE = Law(answers.makes_a_localizer, _IN_TIME)
_ANSWERING = Law(answers.answers_with_beliefs, _MADE)
_FINITE = Law(answers.finite, _ANSWERING)
_VALID = Law(answers.weights_sum_to_one, _FINITE)
_REPEATABLE = Law(randomness.same_rng_same_result, _ANSWERING)

LAWS = (
    _IN_TIME,
    _MADE,
    _ANSWERING,
    _FINITE,
    _VALID,
    Law(answers.whole_turn, _VALID),
    Law(answers.half_turn, _VALID),
    _REPEATABLE,
    Law(answers.increments_of_three, _REPEATABLE),
    Law(randomness.other_rng_other_result, _REPEATABLE),
    Law(randomness.global_rng_untouched, _ANSWERING),
    Law(lifecycle.process_state_untouched, _ANSWERING),
    Law(lifecycle.nothing_left_running, _ANSWERING),
    Law(answers.inputs_not_changed, _ANSWERING),
    Law(answers.robot_and_prior_not_changed, _ANSWERING),
    Law(answers.inputs_not_kept, _REPEATABLE),
    Law(answers.outputs_are_fresh, _REPEATABLE),
    Law(answers.beliefs_stay, _ANSWERING),
    Law(randomness.prior_without_mean, _VALID),
    Law(randomness.zero_likelihood, _VALID),
    Law(randomness.max_range_scan, _VALID),
    Law(randomness.bad_beams, _VALID),
    Law(randomness.huge_actions, _VALID),
    Law(randomness.one_particle, _VALID),
    Law(randomness.short_plan, _VALID),
    Law(randomness.changed_plan, _VALID),
    Law(lifecycle.reset_starts_anew, _REPEATABLE),
    Law(lifecycle.picklable, _REPEATABLE),
    Law(lifecycle.runs_in_a_worker, _REPEATABLE),
)


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
    loaded = state_of_process()
    name = localizer if isinstance(localizer, str) else getattr(factory, "__name__", repr(factory))
    known = parameters_of(factory)
    for param in params:
        if known is not None:
            one_of(f"parameter of localizer {name!r}", param, known)
    model = default_robot() if robot is None else robot
    here = not isinstance(localizer, str) or is_registered(localizer)
    return Subject(
        name=name, factory=factory, params=params, robot=model,
        drive=random_drive(model, np.random.default_rng(0)), sent=factory if here else found,
        timeout=number("the timeout", timeout, low=0, above=True), before=before, loaded=loaded,
    )  # fmt: skip


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
