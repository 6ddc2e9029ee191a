"""The laws that every localizer keeps, in the order in which they are tried."""

from collections.abc import Callable
from dataclasses import dataclass
from inspect import cleandoc

from localizers.checks import answers, arrays, hard_steps, lifecycle, randomness
from localizers.checks.subject import LawBrokenError, LawSkippedError, Subject
from localizers.plugins import raised


@dataclass(frozen=True)
class Law:
    """A named law.

    Attributes:
        holds: looks at a localizer; returns what it noticed, if anything worth telling.
    """

    holds: Callable[[Subject], str | None]

    @property
    def name(self) -> str:
        """Its name, such as "same rng same result"."""
        return self.holds.__name__.replace("_", " ")

    @property
    def text(self) -> str:
        """What it demands."""
        return cleandoc(self.holds.__doc__ or "")

    def __call__(self, subject: Subject) -> str | None:
        """Return what was noticed, if anything.

        Raises:
            LawBrokenError: the law is broken; whatever the localizer itself raises breaks it too.
            LawSkippedError: the law has nothing to say about this localizer.
        """
        try:
            return self.holds(subject)
        except (LawBrokenError, LawSkippedError):
            raise
        except (Exception, SystemExit) as error:
            raise LawBrokenError(f"it raised {raised(error)}") from error


LAWS = tuple(
    map(
        Law,
        (
            lifecycle.runs_in_a_worker,
            answers.makes_a_localizer,
            answers.answers_with_beliefs,
            answers.finite,
            answers.weights_sum_to_one,
            answers.whole_turn,
            answers.half_turn,
            randomness.same_rng_same_result,
            randomness.other_rng_other_result,
            randomness.global_rng_untouched,
            arrays.inputs_not_changed,
            arrays.inputs_not_kept,
            arrays.outputs_are_fresh,
            arrays.beliefs_stay,
            hard_steps.zero_likelihood,
            hard_steps.max_range_scan,
            hard_steps.bad_beams,
            hard_steps.one_particle,
            hard_steps.short_plan,
            hard_steps.changed_plan,
            lifecycle.reset_starts_anew,
            lifecycle.picklable,
        ),
    )
)

# Without these there is nothing that the others could look at.
FIRST = (Law(answers.makes_a_localizer), Law(answers.answers_with_beliefs))
