"""Laws on hard cases: odd priors, scans and plans. Weights must stay finite, with sum 1."""

from dataclasses import replace

import numpy as np

from deqmcl_gym.validation import InputError
from localizers.checks.subject import LawSkippedError, Subject, history, require_valid
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


def one_particle(subject: Subject) -> None:
    """A localizer with a parameter ``particles`` works with 1."""
    if "particles" not in (parameters_of(subject.factory) or ()):
        raise LawSkippedError("it has no parameter particles")
    require_valid(subject.history(subject.made(particles=1)))


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
