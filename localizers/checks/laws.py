"""The laws that every localizer keeps: plain functions, in the order in which they are tried.

A law takes a ``Subject``, returns a remark if there is any, and raises ``LawBrokenError`` or
``LawSkippedError`` with the reason. ``LAWS``, at the end, says which one needs which.
"""

import gc
import math
import pickle
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from copy import deepcopy
from dataclasses import dataclass, replace
from itertools import islice
from multiprocessing import get_context
from typing import Any

import numpy as np

from deqmcl_gym.maps import GridMap, Map, PolygonMap
from deqmcl_gym.numerics.arrays import wrapped
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError
from localizers.api import mean_pose
from localizers.checks.process import (
    ADDED_BY_IMPORTS,
    changes_since,
    no_global_rng,
    process_state,
    running,
    safe_path,
)
from localizers.checks.subject import (
    DRIVE_STEPS,
    OFFSETS,
    LawBrokenError,
    Laws,
    LawSkippedError,
    Snapshot,
    Subject,
    first_difference,
    require_finite,
    require_same,
    require_valid,
    size_of,
    snapshot,
    steps,
)
from localizers.kinds import parameters_of, raised
from localizers.models.beams import GaussianUniform
from localizers.models.motion import increments
from localizers.models.prior import GaussianPrior, UniformPrior
from localizers.registry import resolve

_HALF = DRIVE_STEPS // 2
_GRACE = 1.0  # s that threads and processes may take to end


def makes_a_localizer(subject: Subject) -> None:
    """The factory makes an object with reset and update, a new one at each call."""
    if subject.made() is subject.made():
        raise LawBrokenError("the factory returned the same object twice: make a new one")


def answers_with_beliefs(subject: Subject) -> str:
    """Reset and every update return a belief whose points(0) are poses (n, 3), weights (n,)."""
    run = subject.history()
    held = sorted(set().union(*run))
    words = "the present alone" if held == [0] else f"steps {held[0]:+d} to {held[-1]:+d}"
    n = max(len(weights) for belief in run for _, weights in belief.values())
    return f"{words}, {'one point' if n == 1 else f'up to {n} points'}"


def finite(subject: Subject) -> None:
    """All poses and weights are finite numbers."""
    require_finite(subject.history())


def weights_sum_to_one(subject: Subject) -> None:
    """Weights are 0 or more, with sum 1 within 0.001: who uses them divides by their sum."""
    require_valid(subject.history())


def whole_turn(subject: Subject) -> None:
    """A prior whose mean heading is written 2π higher gives the same mean pose."""
    prior = subject.drive.prior
    x, y, heading = prior.mean
    higher = replace(prior, mean=(x, y, heading + 2 * math.pi))
    _require_alike(subject, subject.history(prior=higher), "with a start heading written 2π higher")


def half_turn(subject: Subject) -> None:
    """In a world turned by π about the origin the mean pose is turned by π too.

    Where headings in one world are about 0, they are about ±π in the other: a mean of headings
    that is not a mean of directions shows.
    """
    robot = replace(subject.robot, floor_plan=_turned(subject.robot.floor_plan))
    turned = subject.history(subject.made(robot), prior=_HalfTurned(subject.drive.prior))
    back: list[Snapshot] = [{0: (_half_turned(run[0][0]), run[0][1])} for run in turned]
    _require_alike(subject, back, "in a world turned by half a turn")


def same_rng_same_result(subject: Subject) -> None:
    """Two new localizers given equal generators believe the same, bit by bit."""
    require_same(subject.history(), subject.history(), "two runs with equal rng differ")


def increments_of_three(subject: Subject) -> None:
    """Increments (d, 0, φ), as of recorded logs, give the beliefs that (d, φ) give, bit by bit.

    A localizer for which they do not runs in rooms, but not on logs: the law is skipped.
    """
    plans = [increments(plan) for plan in subject.drive.plans]
    try:
        wide = subject.history(actions=increments(subject.drive.actions), plans=plans)
        require_same(wide, subject.history(), "(d, 0, φ) gives another belief than (d, φ)")
    except Exception as error:
        why = error if isinstance(error, LawBrokenError) else raised(error, subject.file)
        raise LawSkippedError(
            f"not for logs, whose increments have three numbers: {why}"
        ) from error


