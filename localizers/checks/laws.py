"""The laws that every localizer keeps, in the order in which they are tried."""

from collections.abc import Callable
from dataclasses import dataclass
from inspect import cleandoc

from localizers.checks import answers, arrays, hard_steps, lifecycle, randomness, surroundings
from localizers.checks.subject import LawBrokenError, LawSkippedError, Subject
from localizers.naming.isolation import is_ctrl_c
from localizers.naming.plugins import raised


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
    Law(surroundings.process_state_untouched, _ANSWERING),
    Law(surroundings.nothing_left_running, _ANSWERING),
    Law(arrays.inputs_not_changed, _ANSWERING),
    Law(arrays.robot_and_prior_not_changed, _ANSWERING),
    Law(arrays.inputs_not_kept, _REPEATABLE),
    Law(arrays.outputs_are_fresh, _REPEATABLE),
    Law(arrays.beliefs_stay, _ANSWERING),
    Law(hard_steps.prior_without_mean, _VALID),
    Law(hard_steps.zero_likelihood, _VALID),
    Law(hard_steps.max_range_scan, _VALID),
    Law(hard_steps.bad_beams, _VALID),
    Law(hard_steps.huge_actions, _VALID),
    Law(hard_steps.one_particle, _VALID),
    Law(hard_steps.short_plan, _VALID),
    Law(hard_steps.changed_plan, _VALID),
    Law(lifecycle.reset_starts_anew, _REPEATABLE),
    Law(lifecycle.picklable, _REPEATABLE),
    Law(lifecycle.runs_in_a_worker, _REPEATABLE),
)
