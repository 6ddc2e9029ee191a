"""One particle filter for the whole family; its members differ by one part each."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from deqmcl_gym.numerics.types import Floats
from localizers.inference.belief import ParticleBelief
from localizers.inference.lookahead import Lookahead, Myopic
from localizers.inference.moves import Move, Stay
from localizers.inference.parts import (
    Action,
    Actions,
    Feasibility,
    Initial,
    Motion,
    Resampling,
    Scan,
    States,
)
from localizers.inference.queue import Queue
from localizers.inference.replanning import Redraw
from localizers.inference.resampling import Selection, by_own_weight
from localizers.inference.rollout import Rollout
from localizers.inference.weights import normalized_with_log_sum


@dataclass(frozen=True, kw_only=True)
class ParticleFilter:
    """γ_t = p(x_0) Π_{s ≤ t+F_t} p(x_s | x_{s-1}, u_s) g(x_{s-1}, x_s) · Π_{s ≤ t} p(o_s | x_s, m).

    F_t = min(F, T - t) states are queued after the present, at most L before it. u_s is the action
    carried out for s ≤ t, the planned one after.

    Attributes:
        particles: n.
        past: L, how many states before the present are kept (and so smoothed).
        future: F, how many planned steps are looked ahead.
        pilots: rollouts per particle when the plan changes; see ``Redraw``.
        move: renews queued states after resampling, leaving γ_t invariant.
        lookahead: weights what is reported by h_t(x_t), where the future is not queued.
        selection: the weights to resample by.
    """

    motion: Motion
    scan: Scan
    feasibility: Feasibility
    resampling: Resampling
    particles: int
    past: int = 0
    future: int = 0
    pilots: int = 16
    move: Move = field(default_factory=Stay)
    lookahead: Lookahead = field(default_factory=Myopic)
    selection: Selection = by_own_weight

    def initial(self, prior: Initial, plan: Actions, rng: np.random.Generator) -> ParticleBelief:
        """Return the belief at t = 0: draws from the prior, their future rolled out by the plan.

        x_0 has no scan and no charge. The prior's draws come from a stream of their own, so every
        filter given the same ``rng`` starts from the same cloud.
        """
        cloud = prior.states(self.particles, rng.spawn(1)[0])
        none_drawn = np.empty((0, plan.shape[1]))
        belief = ParticleBelief(Queue((cloud,)), np.zeros(self.particles), none_drawn)
        for action in plan[: self.future]:
            belief = self._appended(self._resampled(belief, rng), action, rng)
        return self.lookahead(belief, plan, rng)

    def step(
        self,
        belief: ParticleBelief,
        ranges: Floats,
        action: Action,
        plan: Actions,
        rng: np.random.Generator,
    ) -> ParticleBelief:
        """Return the belief after one action and one scan.

        Args:
            belief: of the step before.
            ranges: the scan o_t, (B,) px; a belief that keeps trust keeps it too.
            action: carried out between t - 1 and t, (k,).
            plan: the actions after it, (h, k); may be shorter than F, down to (0, k).
            rng: the only source of randomness.
        """
        belief = self._resampled(belief, rng)
        if self.future or belief.queue.ahead:
            actions = np.concatenate((action[None], plan[: self.future]))  # of the steps t … t + F
            if belief.queue.ahead:
                belief = self._redraw(belief, actions, rng)
            for newest in actions[belief.queue.ahead :]:  # one, unless the plan ends or has grown
                belief = self._appended(belief, newest, rng)
            belief = belief.stepped(self.past)
        else:
            belief, states = self._driven(belief, action, rng)
            belief = belief.advanced(states, self.past)
        belief = belief.scanned(ranges, self.scan.log_likelihood(belief.present, ranges))
        return self.lookahead(belief, plan, rng)

    def _resampled(self, belief: ParticleBelief, rng: np.random.Generator) -> ParticleBelief:
        """Resample whole queues, and move them."""
        by = self.selection(belief)
        weights, log_sum = normalized_with_log_sum(by)
        ancestors = self.resampling.ancestors(weights, rng)
        return self.move(belief.resampled(ancestors, by, log_sum), ancestors, rng)

    def _appended(
        self, belief: ParticleBelief, action: Action, rng: np.random.Generator
    ) -> ParticleBelief:
        """Append head' ~ p(· | head, action), charged once by g(head, head')."""
        belief, states = self._driven(belief, action, rng)
        return belief.appended(states, action)

    def _driven(
        self, belief: ParticleBelief, action: Action, rng: np.random.Generator
    ) -> tuple[ParticleBelief, States]:
        """Return head' ~ p(· | head, action), and the belief charged once by g(head, head')."""
        before = belief.head
        after = self.motion.sample(before, action, rng)
        if self._charged:
            belief = belief.reweighted(self.feasibility.log_g(before, after))
        return belief, after

    @cached_property
    def _charged(self) -> bool:
        """Whether any step can be infeasible; ``charges = False`` of its own class says no."""
        inherited = "charges" not in vars(type(self.feasibility))
        return inherited or bool(getattr(self.feasibility, "charges", True))

    @cached_property
    def rollout(self) -> Rollout:
        """Draws futures by this filter's motion and charges them by its feasibility."""
        return Rollout(self.motion, self.feasibility)

    @cached_property
    def _redraw(self) -> Redraw:
        return Redraw(self.rollout, self.pilots)