def other_rng_other_result(subject: Subject) -> str | None:
    """Another generator gives another belief; a deterministic localizer draws nothing."""
    if first_difference(subject.history(seed=0), subject.history(seed=1)) is not None:
        return None
    rng, unused = np.random.default_rng(0), np.random.default_rng(0)
    subject.history(seed=rng)
    if rng.spawn(1)[0].random() != unused.spawn(1)[0].random() or rng.random() != unused.random():
        raise LawBrokenError(
            "it draws from rng, yet another rng changes nothing: use only the rng given to reset"
        )
    return "deterministic, it draws nothing"


def global_rng_untouched(subject: Subject) -> None:
    """Neither NumPy's global random state nor that of ``random`` changes."""
    with no_global_rng("use the rng given to reset"):
        subject.history()


def process_state_untouched(subject: Subject) -> None:
    """Working folder, signal handlers, np.seterr, os.environ and the like stay as they are.

    An import may add to the filters of warnings, to os.environ and to sys.path, as many do.
    """
    if imported := [name for name in subject.imported if name not in ADDED_BY_IMPORTS]:
        raise LawBrokenError(
            f"its import changes {', '.join(imported)} for its whole process: change it in a call, "
            "which puts it back before it returns"
        )
    before = process_state()
    subject.history()
    touched = changes_since(before)
    if touched:
        raise LawBrokenError(
            f"it changes {', '.join(touched)} for its whole process: put back what a call changes "
            "before it returns"
        )


def nothing_left_running(subject: Subject) -> None:
    """A second after the localizer is gone, no thread and no process that it started runs on."""
    before = running()
    subject.history()
    gc.collect()
    until = time.monotonic() + _GRACE
    while left := [name for own, name in running().items() if own not in before]:
        if time.monotonic() > until:
            more = f" and {len(left) - 1} more" if left[1:] else ""
            raise LawBrokenError(f"it leaves {left[0]}{more} running: end what it starts")
        time.sleep(0.01)


def inputs_not_changed(subject: Subject) -> None:
    """Ranges, action and plan are as they were before the call."""
    for t, (_, given) in enumerate(steps(subject.made(), subject.drive)):
        names = ("ranges", "action", "plan")[-len(given) :]
        for name, array, original in zip(names, given, subject.drive.inputs(t), strict=True):
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
    subject.history(subject.made(given["robot"]), prior=given["prior"])
    after = dict(_values(given))
    for name, value in before.items():
        numeric = value.dtype.kind == "f"
        if name not in after or not np.array_equal(value, after[name], equal_nan=numeric):
            raise LawBrokenError(f"it wrote into {name}: copy it")


def inputs_not_kept(subject: Subject) -> None:
    """What the caller writes into ranges, action and plan after the call changes nothing."""
    run = []
    for t, (belief, given) in enumerate(steps(subject.made(), subject.drive)):
        run.append(snapshot(belief, t))
        for array in given:
            array[...] = np.nan
    require_same(
        run,
        subject.history(),
        "it still reads an array that it was given earlier and that the caller has changed since",
    )


def outputs_are_fresh(subject: Subject) -> None:
    """Writing into the arrays that points returned changes no belief, now or later."""
    run = []
    for t, (belief, _) in enumerate(steps(subject.made(), subject.drive)):
        run.append(snapshot(belief, t))
        for array in (array for k in OFFSETS for array in belief.points(k) or ()):
            if array.flags.writeable:
                array[...] = 1e6
        require_same([snapshot(belief, t)], run[-1:], "points returns its own array, not a copy")
    require_same(run, subject.history(), "points returns an array that the localizer still uses")


def beliefs_stay(subject: Subject) -> None:
    """A belief says the same after the localizer has gone on, and after its next reset."""
    localizer, kept, run = subject.made(), [], []
    for t, (belief, _) in enumerate(steps(localizer, subject.drive)):
        kept.append(belief)
        run.append(snapshot(belief, t))
    subject.history(localizer, seed=1)
    again = [snapshot(belief, t) for t, belief in enumerate(kept)]
    require_same(again, run, "an earlier belief changed with a later update")


