"""A localizer's step where the plan is another one at every step: a lap of scenario guided.

A queue has to redraw its future there, and a table of h is made anew; on a plan that is kept, both
are spared.
"""

from dataclasses import dataclass
from functools import cache, partial
from itertools import count
from typing import Any

import numpy as np

from benchmarks.setup.changes import NOTHING
from benchmarks.speed.figure import Figure, Side
from benchmarks.speed.timing import Job
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.numerics.types import Reals
from localizers import Prior, RobotModel, make

FEW, MANY = 1_000, 10_000


@dataclass(frozen=True, kw_only=True)
class Replanned:
    """A lap of ``guided`` as a localizer sees it.

    Attributes:
        robot, prior: what the filters assume.
        first: the plan shown at reset, (h, 2).
        steps: scan (B,), action (2,) and the plan (h, 2) after it, of each step.
    """

    robot: RobotModel
    prior: Prior
    first: Reals
    steps: tuple[tuple[Any, ...], ...]


@cache
def replanned_lap() -> Replanned:
    """Drive the lap and record it."""
    stage = Stage.of(
        Trial(scenario="guided", localizer="dead-reckoning", params=NOTHING, lag=0, seed=0, trial=0)
    )
    first, *steps = stage.moments()
    assert first.plan is not None, "a driver shows its plan"
    return Replanned(
        robot=stage.robot,
        prior=stage.scenario.prior_in(stage.room),
        first=first.plan,
        steps=tuple((moment.ranges, moment.action, moment.plan) for moment in steps),
    )


def replanned_job(name: str, particles: int) -> Job:
    """Return the job of following the lap, over and over from its start; one step a call."""
    lap, numbers = replanned_lap(), count()
    localizer = make(name, lap.robot, particles=particles)

    def step() -> None:
        t = next(numbers) % len(lap.steps)
        if t == 0:
            localizer.reset(lap.prior, lap.first, np.random.default_rng(1))
        localizer.update(*lap.steps[t])

    return Job(step)


def _versus_map(figure: str, name: str, particles: int, target: float | None = None) -> Figure:
    return Figure(
        name=f"{figure}_vs_map_step{particles // 1000}k",
        what=f"step in scenario guided, a new plan at every step, N = {particles:,}, B = 1",
        unit="µs/step",
        ours=Side(f"{name}, L = 20", partial(replanned_job, name, particles)),
        other=Side("mcl-map", partial(replanned_job, "mcl-map", particles)),
        target=target,
    )


FIGURES = tuple(
    _versus_map(figure, name, particles, target)
    for particles in (FEW, MANY)
    for figure, name, target in (
        ("plan", "mcl-plan", 5.0),
        ("replanned_deq", "deq-mcl", None),
        ("replanned_pilots", "mcl-pilots", None),
        ("replanned_h", "mcl-h", None),
    )
)
