"""The plan shown at t as an observation of the present, beside the scan."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from deqmcl_gym.numerics.types import Floats, Ints
from deqmcl_gym.validation import number
from localizers.inference import kernels
from localizers.inference.belief import ParticleBelief, PlanReading
from localizers.inference.parts import Actions, PlanModel

Known = Callable[[Actions | None, Actions], int]


def nothing_known(last: Actions | None, plan: Actions) -> int:
    """Charge all steps of every plan: its author has looked at the robot again."""
    return 0


def steps_known(last: Actions | None, plan: Actions) -> int:
    """Charge each planned step once: a plan that merely continues the last one adds nothing."""
    return 0 if last is None else kernels.agreeing(last[1:], plan)


@dataclass(frozen=True, kw_only=True)
class PlanEvidence:
    """w ← w p(π_t | x_t, m)^λ, at every step and at the start: the ``Lookahead`` of ``mcl-plan``.

    γ_t gets the factors Π_{0 ≤ s ≤ t} p(π_s | x_s, m). They stay in the filter's own weights,
    because they are about the present, not about a future that is still to come.

    A long plan is feasible only from a precise heading, so in a coarse cloud it would leave few
    particles. λ is therefore the largest in [0, 1] that leaves ``keep`` of the effective sample
    size. γ_t is the target only at ``keep`` = 0.

    Attributes:
        sensor: p(π_t | x_t, m).
        steps: L, how many planned steps are read; None: all.
        keep: κ in [0, 1].
        known: how many first steps of a plan are already charged, given those of the last one.
    """

    sensor: PlanModel
    steps: int | None = None
    keep: float = 0.0
    known: Known = nothing_known

    def __post_init__(self) -> None:
        number("keep", self.keep, low=0, high=1)

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief given the plan (h, k); draws no random numbers."""
        last = belief.plan_reading
        if last is not None and last.shown is plan:  # the start was chosen by it
            return belief
        seen = plan[: self.steps]
        first = self.known(None if last is None else last.seen, plan)
        if first >= len(seen):  # further than ``steps`` where the start was chosen by all of it
            return belief._replace(plan_reading=PlanReading(plan, plan[:first]))
        collisions = self.sensor.collisions(belief.present, seen, first)
        tempering, feasible, log_evidence = kernels.tempering(
            belief.weights, collisions, self.sensor.beta, self.keep
        )
        read = belief.reweighted(_charges(tempering, self.sensor.beta, collisions))
        if feasible == 0.0:
            read = read._replace(events=read.events.plus(infeasible_plans=1))
        return read._replace(
            plan_reading=PlanReading(plan, seen, tempering, feasible, log_evidence)
        )


def _charges(tempering: float, beta: float, collisions: Ints) -> Floats:
    """-λ β C of each state, (n,); 0 at λ = 0, even if β is infinite."""
    per_count = np.zeros(int(collisions.max()) + 1)
    if tempering > 0.0:
        per_count[1:] = -(tempering * beta) * np.arange(1.0, per_count.size)
    charges: Floats = per_count[collisions]
    return charges
