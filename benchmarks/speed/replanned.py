"""A localizer's step where the plan is another one at every step: a lap of scenario guided.

A queue has to redraw its future there, and a table of h is made anew; on a plan that is kept, both
are spared.
"""

from dataclasses import dataclass
from functools import cache, partial
from itertools import count

import numpy as np

from benchmarks.setup.names import scenario
from benchmarks.speed.figure import Figure, Side
from benchmarks.speed.timing import Job
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
    steps: tuple[tuple[Reals, Reals, Reals], ...]


@cache
def replanned_lap() -> Replanned:
    """Drive the lap and record it."""
    setup = scenario("guided")
    room = setup.room()
    env = room.unwrapped
    _, info = env.reset(seed=0)
    plans, steps, ended = [np.array(info["planned_actions"])], [], False
    while info["planned_count"] and not ended:
        ranges, _, terminated, truncated, info = env.step(plans[-1][0])
        plans.append(info["planned_actions"][: info["planned_count"]].copy())
        steps.append((ranges.copy(), info["action"].copy(), plans[-1]))
        ended = terminated or truncated
    return Replanned(
        robot=setup.robot_model(room),
        prior=setup.prior_in(room),
        first=plans[0],
        steps=tuple(steps),
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
