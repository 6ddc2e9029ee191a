"""The laws that every localizer keeps: plain functions, in the order in which they are tried.

A law takes a subject, returns a remark if there is any, and raises ``LawBrokenError`` or
``LawSkippedError`` with the reason. ``LAWS``, at the end, says which one needs which. Those of a
``Subject`` are laws of agents and scan models, too.
"""

import gc
import math
import os
import pickle
import random
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from itertools import islice
from multiprocessing import get_context
from types import SimpleNamespace
from typing import Any

import numpy as np

from deqmcl_gym.maps import GridMap, Map, PolygonMap
from deqmcl_gym.numerics import Floats
from deqmcl_gym.numerics.arrays import wrapped
from deqmcl_gym.validation import InputError
from localizers.checks.subject import (
    ADDED_BY_IMPORTS,
    DRIVE_STEPS,
    GLOBAL_RNG,
    LawBrokenError,
    LawSkippedError,
    LocalizerDrive,
    Subject,
    changes_since,
    difference,
    process_state,
    running,
    snapshot,
)
from localizers.kinds import parameters_of, raised
from localizers.models.motion import increments
from localizers.models.prior import UniformPrior
from localizers.models.scan import GaussianUniform

Law = Callable[[Any], str | None]  # of a subject; it may return a remark
Laws = Mapping[Law, Law | None]  # each with the one that must hold before it is tried

_HALF = DRIVE_STEPS // 2


def answers_in_time(subject: Subject) -> None:
    """A drive ends within the time limit, at which ``deqmcl check`` stops it."""
    for _ in ("compiled", "run"):
        began = time.monotonic()
        with suppress(Exception, SystemExit):  # what it raises breaks other laws
            subject.history()
        seconds = time.monotonic() - began
        if seconds <= subject.time_limit:
            return
    raise LawBrokenError(f"a drive took {seconds:.1f} s, more than {subject.time_limit:g} s")


def makes_a_localizer(subject: LocalizerDrive) -> None:
    """The factory makes an object with reset and update, a new one at each call."""
    if subject.made() is subject.made():
        raise LawBrokenError("the factory returned the same object twice: make a new one")


def answers_with_beliefs(subject: LocalizerDrive) -> str:
    """Reset and every update return a belief whose points(0) are poses (n, 3), weights (n,)."""
    run = subject.history()
    offsets = sorted(set().union(*run))
    span = f"steps {offsets[0]:+d} to {offsets[-1]:+d}" if offsets[1:] else "the present alone"
    n = max(len(weights) for belief in run for _, weights in belief.values())
    return f"{span}, {'one point' if n == 1 else f'up to {n} points'}"


def finite(subject: LocalizerDrive) -> None:
    """All poses and weights are finite numbers."""
    subject.require_valid(sums=False)


def weights_sum_to_one(subject: LocalizerDrive) -> None:
    """Weights are 0 or more, with sum 1 within 0.001: who uses them divides by their sum."""
    subject.require_valid()


def whole_turn(subject: LocalizerDrive) -> None:
    """A prior whose mean heading is written 2π higher gives the same mean pose."""
    prior = subject.prior
    x, y, heading = prior.mean
    higher = replace(prior, mean=(x, y, heading + 2 * math.pi))
    subject.require_alike(subject.history(prior=higher), "with a start heading written 2π higher")


def half_turn(subject: LocalizerDrive) -> None:
    """In a world turned by π about the origin the mean pose is turned by π too.

    Where headings in one world are about 0, they are about ±π in the other: a mean of headings
    that is not a mean of directions shows.
    """
    robot, prior = subject.robot, subject.prior
    turned_prior = SimpleNamespace(
        mean=tuple(_half_turned(np.array([prior.mean]))[0].tolist()),
        sample=lambda n, rng: _half_turned(prior.sample(n, rng)),
        log_density=lambda poses: prior.log_density(_half_turned(np.asarray(poses))),
    )
    turned = replace(robot, floor_plan=_turned(robot.floor_plan))
    run = subject.history(robot=turned, prior=turned_prior)
    back = [{0: (_half_turned(belief[0][0]), belief[0][1])} for belief in run]
    subject.require_alike(back, "in a world turned by half a turn")


