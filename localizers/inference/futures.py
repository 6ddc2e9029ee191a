"""Planned futures, drawn and charged for collisions, and what a plan says of the present.

Queued futures are drawn again when the actions that they were drawn with have changed; others are
drawn anew from the present after each scan. A plan may also be an observation, beside the scan.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from deqmcl_gym.numerics import Floats, Indices, Ints, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import exp64, log64
from deqmcl_gym.validation import number
from localizers.api import Motion
from localizers.inference.belief import ParticleBelief, PlanReading
from localizers.inference.particles import Actions, LogWeights, States
from localizers.models.feasibility import CostMap, PlanSensor, charges


@dataclass(frozen=True)
class Rollout:
    """x'_s ~ p(· | x'_{s-1}, u_s) step by step, with Σ log g(x'_{s-1}, x'_s); g = 1 without one."""

    motion: Motion
    feasibility: CostMap | None = None

    def futures(
        self, anchor: States, actions: Actions, copies: int, rng: np.random.Generator
    ) -> tuple[list[States], Floats]:
        """Draw ``copies`` = K futures from each state of ``anchor``, (d, n).

        Return the states after each step, (d, K n), and log Π g of each future, (K, n).
        """
        states, path = np.tile(anchor, (1, copies)), []
        log_g = np.zeros(states.shape[1])
        for action in actions:
            before, states = states, self.motion.sample(states, action, rng)
            if self.feasibility is not None:
                log_g += self.feasibility.log_g(before, states)
            path.append(states)
        return path, log_g.reshape(copies, -1)

    def one(
        self, anchor: States, actions: Actions, copies: int, rng: np.random.Generator
    ) -> tuple[list[States], LogWeights]:
        """Draw futures and keep one of each state, with probability ∝ Π g, (d, n) after each step.

        As ``copies`` grow it is a draw from p(x_{t+1:t+F} | x_t, actions) Π g(x_{s-1}, x_s). Return
        also the log of the mean of Π g, unbiased for h_t(x_t) before the log, (n,).
        """
        path, log_g = self.futures(anchor, actions, copies, rng)
        chosen = _choose(log_g, rng)
        return [states.take(chosen, axis=1) for states in path], log_mean(log_g)


def log_mean(log_values: Floats) -> LogWeights:
    """Log of the mean of exp over axis 0, (n,); -inf where all are."""
    top = log_values.max(axis=0)
    base = np.where(np.isfinite(top), top, 0.0)
    total: LogWeights = base + arrays.log(arrays.exp(log_values - base).sum(axis=0))
    return total - math.log(len(log_values))


@compiled
def agreeing(first: Floats, second: Floats) -> int:
    """How many leading rows of two tables (·, k) are the same, by exact comparison."""
    for row in range(min(len(first), len(second))):
        for column in range(first.shape[1]):
            if first[row, column] != second[row, column]:
                return row
    return min(len(first), len(second))


@dataclass(frozen=True)
class Redraw:
    """log w += log ĥ_new - log ĥ_old: replace the future drawn with an old plan.

    The weights already hold the g of the old future, most of it absorbed by past resampling, so it
    can be neither divided out nor left in. Per particle, from the last state x the plans share:
    ĥ_old is the mean of Π g over the particle's own old future and M - 1 fresh ones, ĥ_new the
    mean over M fresh futures under the new plan, of which one is kept with probability ∝ Π g.
    Properly weighted for every M = ``pilots`` ≥ 1 (Lin, Chen & Liu 2013).
    """

    rollout: Rollout
    pilots: int = 16

    def __call__(
        self, belief: ParticleBelief, actions: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return a belief with a future of ``actions``, (steps, k); one that ends earlier stays."""
        held = belief.queue.ahead
        shared = agreeing(belief.drawn, actions) if held else 0
        if shared == held:
            return belief
        anchor, *_ = queued = belief.queue.since(shared)
        old, walls = np.zeros((1, anchor.shape[1])), self.rollout.feasibility
        if walls is not None:
            for before, after in pairwise(queued):
                old += walls.log_g(before, after)
        if (others := self.pilots - 1) > 0:
            _, drawn = self.rollout.futures(anchor, belief.drawn[shared:], others, rng)
            old = np.vstack([drawn, old])
        path, log_new = self.rollout.one(anchor, actions[shared:held], self.pilots, rng)
        log_old = log_mean(old)
        # Where β = inf and every old future collides, the weight is zero already, or the charge
        # was dropped by a weight collapse: either way there is nothing to undo.
        log_factor = log_new - np.where(np.isneginf(log_old), 0.0, log_old)
        redrawn = belief.cut(shared)
        for ahead, states in enumerate(path, start=shared + 1):
            redrawn = redrawn.appended(states, actions[:ahead])
        redrawn = redrawn.reweighted(log_factor)
        return redrawn._replace(events=redrawn.events.plus(replanned_steps=1))


