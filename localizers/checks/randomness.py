"""Laws on randomness and on hard cases.

The generator given to reset is the only one; odd priors, scans and plans leave finite weights.
"""

import random
from dataclasses import replace
from typing import Any

import numpy as np

from deqmcl_gym.validation import InputError
from localizers.checks.subject import (
    LawBrokenError,
    LawSkippedError,
    Subject,
    first_difference,
    history,
    require_same,
    require_valid,
)
from localizers.models.beams import GaussianUniform
from localizers.models.prior import UniformPrior
from localizers.naming.registry import parameters_of


def prior_without_mean(subject: Subject) -> str | None:
    """A prior without a mean, uniform over free space, is accepted or refused by an InputError."""
    prior = UniformPrior(floor_plan=subject.robot.floor_plan)
    try:
        require_valid(history(subject.made(), subject.drive, prior=prior))
    except InputError:
        return "refused"
    return None


def zero_likelihood(subject: Subject) -> None:
    """Scans that no pose explains (all beams 0; σ = 0.001, no uniform share) are survived."""
    robot = replace(subject.robot, scan=GaussianUniform(sigma=1e-3, uniform=0.0))
    scans = subject.drive.scans.copy()
    scans[: len(scans) // 2] = 0.0
    require_valid(history(subject.made(robot), replace(subject.drive, scans=scans)))


def max_range_scan(subject: Subject) -> None:
    """Scans whose beams all read max_range are survived."""
    scans = np.full_like(subject.drive.scans, subject.robot.lidar.max_range)
    require_valid(history(subject.made(), replace(subject.drive, scans=scans)))


def bad_beams(subject: Subject) -> None:
    """Beams that read NaN, ±inf, less than 0 or more than max_range are survived.

    One beam of a scan first, then all of them.
    """
    bad = (np.nan, np.inf, -np.inf, -1.0, 1.5 * subject.robot.lidar.max_range)
    scans = subject.drive.scans.copy()
    for t, value in enumerate(bad):
        scans[t, 0] = value
        scans[len(bad) + t] = value
    require_valid(history(subject.made(), replace(subject.drive, scans=scans)))


def huge_actions(subject: Subject) -> str | None:
    """A planned distance or turn of 1e30 is survived, or refused by an InputError."""
    refused, drive, step = 0, subject.drive, len(subject.drive.actions) // 2
    for huge in ((1e30, 0.0), (0.0, 1e30)):
        actions, plans = drive.actions.copy(), [plan.copy() for plan in drive.plans]
        actions[step] = huge
        for t, plan in enumerate(plans[: step + 1]):
            plan[step - t] = huge
        try:
            with np.errstate(all="ignore"):  # an overflow shows in what it returns
                require_valid(history(subject.made(), replace(drive, actions=actions, plans=plans)))
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
    drive = subject.drive
    steps = len(drive.actions)
    for plans in (
        [plan[:0] for plan in drive.plans],
        [plan[:2] for plan in drive.plans],
        [plan[: steps - t] for t, plan in enumerate(drive.plans)],
    ):
        require_valid(history(subject.made(), replace(drive, plans=plans)))


def changed_plan(subject: Subject) -> None:
    """A plan that changes, and a command that was not the one planned, are survived."""
    drive = subject.drive
    other = [plan + np.array([0.0, 0.05 * (t % 3)]) for t, plan in enumerate(drive.plans)]
    require_valid(history(subject.made(), replace(drive, plans=other)))


def same_rng_same_result(subject: Subject) -> None:
    """Two new localizers given equal generators believe the same, bit by bit."""
    require_same(subject.history(), subject.history(), "two runs with equal rng differ")


def other_rng_other_result(subject: Subject) -> str | None:
    """Another generator gives another belief; a deterministic localizer draws nothing."""
    if first_difference(subject.history(seed=0), subject.history(seed=1)) is not None:
        return None
    rng = np.random.default_rng(0)
    before = _state(rng)
    subject.history(seed=rng)
    if _state(rng) != before:
        raise LawBrokenError(
            "it draws from rng, yet another rng changes nothing: use only the rng given to reset"
        )
    return "deterministic, it draws nothing"


def global_rng_untouched(subject: Subject) -> None:
    """Neither NumPy's global random state nor that of ``random`` changes."""
    held = np.random.get_state(), random.getstate()  # noqa: NPY002
    try:
        np.random.seed(2_718_281)  # noqa: NPY002
        random.seed(2_718_281)
        before = global_states()
        subject.history()
        touched = [name for name, state in global_states().items() if state != before[name]]
    finally:
        np.random.set_state(held[0])  # noqa: NPY002
        random.setstate(held[1])
    if touched:
        raise LawBrokenError(
            f"it uses the global random numbers of {' and '.join(touched)}: use the rng given to "
            "reset"
        )


def global_states() -> dict[str, Any]:
    """Return the states of the global generators by name."""
    legacy: Any = np.random.get_state(legacy=False)  # noqa: NPY002
    numpy_state = legacy["state"]["pos"], legacy["state"]["key"].tobytes(), legacy["has_gauss"]
    return {"numpy.random": numpy_state, "random": random.getstate()}


def _state(rng: np.random.Generator) -> tuple[Any, int]:
    """Draws move the first, spawned children the second."""
    seeds: Any = rng.bit_generator.seed_seq
    return rng.bit_generator.state, seeds.n_children_spawned