def same_rng_same_result(subject: Subject) -> None:
    """Two that are made anew and given equal generators answer alike, bit by bit."""
    subject.require_same(subject.history(), f"two runs with equal rng differ: {subject.remedy}")


def increments_of_three(subject: LocalizerDrive) -> None:
    """Increments (d, 0, φ), as of recorded logs, give the beliefs that (d, φ) give, bit by bit.

    A localizer for which they do not runs in rooms, but not on logs: the law is skipped.
    """
    plans = [increments(plan) for plan in subject.plans]
    try:
        wide = subject.history(actions=increments(subject.actions), plans=plans)
        subject.require_same(wide, "(d, 0, φ) gives another belief than (d, φ)")
    except Exception as error:
        why = error if isinstance(error, LawBrokenError) else raised(error)
        raise LawSkippedError(
            f"not for logs, whose increments have three numbers: {why}"
        ) from error


def other_rng_other_result(subject: LocalizerDrive) -> str | None:
    """Another generator gives another belief; a deterministic localizer draws nothing."""
    if difference(subject.history(seed=0), subject.history(seed=1)) is not None:
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
    np.random.seed(2_718_281)  # noqa: NPY002
    random.seed(2_718_281)
    before = process_state()
    subject.history()
    if GLOBAL_RNG in changes_since(before):
        raise LawBrokenError(f"it uses {GLOBAL_RNG}: {subject.remedy}")


def process_state_untouched(subject: LocalizerDrive) -> None:
    """Working folder, signal handlers, np.seterr, os.environ and the like stay as they are.

    An import may add to the filters of warnings, to os.environ and to sys.path, as many do.
    """
    before = process_state()
    subject.history()
    by_run = [name for name in changes_since(before) if name != GLOBAL_RNG]
    by_import = [name for name in subject.imported if name not in ADDED_BY_IMPORTS]
    for what, names in (("its import", by_import), ("it", by_run)):
        if names:
            raise LawBrokenError(
                f"{what} changes {', '.join(names)} for its whole process: change it in a call "
                "that puts it back before it returns"
            )


def nothing_left_running(subject: LocalizerDrive) -> None:
    """A second after the localizer is gone, no thread and no process that it started runs on."""
    before = running()
    subject.history()
    gc.collect()
    until = time.monotonic() + 1.0
    while left := [name for key, name in running().items() if key not in before]:
        if time.monotonic() > until:
            more = f" and {len(left) - 1} more" if left[1:] else ""
            raise LawBrokenError(f"it leaves {left[0]}{more} running: end what it starts")
        time.sleep(0.01)


def inputs_not_changed(subject: Subject) -> None:
    """Whatever it is given is as it was before the call."""
    if name := subject.written():
        raise LawBrokenError(f"it wrote into {name}: copy it")


def robot_and_prior_not_changed(subject: LocalizerDrive) -> None:
    """No number and no array of the robot, its map and the prior changes during a run."""
    robot, prior = subject.robot, subject.prior
    at = np.array([prior.mean])
    robot.floor_plan.ranges(at, robot.lidar.bearings)  # fills caches
    robot.floor_plan.collides(at, at, robot.radius)
    before = {"robot": robot, "prior": prior}
    copies: dict[str, Any] = deepcopy(before)
    subject.history(**copies)
    if name := difference(before, copies):
        raise LawBrokenError(f"it wrote into {name}: copy it")


def inputs_not_kept(subject: LocalizerDrive) -> None:
    """What the caller writes into ranges, action and plan after the call changes nothing."""
    run = []
    for t, (belief, inputs) in enumerate(subject.steps()):
        run.append(snapshot(belief, t))
        for array in inputs.values():
            array[...] = np.nan
    otherwise = "it still reads an array given to it earlier, which the caller has changed since"
    subject.require_same(run, otherwise)


