"""The particle filter of the whole family, as a localizer; its methods differ only in parts."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError
from localizers.api import Prior, RobotModel, checked_plan, checked_rng, checked_step, require_reset
from localizers.inference.belief import Events, ParticleBelief
from localizers.inference.futures import Move, Redraw, Rollout, Stay, Unconstrained
from localizers.inference.parts import (
    Action,
    Actions,
    Feasibility,
    Initial,
    Motion,
    Resampling,
    Scan,
)
from localizers.inference.plan_evidence import Lookahead, Myopic
from localizers.inference.resampling import Selection, Tempering, Untempered, by_own_weight
from localizers.inference.start import FromPrior, Injection, Nothing, Start, drawn
from localizers.inference.trust import Trust
from localizers.inference.weight_kernels import normalized_with_log_sum
from localizers.models.prior import GaussianPrior


class Counted(Protocol):
    """A named tuple with a field ``events``."""

    @property
    def events(self) -> Events:
        """Counts of irregular events since reset."""
        ...

    def _replace(self, *, events: Any) -> Any: ...


B = TypeVar("B", bound=Counted)


class Filter(Protocol[B]):
    """The two steps of a recursive Bayes filter. It is stateless: the belief is the state."""

    def initial(self, prior: Prior, plan: Floats, rng: np.random.Generator) -> B:
        """Return the belief at t = 0."""
        ...

    def step(
        self, belief: B, ranges: Floats, action: Floats, plan: Floats, rng: np.random.Generator
    ) -> B:
        """Return the belief after one action and one scan."""
        ...


class FilterLocalizer(Generic[B]):
    """A ``Localizer`` that runs a filter, checks its input and counts bad beams."""

    def __init__(self, robot: RobotModel, bayes_filter: Filter[B]) -> None:
        """Make a localizer for ``robot`` from a filter made for it."""
        self.robot = robot
        self.filter = bayes_filter
        self._running: tuple[B, np.random.Generator] | None = None

    def reset(self, prior: Prior, plan: ArrayLike, rng: np.random.Generator) -> B:
        """Start a new run; see ``Localizer.reset``."""
        if isinstance(prior, GaussianPrior):
            prior.check_unit(self.robot.floor_plan.unit)
        belief = self.filter.initial(prior, checked_plan(plan), checked_rng(rng))
        self._running = (belief, rng)
        return belief

    def update(self, ranges: ArrayLike, action: ArrayLike, plan: ArrayLike) -> B:
        """Advance one step; see ``Localizer.update``."""
        belief, rng = require_reset(self._running)
        scan, command, ahead, usable = checked_step(ranges, action, plan, self.robot.lidar)
        belief = self.filter.step(belief, scan, command, ahead, rng)
        if usable < scan.size:
            belief = belief._replace(events=belief.events.of_scan(scan.size, usable))
        self._running = (belief, rng)
        return belief


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
        move: renews queued states after resampling, leaving γ_t invariant.
        lookahead: what the plan says about the present, where the future is not queued.
        selection: the weights to resample by.
        start: how the first particles are chosen among draws from the prior.
        tempering: sets the exponent of a scan's likelihood.
        injection: mixes random poses into the belief; needs ``future`` = 0.
        trust: evidence for and against its beliefs at t = 0; None: none is kept.
        dtype: of the states.
    """

    motion: Motion
    scan: Scan
    resampling: Resampling
    particles: int
    feasibility: Feasibility | None = None
    past: int = 0
    future: int = 0
    pilots: int = 16
    move: Move = field(default_factory=Stay)
    lookahead: Lookahead = field(default_factory=Myopic)
    selection: Selection = by_own_weight
    start: Start = field(default_factory=FromPrior)
    tempering: Tempering = field(default_factory=Untempered)
    injection: Injection = field(default_factory=Nothing)
    trust: Trust | None = None
    dtype: Any = np.float32

    def __post_init__(self) -> None:
        if self.particles > MAX_PARTICLES:
            slots = self.past + 1 + self.future
            gibibytes = self.particles * slots * _BYTES_PER_PARTICLE / 2**30
            raise InputError(
                f"particles is {self.particles:,}, which would take {gibibytes:,.0f} GiB; "
                f"allowed values: 1 to {MAX_PARTICLES:,}."
            )
        if self.particles * self.start.draws > MAX_PARTICLES:
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
        belief = drawn(prior, self.start.draws * self.particles, self.dtype, plan, stream)
        belief = self.start(belief._replace(trust=self.trust), plan, stream)
        window = plan[: self.future]
        for ahead in range(len(window)):
            belief = self._resampled(belief, rng)
            belief = self._extended(belief, window[: ahead + 1], rng)
        return self.lookahead(self.injection.noted(belief, plan), plan, rng)

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
            ranges: the scan o_t, (B,); a belief that keeps trust keeps it too.
            action: carried out between t - 1 and t, (k,).
            plan: the actions after it, (h, k); may be shorter than F, down to (0, k).
            rng: the only source of randomness.
        """
        # Resample, and move
        belief = self._resampled(belief, rng)
        # Advance: the queue holds the steps t … t + F_t, under the actions that now lead there
        actions = np.concatenate((action[None], plan[: self.future]))
        belief = self._redraw(belief, actions, rng)
        for ahead in range(belief.queue.ahead, len(actions)):
            belief = self._extended(belief, actions[: ahead + 1], rng)
        belief = self.injection(belief.stepped(self.past), plan, rng)
        # Reweight
        log_likelihood = self.scan.log_likelihood(belief.present, ranges)
        power = self.tempering(belief.log_weights, log_likelihood)
        belief = belief.scanned(ranges, log_likelihood, power=power)
        return self.lookahead(self.injection.noted(belief, plan, ranges), plan, rng)

    def _resampled(self, belief: ParticleBelief, rng: np.random.Generator) -> ParticleBelief:
        """Resample whole queues if it is time to, then move them."""
        log_weights = self.selection(belief)
        weights, log_sum = normalized_with_log_sum(log_weights)
        ancestors = self.resampling.ancestors(weights, rng)
        if ancestors is not None:
            belief = belief.resampled(ancestors, log_weights, log_sum)
        return self.move(belief, ancestors, rng)

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
        return Rollout(self.motion, self.feasibility or Unconstrained())

    @cached_property
    def _redraw(self) -> Redraw:
        return Redraw(self.rollout, self.pilots)
