"""Laws on arrays: those given are neither changed nor kept, those returned are the caller's."""

import numpy as np

from localizers.api import Belief
from localizers.checks.subject import (
    OFFSETS,
    LawBrokenError,
    Subject,
    beliefs,
    require_same,
    snapshot,
)


def inputs_not_changed(subject: Subject) -> None:
    """Ranges, action and plan are as they were before the call."""
    drive, localizer = subject.drive, subject.made()
    plan = drive.plans[0].copy()
    localizer.reset(drive.prior, plan, np.random.default_rng(0))
    if not np.array_equal(plan, drive.plans[0]):
        raise LawBrokenError("reset wrote into the plan: copy it")
    steps = zip(drive.scans, drive.actions, drive.plans[1:], strict=True)
    for t, originals in enumerate(steps, start=1):
        given = [array.copy() for array in originals]
        localizer.update(*given)
        for name, array, original in zip(
            ("ranges", "action", "plan"), given, originals, strict=True
        ):
            if not np.array_equal(array, original):
                raise LawBrokenError(f"update wrote into the {name} at step {t}: copy it")


def inputs_not_kept(subject: Subject) -> None:
    """What the caller writes into ranges, action and plan after the call changes nothing."""
    drive, localizer = subject.drive, subject.made()
    given = [drive.plans[0].copy()]
    run = [snapshot(localizer.reset(drive.prior, given[0], np.random.default_rng(0)), 0)]
    for t, originals in enumerate(
        zip(drive.scans, drive.actions, drive.plans[1:], strict=True), start=1
    ):
        for array in given:
            array[...] = np.nan
        given = [array.copy() for array in originals]
        run.append(snapshot(localizer.update(*given), t))
    require_same(
        run,
        subject.history(),
        "it reads an array that it was given before, and the caller has written into since",
    )


def outputs_are_fresh(subject: Subject) -> None:
    """Writing into the arrays that points returned changes no belief, now or later."""
    run = []
    for t, belief in enumerate(beliefs(subject.made(), subject.drive)):
        run.append(snapshot(belief, t))
        _scribble(belief)
        require_same([snapshot(belief, t)], run[-1:], "points returns its own array, not a copy")
    require_same(run, subject.history(), "points returns an array that the localizer goes on with")


def beliefs_stay(subject: Subject) -> None:
    """A belief says the same after the localizer has gone on, and after its next reset."""
    localizer, kept, run = subject.made(), [], []
    for t, belief in enumerate(beliefs(localizer, subject.drive)):
        kept.append(belief)
        run.append(snapshot(belief, t))
    for _ in beliefs(localizer, subject.drive, seed=1):
        pass
    again = [snapshot(belief, t) for t, belief in enumerate(kept)]
    require_same(again, run, "a belief changed when the localizer went on")


def _scribble(belief: Belief) -> None:
    for offset in OFFSETS:
        for array in belief.points(offset) or ():
            if array.flags.writeable:
                array[...] = 1e6