def outputs_are_fresh(subject: LocalizerDrive) -> None:
    """Writing into the arrays that points returned changes no belief, now or later."""
    run = []
    for t, (belief, _) in enumerate(subject.steps()):
        run.append(snapshot(belief, t))
        for array in (array for offset in run[-1] for array in belief.points(offset) or ()):
            if array.flags.writeable:
                array[...] = 1e6
        if difference(run[-1], snapshot(belief, t)):
            raise LawBrokenError("points returns its own array, not a copy")
    subject.require_same(run, "points returns an array that the localizer still uses")


def beliefs_stay(subject: LocalizerDrive) -> None:
    """A belief says the same after the localizer has gone on, and after its next reset."""
    localizer, beliefs, run = subject.made(), [], []
    for t, (belief, _) in enumerate(subject.steps(localizer)):
        beliefs.append(belief)
        run.append(snapshot(belief, t))
    subject.history(localizer, seed=1)
    again = [snapshot(belief, t) for t, belief in enumerate(beliefs)]
    if difference(run, again):
        raise LawBrokenError("an earlier belief changed with a later update")


def prior_without_mean(subject: LocalizerDrive) -> str | None:
    """A prior without a mean, uniform over free space, is accepted or refused by an InputError."""
    return _valid_or_refused(subject, prior=UniformPrior(floor_plan=subject.robot.floor_plan))