def _choose(log_weights: Floats, rng: np.random.Generator) -> Indices:
    """Draw one of K futures of each particle by their log-weights (K, n); the first if all are 0.

    Return where they are among K n, (n,).
    """
    copies, n = log_weights.shape
    top = log_weights.max(axis=0)
    cumulative = np.cumsum(arrays.exp(log_weights - np.where(np.isfinite(top), top, 0.0)), axis=0)
    chosen = (cumulative <= rng.random(n) * cumulative[-1]).sum(axis=0)
    chosen = np.where(cumulative[-1] > 0, np.minimum(chosen, copies - 1), 0)
    return np.asarray(chosen * n + np.arange(n))


@dataclass(frozen=True, eq=False)
class DrawnFuture:
    """``Rollout.one`` from the present of each particle, drawn when it is first asked for."""

    rollout: Rollout
    present: States  # x_t, (d, n)
    actions: Actions  # of the plan, (F, k)
    copies: int
    rng: np.random.Generator

    def __call__(self, ahead: int) -> States | None:
        """Return x_{t+ahead}, (d, n), ahead ≥ 1; None beyond the plan."""
        return self.drawn[0][ahead - 1].copy() if ahead <= len(self.actions) else None

    @cached_property
    def drawn(self) -> tuple[list[States], LogWeights]:
        """The states after each step, and the log of the mean of Π g, (n,)."""
        return self.rollout.one(self.present, self.actions, self.copies, self.rng)


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
    """

    rollout: Rollout
    steps: int  # F, how far to look
    copies: int  # M, roll-outs of each particle
    weighs: bool = False
    evidence: Lookahead | None = None  # takes in the plan as evidence of the present first

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
        return belief.foreseeing(future.drawn[1]) if self.weighs else belief


@dataclass(frozen=True, kw_only=True)
class PlanEvidence:
    """w ← w p(π_t | x_t, m)^λ, at every step and at the start: the ``Lookahead`` of ``mcl-plan``.

    γ_t gets the factors Π_{0 ≤ s ≤ t} p(π_s | x_s, m), which stay in the filter's own weights: they
    are about the present. A long plan is feasible only from a precise heading and would leave few
    particles of a coarse cloud: λ is the largest in [0, 1] that leaves ``keep`` of the effective
    sample size. γ_t is the target only at ``keep`` = 0.
    """

    sensor: PlanSensor
    steps: int | None = None  # L, how many planned steps are read; None: all
    keep: float = 0.0  # κ in [0, 1]
    # whether a planned step is charged only when it comes into view, and a plan that continues the
    # last one adds nothing; else all steps of every plan: its author has looked at the robot again
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
            return belief._replace(plan_reading=PlanReading(plan, plan[:first]))
        collisions = self.sensor.collisions(belief.present, seen, first)
        power, feasible, log_evidence = tempering(
            belief.weights, collisions, self.sensor.beta, self.keep
        )
        beta = power * self.sensor.beta if power > 0.0 else 0.0  # also if it is infinite
        read = belief.reweighted(charges(beta, collisions))
        if feasible == 0.0:
            read = read._replace(events=read.events.plus(infeasible_plans=1))
        reading = PlanReading(plan, seen, power, feasible, log_evidence)
        return read._replace(plan_reading=reading)


@compiled
def tempering(
    weights: Floats, collisions: Ints, beta: float, keep: float
) -> tuple[float, float, float]:
    """Return λ, the largest of 0 … 1 at which exp(-λ β C) leaves ``keep`` of the sample size.

    By bisection, to 2⁻⁴⁰, never less. At β = inf λ is 1, or 0 as a limit. Also returned are the
    weight where C is 0, and log Σ w exp(-λ β C); weights have the sum 1.
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
