"""Futures drawn from given states by planned actions, charged for collisions.

Queued ones are drawn again when the actions that they were drawn with have changed; others are
drawn anew from the present after each scan.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Floats, Indices
from localizers.api import Motion
from localizers.inference.belief import ParticleBelief
from localizers.inference.parts import Actions, Feasibility, LogWeights, Paths, States, Walk


@dataclass(frozen=True)
class Rollout:
    """x'_s ~ p(· | x'_{s-1}, u_s) step by step, with Σ log g(x'_{s-1}, x'_s).

    Without a feasibility g = 1. One that can process all steps of a motion in one pass has a method
    ``walk(motion)``, which returns a ``Walk``, or None for a motion it does not support.
    """

    motion: Motion
    feasibility: Feasibility | None = None

    def futures(
        self, anchor: States, actions: Actions, copies: int, rng: np.random.Generator
    ) -> tuple[Paths, Floats]:
        """Draw ``copies`` = K futures from each state of ``anchor``, (d, n).

        Returns:
            The states of each step, (d, n), given which future of each is asked for, (n,) below K;
            and log Π g of each future, (K, n).
        """
        n = anchor.shape[1]
        paths, log_g = self._walk(np.tile(anchor, (1, copies)), actions, rng, keep=True)
        return lambda chosen: paths(chosen * n + np.arange(n)), log_g.reshape(copies, n)

    def log_g(
        self, anchor: States, actions: Actions, copies: int, rng: np.random.Generator
    ) -> Floats:
        """Log Π g of the same futures, (K, n), without their states."""
        _, log_g = self._walk(np.tile(anchor, (1, copies)), actions, rng, keep=False)
        return log_g.reshape(copies, anchor.shape[1])

    def queued_log_g(self, belief: ParticleBelief, shared: int = 0) -> LogWeights:
        """Log Π g of each particle's own future from ``shared`` steps ahead on, (n,)."""
        path = belief.queue.since(shared)
        n = path[0].shape[1]
        total = np.zeros(n)
        if self.feasibility is None or len(path) == 1:
            return total
        states = np.concatenate(path, axis=1)
        for log_g in self.feasibility.log_g(states[:, :-n], states[:, n:]).reshape(-1, n):
            total += log_g  # one by one, as they are charged
        return total

    @cached_property
    def _walk(self) -> Walk:
        offer = getattr(self.feasibility, "walk", None)
        walk: Walk | None = offer(self.motion) if offer is not None else None
        return StepByStep(self.motion, self.feasibility) if walk is None else walk


@dataclass(frozen=True)
class StepByStep:
    """The ``Walk`` of any motion and any feasibility."""

    motion: Motion
    feasibility: Feasibility | None = None

    def __call__(
        self, states: States, actions: Actions, rng: np.random.Generator, *, keep: bool
    ) -> tuple[Paths, LogWeights]:
        """Draw and charge one step after the other."""
        log_g = np.zeros(states.shape[1])
        path = []
        for action in actions:
            before, states = states, self.motion.sample(states, action, rng)
            if self.feasibility is not None:
                log_g += self.feasibility.log_g(before, states)
            if keep:
                path.append(states)
        return lambda columns: [states[:, columns] for states in path], log_g


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
    Properly weighted for every M ≥ 1 (random weights by pilots: Lin, Chen & Liu 2013).

    Attributes:
        pilots: M.
    """

    rollout: Rollout
    pilots: int = 16

    def __call__(
        self, belief: ParticleBelief, actions: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return a belief whose future is drawn with ``actions``, (steps, k).

        A future that merely ends earlier than ``actions`` is left alone; it is extended later.
        """
        held = belief.queue.ahead
        shared = agreeing(belief.drawn, actions) if held else 0
        if shared == held:
            return belief
        anchor = belief.queue.at(shared)
        assert anchor is not None, "the shared steps are held"
        old = self.rollout.queued_log_g(belief, shared)[None]
        if (others := self.pilots - 1) > 0:
            drawn = self.rollout.log_g(anchor, belief.drawn[shared:], others, rng)
            old = np.vstack([drawn, old])
        paths, new = self.rollout.futures(anchor, actions[shared:held], self.pilots, rng)
        log_old = log_mean(old)
        # Where β = inf and every old future collides, the weight is zero already, or the charge
        # was dropped by a weight collapse: either way there is nothing to undo.
        log_factor = log_mean(new) - np.where(np.isneginf(log_old), 0.0, log_old)
        kept = _choose(new, rng)
        redrawn = belief.cut(shared)
        for ahead, states in enumerate(paths(kept), start=shared + 1):
            redrawn = redrawn.appended(states, actions[:ahead])
        redrawn = redrawn.reweighted(log_factor)
        return redrawn._replace(events=redrawn.events.plus(replanned_steps=1))


def _choose(log_weights: Floats, rng: np.random.Generator) -> Indices:
    """One row per column, drawn with probability ∝ exp(log_weights); the first if all are -inf."""
    top = log_weights.max(axis=0)
    cumulative = np.cumsum(arrays.exp(log_weights - np.where(np.isfinite(top), top, 0.0)), axis=0)
    pointers = rng.random(log_weights.shape[1]) * cumulative[-1]
    chosen: Indices = (cumulative <= pointers).sum(axis=0)
    return np.where(cumulative[-1] > 0, np.minimum(chosen, len(log_weights) - 1), 0)


@dataclass(frozen=True, eq=False)
class DrawnFuture:
    """The states x_{t+1} … x_{t+F} of each particle, rolled out from its present by the plan.

    Of ``copies`` = M roll-outs of each particle one is kept with probability ∝ Π g: a draw from
    p(x_{t+1:t+F} | x_t, plan) Π g(x_{s-1}, x_s) as M grows. Drawn when it is first asked for.

    Attributes:
        present: x_t, (d, n).
        actions: of the plan, (F, k).
        rng: a stream of its own.
    """

    rollout: Rollout
    present: States
    actions: Actions
    copies: int
    rng: np.random.Generator

    @property
    def log_h(self) -> LogWeights:
        """Log of the mean of Π g over the roll-outs, unbiased for h_t(x_t) before the log, (n,)."""
        return self._drawn[1]

    def __call__(self, ahead: int) -> States | None:
        """Return x_{t+ahead}, (d, n), ahead ≥ 1; None beyond the plan."""
        return self._drawn[0][ahead - 1].copy() if ahead <= len(self.actions) else None

    @cached_property
    def _drawn(self) -> tuple[list[States], LogWeights]:
        paths, log_g = self.rollout.futures(self.present, self.actions, self.copies, self.rng)
        return paths(_choose(log_g, self.rng)), log_mean(log_g)
