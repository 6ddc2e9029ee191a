"""The particle filter of the whole family, how it starts, and poses from anywhere for the lost."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from deqmcl_gym.validation import InputError, integer
from localizers.api import Motion, Prior
from localizers.inference.belief import FilteredEvents, ParticleBelief, Queue
from localizers.inference.futures import Lookahead, PlanEvidence, Redraw, Rollout, agreeing
from localizers.inference.loss_detector import LossDetector, Recovery, Watch
from localizers.inference.particles import (
    Action,
    Actions,
    BeamFilter,
    Resampling,
    normalized_with_log_sum,
    pointed_at,
    power_that_keeps,
)
from localizers.models.feasibility import CostMap
from localizers.models.scan import Scan, ScanModel

MAX_PARTICLES = 10_000_000


def initial_cloud(
    prior: Prior, count: int, dtype: Any, plan: Actions, rng: np.random.Generator
) -> ParticleBelief:
    """Return draws from a prior as a belief without a queued future."""
    states = np.ascontiguousarray(prior.sample(count, rng).T, dtype=dtype)
    return ParticleBelief(Queue((states,)), np.zeros(count), drawn=plan[:0])


@dataclass(frozen=True, kw_only=True)
class InformedStart:
    """Of K n draws from the prior, n chosen systematically by the feasibility of the first plan.

    Importance sampling of p(x_0) p(π_0 | x_0), exact at ``jitter`` = 0; a jitter separates draws
    that were chosen more than once. The evidence of the filter itself then leaves π_0 out.
    """

    evidence: PlanEvidence  # p(π_0 | x_0, m), of as much of the plan as it reads
    draws: int  # K
    # deviation in x and y, in the map's unit; that of θ (rad) moves the plan's end by as much
    jitter: float = 0.0

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the chosen particles, equally weighted."""
        read = self.evidence(belief, plan, rng)
        n = read.log_weights.size // self.draws
        weights, log_sum = normalized_with_log_sum(read.log_weights)
        chosen = pointed_at(weights, (np.arange(n) + rng.random()) / n)
        states = read.present.take(chosen, axis=1)
        if self.jitter > 0:
            length = float(np.sqrt(plan[:, 0] ** 2 + plan[:, 1] ** 2).sum())
            sd = np.array([self.jitter, self.jitter, self.jitter / length if length > 0 else 0.0])
            noise = sd[:, None] * rng.standard_normal(states.shape)
            states = states + noise.astype(states.dtype)
        return read.resampled(chosen, log_sum)._replace(queue=Queue((states,)))


