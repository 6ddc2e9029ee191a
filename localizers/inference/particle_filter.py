"""The particle filter of the whole family; its methods differ only in parts."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from deqmcl_gym.validation import InputError
from localizers.api import Motion
from localizers.inference.belief import FilteredEvents, ParticleBelief
from localizers.inference.futures import Lookahead, Redraw, Rollout
from localizers.inference.loss_detector import LossDetector
from localizers.inference.particles import (
    Action,
    Actions,
    BeamFilter,
    Feasibility,
    Initial,
    normalized_with_log_sum,
)
from localizers.inference.resampling import Resampling, power_that_keeps
from localizers.inference.start import InformedStart, Injection, initial_cloud
from localizers.models.scan import Scan, ScanModel

MAX_PARTICLES = 10_000_000
_BYTES_PER_PARTICLE = 3 * 4 + 8  # one queued pose and its link


@dataclass(frozen=True, kw_only=True)
class ParticleFilter:
    """γ_t = p(x_0) Π_{s ≤ t+F_t} p(x_s | x_{s-1}, u_s) g(x_{s-1}, x_s) · Π_{s ≤ t} p(o_s | x_s, m).

    F_t = min(F, T - t) states are queued after the present, at most L before it. u_s is the action
    carried out for s ≤ t, the planned one after.

    Attributes:
        particles: n.
        feasibility: g; None: g = 1, no step is charged.
        past: L, how many states before the present are kept, and thereby smoothed.
        future: F, how many planned steps are looked ahead.
        pilots: rollouts per particle when the plan changes; see ``Redraw``.
        lookahead: what the plan says about the present, where the future is not queued; None: the
            plan is not looked at.
        start: chooses the first particles among draws from the prior; None: all are taken.
        beams: chooses the beams of a scan that are used; None: all are.
        keep: κ in [0, 1], the least share of the effective sample size that a scan leaves: its
            likelihood gets an exponent, see ``power_that_keeps``; 0: Bayes' rule.
        injection: mixes random poses into the belief, needs ``future`` = 0; None: none.
        detector: evidence for and against its beliefs at t = 0; None: none is kept.
        predictive: how many particles, evenly spaced, tell how well a scan was predicted.
        dtype: of the states.
    """

    motion: Motion
    scan: ScanModel
    resampling: Resampling
    particles: int
    feasibility: Feasibility | None = None
    past: int = 0
    future: int = 0
    pilots: int = 16
    lookahead: Lookahead | None = None
    start: InformedStart | None = None
    beams: BeamFilter | None = None
    keep: float = 0.0
    injection: Injection | None = None
    detector: LossDetector | None = None
    predictive: int = 256
    dtype: Any = np.float32

    def __post_init__(self) -> None:
        if self.particles > MAX_PARTICLES:
            slots = self.past + 1 + self.future
            gibibytes = self.particles * slots * _BYTES_PER_PARTICLE / 2**30
            raise InputError(
                f"particles is {self.particles:,}, which would take {gibibytes:,.0f} GiB; "
                f"allowed values: 1 to {MAX_PARTICLES:,}."
            )
        if self.start is not None and self.particles * self.start.draws > MAX_PARTICLES:
            raise InputError(
                f"start_draws is {self.start.draws:,} for each of {self.particles:,} particles, "
                f"but at most {MAX_PARTICLES:,} draws are allowed in total: give fewer."
            )

    def initial(self, prior: Initial, plan: Actions, rng: np.random.Generator) -> ParticleBelief:
        """Return the belief at t = 0: draws from the prior, their future rolled out by the plan.

        x_0 has no scan and no charge. The prior is sampled from a separate random stream, so every
        filter given the same ``rng`` starts from the same cloud.
        """
        stream = rng.spawn(1)[0]
        draws = self.particles * (1 if self.start is None else self.start.draws)
        belief = initial_cloud(prior, draws, self.dtype, plan, stream)
        if self.beams is not None:
            belief = belief._replace(events=FilteredEvents())
        belief = belief._replace(detector=self.detector)
        if self.start is not None:
            belief = self.start(belief, plan, stream)
        if self.injection is not None:
            belief = self.injection.begun(belief, plan)
        window = plan[: self.future]
        for ahead in range(len(window)):
            belief = self._resampled(belief, rng)
            belief = self._extended(belief, window[: ahead + 1], rng)
        return belief if self.lookahead is None else self.lookahead(belief, plan, rng)

    def step(
        self,
        belief: ParticleBelief,
        scan: Scan,
        action: Action,
        plan: Actions,
        rng: np.random.Generator,
    ) -> ParticleBelief:
        """Return the belief after one action (k,) and one scan, which may be kept.

        The ``plan`` are the actions after it, (h, k); it may be shorter than F, down to (0, k).
        """
        # Resample whole queues
        belief = self._resampled(belief, rng)
        # Advance: the queue holds the steps t … t + F_t, under the actions that now lead there
        actions = np.concatenate((action[None], plan[: self.future]))
        if self.future > 0:
            belief = self._redraw(belief, actions, rng)
        for ahead in range(belief.queue.ahead, len(actions)):
            belief = self._extended(belief, actions[: ahead + 1], rng)
        belief = belief.stepped(self.past)
        if self.injection is not None:
            belief = self.injection(belief, plan, rng)
        # Reweight by the scan, and by what the plan says of the present
        if self.beams is not None:
            kept = self.beams.kept(belief.present, belief.log_weights, scan)
            events = belief.events.plus(dropped_beams=scan.beams - kept.beams)
            belief, scan = belief._replace(events=events), kept
        log_likelihood, power = self.scan.log_likelihood(belief.present, scan), 1.0
        if self.keep > 0.0:
            power = power_that_keeps(belief.log_weights, log_likelihood, self.keep)
        belief = belief.scanned(scan, log_likelihood, self.predictive, power)
        if self.lookahead is not None:
            return self.lookahead(belief, plan, rng)
        return belief if self.start is None else belief._replace(plan_reading=None)  # of its plan

    def _resampled(self, belief: ParticleBelief, rng: np.random.Generator) -> ParticleBelief:
        """Resample whole queues if it is time to."""
        weights, log_sum = normalized_with_log_sum(belief.log_weights)  # w without h_t
        ancestors = self.resampling.ancestors(weights, rng)
        return belief if ancestors is None else belief.resampled(ancestors, log_sum)

    def _extended(
        self, belief: ParticleBelief, actions: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Append head' ~ p(· | head, u), charged once by g(head, head'), u the last of actions."""
        before = belief.head
        after = self.motion.sample(before, actions[-1], rng)
        if self.feasibility is not None:
            belief = belief.reweighted(self.feasibility.log_g(before, after))
        return belief.appended(after, actions)

    @cached_property
    def rollout(self) -> Rollout:
        """Draws futures by this filter's motion and charges them by its feasibility."""
        return Rollout(self.motion, self.feasibility)

    @cached_property
    def _redraw(self) -> Redraw:
        return Redraw(self.rollout, self.pilots)