def zero_likelihood(subject: LocalizerDrive) -> None:
    """Scans that no pose explains (all beams 0; σ = 0.001, no uniform share) are survived."""
    robot = replace(subject.robot, scan=GaussianUniform(sigma=1e-3, uniform=0.0))
    scans = subject.scans.copy()
    scans[: len(scans) // 2] = 0.0
    subject.require_valid(robot=robot, scans=scans)


def max_range_scan(subject: LocalizerDrive) -> None:
    """Scans whose beams all read max_range are survived."""
    scans = np.full_like(subject.scans, subject.robot.lidar.max_range)
    subject.require_valid(scans=scans)


def bad_beams(subject: LocalizerDrive) -> None:
    """Beams that read NaN, ±inf, less than 0 or more than max_range are survived.

    One beam of a scan first, then all of them.
    """
    bad = (np.nan, np.inf, -np.inf, -1.0, 1.5 * subject.robot.lidar.max_range)
    scans = subject.scans.copy()
    scans[: len(bad), 0] = bad
    scans[len(bad) : 2 * len(bad)] = np.array(bad)[:, None]
    subject.require_valid(scans=scans)


def huge_actions(subject: LocalizerDrive) -> str | None:
    """A planned distance or turn of 1e30 is survived, or refused by an InputError."""
    answers = []
    for huge in ((1e30, 0.0), (0.0, 1e30)):
        actions, plans = deepcopy((subject.actions, subject.plans))
        actions[_HALF] = huge
        for t, plan in enumerate(plans[: _HALF + 1]):
            plan[_HALF - t] = huge
        with np.errstate(all="ignore"):  # an overflow shows in what it returns
            answers.append(_valid_or_refused(subject, actions=actions, plans=plans))
    return answers[0] or answers[1]


def one_particle(subject: LocalizerDrive) -> str | None:
    """A localizer with a parameter ``particles`` works with 1, or refuses it by an InputError."""
    if "particles" not in (parameters_of(subject.factory) or ()):
        raise LawSkippedError("it has no parameter particles")
    return _valid_or_refused(subject, params={**subject.params, "particles": 1})


def short_plan(subject: LocalizerDrive) -> None:
    """A plan that is empty, that shows two steps at a time, or that runs out is followed."""
    shown = [0] * (DRIVE_STEPS + 1), [2] * (DRIVE_STEPS + 1), range(DRIVE_STEPS, -1, -1)
    for steps in shown:
        plans = [plan[:n] for plan, n in zip(subject.plans, steps, strict=True)]
        subject.require_valid(plans=plans)


def changed_plan(subject: LocalizerDrive) -> None:
    """A plan that changes, and a command that was not the one planned, are survived."""
    other = [plan + np.array([0.0, 0.05 * (t % 3)]) for t, plan in enumerate(subject.plans)]
    subject.require_valid(plans=other)


def reset_starts_anew(subject: LocalizerDrive) -> None:
    """After reset, a used localizer answers as a new one does."""
    used = subject.made()
    list(islice(subject.steps(used, seed=1), _HALF))
    otherwise = "after reset the localizer remembers its previous run"
    subject.require_same(subject.history(used), otherwise)


def picklable(subject: LocalizerDrive) -> None:
    """A copy made by pickle continues as the original does, whether new or halfway."""
    original = subject.made()
    copy = pickle.loads(pickle.dumps(original))
    subject.require_same(subject.history(copy), "a pickled copy differs")
    half = islice(subject.steps(original), _HALF + 1)
    run = [snapshot(belief, t) for t, (belief, _) in enumerate(half)]
    copy = pickle.loads(pickle.dumps(original))
    rest = range(_HALF + 1, DRIVE_STEPS + 1)
    run += [snapshot(copy.update(*subject.inputs(t).values()), t) for t in rest]
    subject.require_same(run, "a copy pickled halfway differs")


def runs_in_a_worker(subject: LocalizerDrive) -> None:
    """In a spawned process, found there again by its name, it answers the same."""
    try:
        sent = pickle.dumps(subject)
    except Exception as error:
        raise LawBrokenError(
            f"it cannot be sent to another process ({type(error).__name__}: {error}): check it by "
            "its name, as package.module:NAME or path/to/file.py:NAME"
        ) from error
    with ProcessPoolExecutor(1, get_context("spawn")) as worker:
        os.environ["PYTHONSAFEPATH"] = "1"  # it finds no modules in the working folder
        try:
            answer = worker.submit(_history_of, sent).result()
        except BrokenProcessPool:
            raise LawBrokenError("a spawned process ended without an answer") from None
    if isinstance(answer, str):
        raise LawBrokenError(f"in a spawned process: {answer}")
    subject.require_same(answer, "a spawned process gives different results")


def _history_of(subject: bytes) -> Any:
    """Return what a spawned process computes, or what was raised there."""
    try:
        return pickle.loads(subject).history()
    except Exception as error:
        return str(error) if isinstance(error, LawBrokenError) else f"it raised {raised(error)}"


def _valid_or_refused(subject: LocalizerDrive, **changes: Any) -> str | None:
    try:
        subject.require_valid(**changes)
    except InputError:
        return "refused"
    return None


def _turned(plan: Map) -> Map:
    """Return a floor plan turned by π about the origin."""
    if isinstance(plan, GridMap):
        x, y, yaw = plan.origin
        return replace(plan, origin=(-x, -y, yaw - math.pi if yaw > 0 else yaw + math.pi))
    if not isinstance(plan, PolygonMap):
        raise LawSkippedError("the floor plan is of a form of its own, so it cannot be turned")
    outer, *obstacles = ([(-x, -y) for x, y in p] for p in (plan.outer, *plan.obstacles))
    return PolygonMap(outer=outer, obstacles=tuple(obstacles), unit=plan.unit)


def _half_turned(poses: Floats) -> Floats:
    x, y, heading = poses.T
    return np.column_stack([-x, -y, wrapped(heading + math.pi)])


_OF_BELIEFS = (
    *(same_rng_same_result, global_rng_untouched, process_state_untouched, nothing_left_running),
    *(inputs_not_changed, robot_and_prior_not_changed, beliefs_stay),
)
_OF_WEIGHTS = (
    *(whole_turn, half_turn, prior_without_mean, zero_likelihood, max_range_scan, bad_beams),
    *(huge_actions, one_particle, short_plan, changed_plan),
)
_OF_REPETITION = (
    *(increments_of_three, other_rng_other_result, inputs_not_kept, outputs_are_fresh),
    *(reset_starts_anew, picklable, runs_in_a_worker),
)
LAWS: Laws = {
    answers_in_time: None,
    makes_a_localizer: answers_in_time,
    answers_with_beliefs: makes_a_localizer,
    finite: answers_with_beliefs,
    weights_sum_to_one: finite,
    **dict.fromkeys(_OF_WEIGHTS, weights_sum_to_one),
    **dict.fromkeys(_OF_BELIEFS, answers_with_beliefs),
    **dict.fromkeys(_OF_REPETITION, same_rng_same_result),
}