@dataclass(frozen=True, kw_only=True)
class Injection:
    """bel ← (1 - s) bel + s p_anywhere before each scan, s = max(0, 1 - w_fast / w_slow).

    Thrun et al. 2005, table 8.3. w_slow and w_fast are averages of how likely scans are at the
    belief before them, see ``Recovery``. Each particle is exchanged with probability s for a pose
    of the cloud's mean weight; of its past it keeps what it had.

    Whoever plans a new route for a robot that is lost knows where it is. A route is new that does
    not go on as the one before, and stays so for the 1 / α_fast steps in which w_fast forgets. Then
    the poses are chosen by it as the first particles are, by ``start``; None: plans do not count.
    """

    recovery: Recovery
    poses: Prior
    start: InformedStart | None = None

    def begun(self, belief: ParticleBelief, plan: Actions) -> ParticleBelief:
        """Return the first belief, which remembers its plan."""
        return belief._replace(watch=Watch(self.recovery, plan))

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief, in part from anywhere; draws from a stream of its own."""
        last = belief.watch
        assert last is not None, "begun at the start"
        news = max(0, last.news - 1)
        if is_new(last.plan, plan):
            news = math.ceil(1 / self.recovery.alpha_fast)
        belief, share = belief._replace(watch=Watch(last.recovery, plan, news)), last.recovery.share
        if share == 0.0:
            return belief
        stream = rng.spawn(1)[0]
        chosen = np.flatnonzero(stream.random(belief.log_weights.size) < share)
        if chosen.size == 0:
            return belief
        start = self.start if news > 0 else None
        draws = chosen.size * (1 if start is None else start.draws)
        others = initial_cloud(self.poses, draws, belief.present.dtype, plan, stream)
        if start is not None:
            others = start(others, plan, stream)
        events = belief.events.plus(random_poses=chosen.size)
        return belief.exchanged(chosen, [others.present])._replace(events=events)


def is_new(last: Actions, plan: Actions) -> bool:
    """Whether a plan is not the last one without its first action, but longer or shorter."""
    if len(last) <= 1:
        return len(plan) > 1
    return agreeing(last[1:], plan) < min(len(last) - 1, len(plan))


@dataclass(frozen=True, kw_only=True)
class ParticleFilter:
    """γ_t = p(x_0) Π_{s ≤ t+F_t} p(x_s | x_{s-1}, u_s) g(x_{s-1}, x_s) · Π_{s ≤ t} p(o_s | x_s, m).

    F_t = min(F, T - t) states are queued after the present, at most L before it. u_s is the action
    carried out for s ≤ t, the planned one after.
    """

    motion: Motion
    scan: ScanModel
    resampling: Resampling
    particles: int  # n
    feasibility: CostMap | None = None  # g; None: g = 1, no step is charged
    past: int = 0  # L, how many states before the present are kept, and thereby smoothed
    future: int = 0  # F, how many planned steps are looked ahead
    pilots: int = 16  # rollouts per particle when the plan changes; see ``Redraw``
    # what the plan says about the present where the future is not queued; None: it is not read
    lookahead: Lookahead | None = None
    start: InformedStart | None = None  # chooses the first particles among draws; None: all
    beams: BeamFilter | None = None  # chooses the beams of a scan that are used; None: all are
    # κ in [0, 1], the least share of the effective sample size that a scan leaves: its likelihood
    # gets an exponent, see ``power_that_keeps``; 0: Bayes' rule
    keep: float = 0.0
    injection: Injection | None = None  # mixes in random poses; needs ``future`` = 0
    # evidence for and against its beliefs at t = 0; None: none is kept
    detector: LossDetector | None = None
    predictive: int = 256  # how many particles, evenly spaced, tell how well a scan was predicted
    dtype: Any = np.float32  # of the states

    def __post_init__(self) -> None:
        integer("particles", self.particles, low=1, high=MAX_PARTICLES)
        if self.start is not None and self.particles * self.start.draws > MAX_PARTICLES:
            raise InputError(
                f"start_draws is {self.start.draws:,} for each of {self.particles:,} particles, "
                f"but at most {MAX_PARTICLES:,} draws are allowed in total: give fewer."
            )

    def initial(self, prior: Prior, plan: Actions, rng: np.random.Generator) -> ParticleBelief:
        """Return the belief at t = 0: draws from the prior, their future rolled out by the plan.

        x_0 has no scan and no charge. The prior has a random stream of its own, so that all filters
        given the same ``rng`` start from the same cloud.
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
        """Return the belief after an action (k,) and a scan; the plan after it is (h, k), h ≥ 0."""
        # Resample whole queues
        belief = self._resampled(belief, rng)
        # Advance: the queue holds the steps t … t + F_t, under the actions that now lead there
        actions = np.concatenate((action[None], plan[: self.future]))
        if self.future > 0:
            belief = Redraw(self.rollout, self.pilots)(belief, actions, rng)
        for ahead in range(belief.queue.ahead, len(actions)):
            belief = self._extended(belief, actions[: ahead + 1], rng)
        belief = belief.stepped(self.past)
        if self.injection is not None:
            belief = self.injection(belief, plan, rng)
        # Reweight by the scan, and by what the plan says of the present
        if self.beams is not None:
            used = self.beams.kept(belief.present, belief.log_weights, scan)
            events = belief.events.plus(dropped_beams=scan.beams - used.beams)
            belief, scan = belief._replace(events=events), used
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

    @property
    def rollout(self) -> Rollout:
        """Draws futures by this filter's motion and charges them by its feasibility."""
        return Rollout(self.motion, self.feasibility)
