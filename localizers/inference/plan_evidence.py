"""What the plan shown at t says of the present, beside the scan.

The plan as an observation, and how feasible its future is from a state.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import exp64, log64
from deqmcl_gym.numerics.types import Floats, Ints
from deqmcl_gym.validation import number
from localizers.inference.belief import ParticleBelief, PlanReading
from localizers.inference.futures import DrawnFuture, Rollout, agreeing
from localizers.inference.parts import Actions
from localizers.models.plan_sensor import PlanSensor, charges

# Takes in what the plan (h, k) says of the present, at the start and at every step. By
# h_t(x_t) = E[Π g of the planned future | x_t], which weights what is reported; or, as
# ``PlanEvidence``, by an observation of x_t, which stays.
Lookahead = Callable[[ParticleBelief, Actions, np.random.Generator], ParticleBelief]


@dataclass(frozen=True, kw_only=True)
class Foresight:
    """Draws the planned future of every particle anew after each scan, and may weigh by it.

    ``weighs``: the reported weights are multiplied by ĥ_t(x_t), the mean of Π g over the roll-outs,
    which is unbiased for h_t(x_t): with the future that is kept, the cloud targets the paper's
    Q(t). The filter's own weights stay: multiplied into them at every step, the future would count
    up to F times. Lin, Chen & Liu 2013 call such roll-outs pilots.

    Attributes:
        steps: F, how far to look.
        copies: M, roll-outs of each particle.
        weighs: whether the reported weights count what collides.
        evidence: takes in the plan as evidence of the present first; None: nothing does.
    """

    rollout: Rollout
    steps: int
    copies: int
    weighs: bool = False
    evidence: Lookahead | None = None

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief, looking ahead by a stream of its own: the filter's draws stay."""
        if self.evidence is not None:
            belief = self.evidence(belief, plan, rng)
        window = plan[: self.steps]
        if len(window) == 0:
            return belief
        stream = rng.spawn(1)[0]
        future = DrawnFuture(self.rollout, belief.present, window, self.copies, stream)
        belief = belief._replace(foreseen=future)
        return belief.foreseeing(future.log_h) if self.weighs else belief


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
        new_only: whether each planned step is charged once, when it comes into view: a plan that
            merely continues the last one adds nothing. Else all steps of every plan: its author has
            looked at the robot again.
    """

    sensor: PlanSensor
    steps: int | None = None
    keep: float = 0.0
    new_only: bool = False

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
        first = agreeing(last.seen[1:], plan) if self.new_only and last is not None else 0
        if first >= len(seen):  # further than ``steps`` where the start was chosen by all of it
            return belief.remembering(PlanReading(plan, plan[:first]))
        collisions = self.sensor.collisions(belief.present, seen, first)
        power, feasible, log_evidence = tempering(
            belief.weights, collisions, self.sensor.beta, self.keep
        )
        beta = power * self.sensor.beta if power > 0.0 else 0.0  # also if it is infinite
        read = belief.reweighted(charges(beta, collisions))
        if feasible == 0.0:
            read = read._replace(events=read.events.plus(infeasible_plans=1))
        return read.remembering(PlanReading(plan, seen, power, feasible, log_evidence))


@compiled
def tempering(
    weights: Floats, collisions: Ints, beta: float, keep: float
) -> tuple[float, float, float]:
    """Return λ, the largest of 0 … 1 at which exp(-λ β C) leaves ``keep`` of the sample size.

    By bisection, to 2⁻⁴⁰; the effective sample size is never less. It is one of weight and squared
    weight at each value of C.

    Args:
        weights: with sum 1, (n,).
        collisions: C, (n,).
        beta: β ≥ 0, may be infinite: then λ is 1, or 0 as a limit.
        keep: share of the effective sample size.

    Returns:
        λ, the weight where C is 0, and log Σ w exp(-λ β C).
    """
    sums, squares = np.zeros((2, collisions.max() + 1))
    for i in range(weights.size):
        sums[collisions[i]] += weights[i]
        squares[collisions[i]] += weights[i] * weights[i]
    least = 0
    while not sums[least] > 0.0:
        least += 1
    wanted = keep / np.sum(squares)
    factor = np.ones(sums.size)
    low, high, power = 0.0, 1.0, 1.0
    for _ in range(40):
        total, square = sums[least], squares[least]
        for c in range(least + 1, sums.size):
            factor[c] = exp64(-power * (beta * (c - least)))
            total += factor[c] * sums[c]
            square += factor[c] * factor[c] * squares[c]
        if total * total >= wanted * square:
            low = power
        else:
            high = power
        if low == 1.0:
            break
        power = 0.5 * (low + high)
    total = sums[least]
    for c in range(least + 1, sums.size):
        total += sums[c] * (exp64(-low * (beta * (c - least))) if low > 0.0 else 1.0)
    shift = low * (beta * least) if least > 0 and low > 0.0 else 0.0
    return low, sums[0], log64(total) - shift
