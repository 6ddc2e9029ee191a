"""Laws on arrays: those given are neither changed nor kept, those returned are the caller's."""

from collections.abc import Iterator, Mapping
from copy import deepcopy
from typing import Any

import numpy as np

from deqmcl_gym.numerics.types import Floats
from localizers.api import Belief
from localizers.checks.subject import (
    OFFSETS,
    LawBrokenError,
    Subject,
    beliefs,
    history,
    require_same,
    snapshot,
)


def inputs_not_changed(subject: Subject) -> None:
    """Ranges, action and plan are as they were before the call."""
    for t, (_, given, originals) in enumerate(_fed(subject)):
        for name, array, original in zip(
            ("plan", "action", "ranges"), reversed(given), reversed(originals), strict=False
        ):
            if not np.array_equal(array, original):
                verb = "update" if t else "reset"
                raise LawBrokenError(f"{verb} wrote into the {name} at step {t}: copy it")


def robot_and_prior_not_changed(subject: Subject) -> None:
    """No number and no array of the robot, its map and the prior changes during a run."""
    floor_plan, drive = subject.robot.floor_plan, subject.drive
    ends = np.array([drive.prior.mean, drive.prior.mean])
    floor_plan.ranges(ends, subject.robot.lidar.bearings)  # fills caches
    floor_plan.collides(ends[:1], ends[1:], subject.robot.radius)
    given: dict[str, Any] = deepcopy({"robot": subject.robot, "prior": drive.prior})
    before = {name: np.copy(value) for name, value in _values(given)}
    history(subject.made(given["robot"]), drive, prior=given["prior"])
    after = dict(_values(given))
    for name, value in before.items():
        if name not in after or not np.array_equal(
            value, after[name], equal_nan=value.dtype.kind == "f"
        ):
            raise LawBrokenError(f"it wrote into {name}: copy it")


def _values(thing: Any, name: str = "", depth: int = 8) -> Iterator[tuple[str, Any]]:
    """Yield all numbers, words and arrays inside an object, by where they are."""
    if isinstance(thing, np.ndarray | np.generic | int | float | str):
        yield name, thing
    elif depth and isinstance(thing, Mapping):
        for key, value in thing.items():
            yield from _values(value, f"{name}.{key}".lstrip("."), depth - 1)
    elif depth and isinstance(thing, tuple | list):
        for index, value in enumerate(thing):
            yield from _values(value, f"{name}[{index}]", depth - 1)
    elif depth and hasattr(thing, "__dict__"):
        yield from _values(vars(thing), name, depth - 1)


def inputs_not_kept(subject: Subject) -> None:
    """What the caller writes into ranges, action and plan after the call changes nothing."""
    run = []
    for t, (belief, given, _) in enumerate(_fed(subject)):
        run.append(snapshot(belief, t))
        for array in given:
            array[...] = np.nan
    require_same(
        run,
        subject.history(),
        "it still reads an array that it was given earlier and that the caller has changed since",
    )


def _fed(subject: Subject) -> Iterator[tuple[Belief, list[Floats], tuple[Floats, ...]]]:
    """Run along the drive; yield each belief, the arrays given for it, and their originals."""
    drive, localizer = subject.drive, subject.made()
    steps = zip(drive.scans, drive.actions, drive.plans[1:], strict=True)
    for t, originals in enumerate([(drive.plans[0],), *steps]):
        given = [array.copy() for array in originals]
        if t:
            yield localizer.update(*given), given, originals
        else:
            first = localizer.reset(drive.prior, given[0], np.random.default_rng(0))
            yield first, given, originals


def outputs_are_fresh(subject: Subject) -> None:
    """Writing into the arrays that points returned changes no belief, now or later."""
    run = []
    for t, belief in enumerate(beliefs(subject.made(), subject.drive)):
        run.append(snapshot(belief, t))
        _scribble(belief)
        require_same([snapshot(belief, t)], run[-1:], "points returns its own array, not a copy")
    require_same(run, subject.history(), "points returns an array that the localizer still uses")


def beliefs_stay(subject: Subject) -> None:
    """A belief says the same after the localizer has gone on, and after its next reset."""
    localizer, kept, run = subject.made(), [], []
    for t, belief in enumerate(beliefs(localizer, subject.drive)):
        kept.append(belief)
        run.append(snapshot(belief, t))
    for _ in beliefs(localizer, subject.drive, seed=1):
        pass
    again = [snapshot(belief, t) for t, belief in enumerate(kept)]
    require_same(again, run, "an earlier belief changed with a later update")


def _scribble(belief: Belief) -> None:
    for offset in OFFSETS:
        for array in belief.points(offset) or ():
            if array.flags.writeable:
                array[...] = 1e6