def prior_without_mean(subject: Subject) -> str | None:
    """A prior without a mean, uniform over free space, is accepted or refused by an InputError."""
    prior = UniformPrior(floor_plan=subject.robot.floor_plan)
    try:
        require_valid(subject.history(prior=prior))
    except InputError:
        return "refused"
    return None


def zero_likelihood(subject: Subject) -> None:
    """Scans that no pose explains (all beams 0; σ = 0.001, no uniform share) are survived."""
    robot = replace(subject.robot, scan=GaussianUniform(sigma=1e-3, uniform=0.0))
    scans = subject.drive.scans.copy()
    scans[: len(scans) // 2] = 0.0
    require_valid(subject.history(subject.made(robot), scans=scans))


def max_range_scan(subject: Subject) -> None:
    """Scans whose beams all read max_range are survived."""
    scans = np.full_like(subject.drive.scans, subject.robot.lidar.max_range)
    require_valid(subject.history(scans=scans))


def bad_beams(subject: Subject) -> None:
    """Beams that read NaN, ±inf, less than 0 or more than max_range are survived.

    One beam of a scan first, then all of them.
    """
    bad = (np.nan, np.inf, -np.inf, -1.0, 1.5 * subject.robot.lidar.max_range)
    scans = subject.drive.scans.copy()
    scans[: len(bad), 0] = bad
    scans[len(bad) : 2 * len(bad)] = np.array(bad)[:, None]
    require_valid(subject.history(scans=scans))


def huge_actions(subject: Subject) -> str | None:
    """A planned distance or turn of 1e30 is survived, or refused by an InputError."""
    refused, drive = 0, subject.drive
    for huge in ((1e30, 0.0), (0.0, 1e30)):
        actions, plans = drive.actions.copy(), [plan.copy() for plan in drive.plans]
        actions[_HALF] = huge
        for t, plan in enumerate(plans[: _HALF + 1]):
            plan[_HALF - t] = huge
        try:
            with np.errstate(all="ignore"):  # an overflow shows in what it returns
                require_valid(subject.history(actions=actions, plans=plans))
        except InputError:
            refused += 1
    return "refused" if refused else None


def one_particle(subject: Subject) -> str | None:
    """A localizer with a parameter ``particles`` works with 1, or refuses it by an InputError."""
    if "particles" not in (parameters_of(subject.factory) or ()):
        raise LawSkippedError("it has no parameter particles")
    try:
        made = subject.made(particles=1)
    except InputError:
        return "refused"
    require_valid(subject.history(made))
    return None


def short_plan(subject: Subject) -> None:
    """A plan that is empty, that shows two steps at a time, or that runs out is followed."""
    plans = subject.drive.plans
    for shorter in (
        [plan[:0] for plan in plans],
        [plan[:2] for plan in plans],
        [plan[: DRIVE_STEPS - t] for t, plan in enumerate(plans)],
    ):
        require_valid(subject.history(plans=shorter))


def changed_plan(subject: Subject) -> None:
    """A plan that changes, and a command that was not the one planned, are survived."""
    other = [plan + np.array([0.0, 0.05 * (t % 3)]) for t, plan in enumerate(subject.drive.plans)]
    require_valid(subject.history(plans=other))


def reset_starts_anew(subject: Subject) -> None:
    """After reset, a used localizer answers as a new one does."""
    used = subject.made()
    list(islice(steps(used, subject.drive, seed=1), _HALF))
    require_same(
        subject.history(used),
        subject.history(),
        "after reset the localizer remembers its previous run",
    )


def picklable(subject: Subject) -> None:
    """A copy made by pickle continues as the original does, whether new or halfway."""
    expected, drive, original = subject.history(), subject.drive, subject.made()
    copy = pickle.loads(pickle.dumps(original))
    require_same(subject.history(copy), expected, "a pickled copy differs")
    half = islice(steps(original, drive), _HALF + 1)
    run = [snapshot(belief, t) for t, (belief, _) in enumerate(half)]
    copy = pickle.loads(pickle.dumps(original))
    run += [snapshot(copy.update(*drive.inputs(t)), t) for t in range(_HALF + 1, DRIVE_STEPS + 1)]
    require_same(run, expected, "a copy pickled halfway differs")


def runs_in_a_worker(subject: Subject) -> None:
    """In a spawned process, found there again by its name, it answers the same."""
    task = subject.sent, subject.name, dict(subject.params), subject.robot, subject.drive
    try:
        sent = pickle.dumps(task)
    except Exception as error:
        raise LawBrokenError(
            f"it cannot be sent to another process ({type(error).__name__}: {error}): check it by "
            "its name, as package.module:NAME or path/to/file.py:NAME"
        ) from error
    with safe_path(), ProcessPoolExecutor(1, get_context("spawn")) as worker:
        try:
            answer = worker.submit(_history_of, sent).result()
        except BrokenProcessPool:
            raise LawBrokenError("a spawned process ended without an answer") from None
    if isinstance(answer, str):
        raise LawBrokenError(f"in a spawned process: {answer}")
    require_same(answer, subject.history(), "a spawned process gives different results")


def _history_of(task: bytes) -> list[Snapshot] | str:
    """Return what a spawned process computes, or what was raised there."""
    try:
        sent, name, params, robot, drive = pickle.loads(task)
        factory = resolve(sent) if isinstance(sent, str) else sent
        subject = Subject(name=name, factory=factory, params=params, robot=robot, drive=drive)
        return subject.history()
    except LawBrokenError as error:
        return str(error)
    except Exception as error:
        return f"it raised {raised(error)}"


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


def _turned(plan: Map) -> Map:
    """Return a floor plan turned by π about the origin."""
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
    turned[:, 2] = wrapped(turned[:, 2])
    return turned


def _require_alike(subject: Subject, other: Sequence[Snapshot], when: str) -> None:
    """Raise unless the mean poses of the present agree with the subject's own at every step.

    Within one standard deviation of the belief, plus a hundredth of the map's shorter side, or 0.1
    rad: rounding may send a particle another way, which moves a mean by far less than that;
    headings that are not treated as angles move it by far more.
    """
    slack = size_of(subject.robot.floor_plan) / 100
    for t, (one, two) in enumerate(zip(subject.history(), other, strict=True)):
        poses, weights = one[0]
        mean = np.array(mean_pose(poses, weights))
        off, spread = np.array(mean_pose(*two[0])) - mean, poses - mean
        off[2], spread[:, 2] = wrapped(off[2]), wrapped(spread[:, 2])
        allowed = np.sqrt(weights @ np.square(spread)) + np.array([slack, slack, 0.1])
        if not (np.abs(off) <= allowed).all():
            raise LawBrokenError(
                f"{when} the mean pose at step {t} differs by ({off[0]:.3g}, {off[1]:.3g}, "
                f"{off[2]:.3g} rad) in (x, y, heading)"
            )


LAWS: Laws[Subject] = {
    makes_a_localizer: None,
    answers_with_beliefs: makes_a_localizer,
    finite: answers_with_beliefs,
    weights_sum_to_one: finite,
    whole_turn: weights_sum_to_one,
    half_turn: weights_sum_to_one,
    same_rng_same_result: answers_with_beliefs,
    increments_of_three: same_rng_same_result,
    other_rng_other_result: same_rng_same_result,
    global_rng_untouched: answers_with_beliefs,
    process_state_untouched: answers_with_beliefs,
    nothing_left_running: answers_with_beliefs,
    inputs_not_changed: answers_with_beliefs,
    robot_and_prior_not_changed: answers_with_beliefs,
    inputs_not_kept: same_rng_same_result,
    outputs_are_fresh: same_rng_same_result,
    beliefs_stay: answers_with_beliefs,
    prior_without_mean: weights_sum_to_one,
    zero_likelihood: weights_sum_to_one,
    max_range_scan: weights_sum_to_one,
    bad_beams: weights_sum_to_one,
    huge_actions: weights_sum_to_one,
    one_particle: weights_sum_to_one,
    short_plan: weights_sum_to_one,
    changed_plan: weights_sum_to_one,
    reset_starts_anew: same_rng_same_result,
    picklable: same_rng_same_result,
    runs_in_a_worker: same_rng_same_result,
}
