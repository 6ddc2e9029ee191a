"""Laws on the localizer itself, on its beliefs and on their arrays.

Arrays given are neither changed nor kept; those returned are the caller's.
"""

import math
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from deqmcl_gym.maps import GridMap, Map, PolygonMap
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats
from localizers.api import Belief
from localizers.beliefs import mean_pose
from localizers.checks.subject import (
    OFFSETS,
    LawBrokenError,
    LawSkippedError,
    Snapshot,
    Subject,
    beliefs,
    first_difference,
    history,
    require_finite,
    require_normalized,
    require_same,
    size_of,
    snapshot,
)
from localizers.models.motion import increments
from localizers.models.prior import GaussianPrior
from localizers.naming.plugins import raised


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
        for array in (array for k in OFFSETS for array in belief.points(k) or ()):
            if array.flags.writeable:
                array[...] = 1e6
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


def makes_a_localizer(subject: Subject) -> None:
    """The factory makes an object with reset and update, a new one at each call."""
    if subject.made() is subject.made():
        raise LawBrokenError("the factory returned the same object twice: make a new one")


def answers_with_beliefs(subject: Subject) -> str:
    """Reset and every update return a belief whose points(0) are poses (n, 3), weights (n,)."""
    run = subject.history()
    held = sorted(set.union(*(set(found) for found in run)))
    words = "the present alone" if held == [0] else f"steps {held[0]:+d} to {held[-1]:+d}"
    n = max(len(weights) for found in run for _, weights in found.values())
    return f"{words}, {'one point' if n == 1 else f'up to {n} points'}"


def finite(subject: Subject) -> None:
    """All poses and weights are finite numbers."""
    require_finite(subject.history())


def weights_sum_to_one(subject: Subject) -> None:
    """Weights are 0 or more, with sum 1 within 0.001: who uses them divides by their sum."""
    require_normalized(subject.history())


def whole_turn(subject: Subject) -> None:
    """A prior whose mean heading is written 2π higher gives the same belief (see ``_alike``)."""
    drive = subject.drive
    x, y, heading = drive.prior.mean
    higher = replace(drive.prior, mean=(x, y, heading + 2 * math.pi))
    turned = history(subject.made(), drive, prior=higher)
    _require_alike(subject, subject.history(), turned, "with a start heading written 2π higher")


def half_turn(subject: Subject) -> None:
    """In a world turned by π about the origin the belief is turned by π too (see ``_alike``).

    Where headings in one world are about 0, they are about ±π in the other: a mean of headings
    that is not a mean of directions shows.
    """
    robot = replace(subject.robot, floor_plan=_turned(subject.robot.floor_plan))
    prior = _HalfTurned(subject.drive.prior)
    turned = history(subject.made(robot), subject.drive, prior=prior)
    back: list[Snapshot] = [{0: (_half_turned(found[0][0]), found[0][1])} for found in turned]
    _require_alike(subject, subject.history(), back, "in a world turned by half a turn")


def _turned(plan: Map) -> Map:
    if isinstance(plan, GridMap):
        x, y, yaw = plan.origin
        return replace(plan, origin=(-x, -y, yaw - math.pi if yaw > 0 else yaw + math.pi))
    if not isinstance(plan, PolygonMap):
        raise LawSkippedError("the floor plan is of a form of its own, so it cannot be turned")
    outer, *obstacles = ([(-x, -y) for x, y in p] for p in (plan.outer, *plan.obstacles))
    return PolygonMap(outer=outer, obstacles=tuple(obstacles), unit=plan.unit)


@dataclass(frozen=True)
class _HalfTurned:
    """A prior in a world turned by π about the origin."""

    prior: GaussianPrior

    @property
    def mean(self) -> tuple[float, float, float]:
        x, y, heading = _half_turned(np.array([self.prior.mean]))[0].tolist()
        return x, y, heading

    def sample(self, n: int, rng: np.random.Generator) -> Floats:
        return _half_turned(self.prior.sample(n, rng))

    def log_density(self, poses: Floats) -> Floats:
        return self.prior.log_density(_half_turned(np.asarray(poses)))


def _half_turned(poses: Floats) -> Floats:
    turned: Floats = poses * np.array([-1.0, -1.0, 1.0]) + np.array([0.0, 0.0, math.pi])
    turned[:, 2] = arrays.wrapped(turned[:, 2])
    return turned


def increments_of_three(subject: Subject) -> str | None:
    """Increments (d, 0, φ), as of recorded logs, give the beliefs that (d, φ) give, bit by bit.

    A plug-in for which they do not gets a remark: it runs in rooms, but not on logs.
    """
    drive, ours = subject.drive, subject.factory.__module__.startswith("localizers.methods.")
    plans = [increments(plan) for plan in drive.plans]
    wide = replace(drive, actions=increments(drive.actions), plans=plans)
    try:
        where = first_difference(history(subject.made(), wide), subject.history())
    except Exception as error:
        if ours:
            raise
        return f"not for logs, whose increments have three numbers: {raised(error, subject.file)}"
    if where is None:
        return None
    words = f"(d, 0, φ) gives another belief than (d, φ), first at {where}"
    if ours:
        raise LawBrokenError(words)
    return f"not for logs, whose increments have three numbers: {words}"


def _require_alike(subject: Subject, run: list[Snapshot], other: list[Snapshot], when: str) -> None:
    """Raise unless the mean poses of the present agree at every step.

    Within one standard deviation of the belief, plus a hundredth of the map's shorter side, or 0.1
    rad: rounding may send a particle another way, which moves a mean by far less than that;
    headings that are not treated as angles move it by far more.
    """
    slack = size_of(subject.robot.floor_plan) / 100
    for t, (one, two) in enumerate(zip(run, other, strict=True)):
        poses, weights = one[0]
        here, there = np.array(mean_pose(poses, weights)), np.array(mean_pose(*two[0]))
        apart, spread = _angle_free(there - here), _angle_free(poses - here)
        allowed = np.sqrt(weights @ np.square(spread)) + np.array([slack, slack, 0.1])
        if not (np.abs(apart) <= allowed).all():
            raise LawBrokenError(
                f"{when} the mean pose at step {t} differs by ({apart[0]:.3g}, "
                f"{apart[1]:.3g}, {apart[2]:.3g} rad) in (x, y, heading)"
            )


def _angle_free(differences: Floats) -> Floats:
    free = differences.copy()
    free[..., 2] = arrays.wrapped(free[..., 2])
    return free
