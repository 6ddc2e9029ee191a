"""Whether the plans shown are about this robot: a latent variable of each particle, summed out."""

from dataclasses import dataclass

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Ints
from deqmcl_gym.validation import number
from localizers.inference.belief import ParticleBelief, PlanReading
from localizers.inference.parts import Actions, PlanModel, States


@dataclass(frozen=True, kw_only=True)
class DoubtedPlans:
    """w ← w [v p(π_t | x_t, m) + (1 - v) p(π_t | m)]: the ``Lookahead`` of plans that may be stale.

    V_t = 1 if plans are about this robot; it switches with a small probability at each step, and
    v = P(V_t = 1 | path, plans before). Then v ← v p(π_t | x_t, m) / [the factor above]. The
    likelihood of a plan about another robot is the mean of e^{-βC} over free space. V_t is summed
    out in each particle (Rao-Blackwellised), so this is exact at every number of particles.

    Attributes:
        sensor: p(π_t | x_t, m) of a plan that is about this robot.
        anywhere: states spread evenly over free space, (d, M).
        switching: P(V_t ≠ V_{t-1}), also P(V_0 = 0); 0: plans are never doubted.
        steps: L, how many planned steps are read; None: all.
    """

    sensor: PlanModel
    anywhere: States
    switching: float
    steps: int | None = None

    def __post_init__(self) -> None:
        number("validity", self.switching, low=0, high=0.5)

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief given the plan (h, k); draws no random numbers."""
        last, seen = belief.plan_reading, plan[: self.steps]
        if last is not None and last.shown is plan:  # the start was chosen by it
            return belief
        before = np.ones(belief.log_weights.size) if belief.valid is None else belief.valid
        valid: Floats = before * (1.0 - self.switching) + (1.0 - before) * self.switching
        if len(seen) == 0:
            return belief._replace(valid=valid, plan_reading=PlanReading(plan, seen))
        collisions = self.sensor.collisions(belief.present, seen)
        right = valid * self._likelihoods(collisions)
        factor = right + (1.0 - valid) * self._likelihoods(self._elsewhere(seen)).mean()
        prior = belief.weights
        feasible = float(prior[collisions == 0].sum())
        told = factor > 0.0
        some = np.where(told, factor, 1.0)
        valid = np.where(told, right / some, valid)
        read = belief.reweighted(np.where(told, arrays.log(some), -np.inf))
        if feasible == 0.0:
            read = read._replace(events=read.events.plus(infeasible_plans=1))
        evidence = float(arrays.log((prior * factor).sum())) if told.any() else -np.inf
        share = float((read.weights * valid).sum())  # no BLAS: the same bits everywhere
        reading = PlanReading(plan, seen, 1.0, feasible, evidence, share)
        return read._replace(valid=valid, plan_reading=reading)

    def _elsewhere(self, seen: Actions) -> Ints:
        return self.sensor.collisions(self.anywhere, seen)

    def _likelihoods(self, collisions: Ints) -> Floats:
        """e^{-βC} of each state, (n,); 1 where C is 0, even if β is infinite."""
        charges = np.zeros(int(collisions.max()) + 1)
        charges[1:] = -self.sensor.beta * np.arange(1.0, charges.size)
        return arrays.exp(charges)[collisions]
