"""A filter that follows advice of unknown quality, and one that does not: which predicts the scans?

Two filters run on the same commands and scans. The *advised* one, A, is shown the plans; the
*protected* one, B, never sees any. Only scans judge: A's cloud has moved to where its plans are
feasible, so they cannot testify for themselves. Fixed share, Herbster & Warmuth 1998.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from deqmcl_gym.numerics import Floats, arrays
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import exp64, log64
from deqmcl_gym.validation import InputError, boolean, number
from localizers.api import Belief, Localizer, Points, Prior, quality_of
from localizers.inference import Filter, FilterLocalizer
from localizers.inference.belief import Events, ParticleBelief, PlanReading
from localizers.inference.futures import Foresight
from localizers.inference.particle_filter import ParticleFilter
from localizers.inference.particles import Action, Actions, States, pointed_at
from localizers.models import RobotModel
from localizers.models.scan import Scan


class HedgedBelief(NamedTuple):
    """q A + (1 - q) B, as two weighted clouds."""

    advised: Belief
    protected: Belief
    log_odds: float  # log q / (1 - q)
    scan_log_evidence: float = float("nan")  # log p_t of the latest scan; NaN before it
    events: Events = Events()

    @property
    def trusted(self) -> float:
        """q, the probability that A's picture is right."""
        return probability_of(self.log_odds)

    def points(self, offset: int = 0) -> Points | None:
        """Return the poses of both, by q and 1 - q; None for an offset that one does not hold."""
        trusted = self.trusted
        if trusted in (0.0, 1.0):
            return (self.advised if trusted else self.protected).points(offset)
        advised, protected = self.advised.points(offset), self.protected.points(offset)
        if advised is None or protected is None:
            return None
        poses = np.concatenate([advised[0], protected[0]])
        shares = trusted * advised[1], (1.0 - trusted) * protected[1]
        return poses, np.concatenate(shares)

    @property
    def quality(self) -> float | None:
        """P(not lost | o_{1:t}), in [0, 1]; None if a member has none."""
        advised, protected = quality_of(self.advised), quality_of(self.protected)
        if advised is None or protected is None:
            return None
        return self.trusted * advised + (1.0 - self.trusted) * protected

    @property
    def plan_reading(self) -> PlanReading | None:
        """What the latest plan said to A."""
        return getattr(self.advised, "plan_reading", None)


@dataclass(frozen=True, kw_only=True)
class Hedge:
    """q A + (1 - q) B over a filter A that may be misled and a filter B that cannot.

    With a_t, b_t = Σ w p(o_t | x_t, m) under A and B before the scan and q_t = P(A is right):

        q_t⁻ = (1 - s) q_{t-1} + s (1 - q_{t-1});  A ← (1 - f) A + f B,  f = s (1 - q_{t-1}) / q_t⁻
        q_t = q_t⁻ a_t / p_t,  p_t = q_t⁻ a_t + (1 - q_t⁻) b_t
        Σ log p_t ≥ Σ log b_t - log 1/(1 - q₀) - T log 1/(1 - s), and against A with q₀

    The two-mode model (Blom & Bar-Shalom 1988; Boers & Driessen 2003) lets B take over from A, too:
    a wrong plan reaches B before a scan can object. So that is not the default.
    """

    advised: Filter[Any]
    protected: Filter[Any]
    switching: float = 0.001  # s, the probability per step that A's picture becomes right or wrong
    trust: float = 0.5  # q₀
    mutual: bool = False  # whether B takes over from A as well: the exact two-mode model
    own_plans: bool = True  # whether A sees plans made from this belief, which are no evidence

    def __post_init__(self) -> None:
        boolean("own_plans", self.own_plans)
        number("switching", self.switching, low=0, high=0.5)
        number("trust", self.trust, low=0, high=1)
        boolean("mutual", self.mutual)
        for name in ("advised", "protected"):  # all of their particles tell of a scan's evidence
            if isinstance(member := getattr(self, name), ParticleFilter):
                object.__setattr__(self, name, replace(member, predictive=member.particles))

    def initial(self, prior: Any, plan: Actions, rng: np.random.Generator) -> HedgedBelief:
        """Return the belief at t = 0. B draws what it would alone; A has a stream of its own."""
        protected = self.protected.initial(prior, plan[:0], rng)
        stream = rng.spawn(1)[0]
        advised = self.advised.initial(prior, plan, stream)
        protected = self._foreseeing(protected, plan, stream)
        events = _events(Events(), advised, protected)
        with np.errstate(divide="ignore"):
            log_odds = float(arrays.log([self.trust])[0] - arrays.log([1.0 - self.trust])[0])
        return HedgedBelief(advised, protected, log_odds, events=events)

    def step(
        self,
        belief: HedgedBelief,
        scan: Scan,
        action: Action,
        plan: Actions,
        rng: np.random.Generator,
    ) -> HedgedBelief:
        s, stream = self.switching, rng.spawn(1)[0]
        log_odds = switched(belief.log_odds, s)
        advised, protected = belief.advised, belief.protected
        if s > 0.0:
            share = s * probability_of(-belief.log_odds) / probability_of(log_odds)
            advised = mixed(advised, share, belief.protected, stream)
        if s > 0.0 and self.mutual:
            share = s * probability_of(belief.log_odds) / probability_of(-log_odds)
            protected = mixed(protected, share, belief.advised, stream)
        advised = self.advised.step(advised, scan, action, plan, stream)
        protected = self.protected.step(protected, scan, action, plan[:0], rng)
        protected = self._foreseeing(protected, plan, stream)
        log_odds, evidence = weighed(log_odds, _evidence(advised), _evidence(protected))
        events = _events(belief.events, advised, protected)
        return HedgedBelief(advised, protected, log_odds, evidence, events)

    def _foreseeing(self, protected: Any, plan: Actions, stream: np.random.Generator) -> Any:
        """Return B's belief with a future if A's has one: where the plan leads, no evidence."""
        ahead = getattr(self.advised, "lookahead", None)
        if not isinstance(ahead, Foresight) or not isinstance(protected, ParticleBelief):
            return protected
        return replace(ahead, evidence=None, weighs=False)(protected, plan, stream)


@compiled
def probability_of(log_odds: float) -> float:
    """Return q of log q / (1 - q)."""
    if log_odds > 0.0:
        return float(1.0 / (1.0 + exp64(-log_odds)))
    odds = exp64(log_odds)
    return float(odds / (1.0 + odds))


@compiled
def switched(log_odds: float, switching: float) -> float:
    """Return the log-odds of q (1 - s) + (1 - q) s."""
    if switching == 0.0:
        return log_odds
    less = exp64(-abs(log_odds))  # odds of the less likely
    back = log64((1.0 - switching + less * switching) / (switching + less * (1.0 - switching)))
    return float(back if log_odds > 0.0 else -back)


@compiled
def weighed(log_odds: float, log_a: float, log_b: float) -> tuple[float, float]:
    """Return the log-odds after evidence a for A and b for B, and log (q a + (1 - q) b).

    If a or b is unknown, or both are 0, the odds stay and the evidence is NaN.
    """
    ratio = log_a - log_b
    if np.isnan(ratio) or max(log_a, log_b) == np.inf:
        return log_odds, np.nan
    rest = log64(1.0 + exp64(-abs(log_odds)))
    first = min(log_odds, 0.0) - rest + log_a
    second = min(-log_odds, 0.0) - rest + log_b
    top = max(first, second)
    evidence = top
    if top > -np.inf:
        evidence = top + log64(exp64(first - top) + exp64(second - top))
    return log_odds if np.isinf(log_odds) else log_odds + ratio, evidence


def mixed(belief: Any, share: float, other: Belief, rng: np.random.Generator) -> Any:
    """Replace each particle, with probability ``share``, by a draw from another belief.

    With its path, as far as both hold it, and at the mean weight, so that in expectation the belief
    is the mixture. What is no cloud, or has a queued future, is returned as it is.
    """
    if share == 0.0 or not isinstance(belief, ParticleBelief) or belief.queue.ahead > 0:
        return belief
    chosen = np.flatnonzero(rng.random(belief.log_weights.size) < share)
    if chosen.size == 0:
        return belief
    pointers = (np.arange(chosen.size) + rng.random()) / chosen.size
    return belief.exchanged(chosen, _paths_of(other, pointers))


def _paths_of(belief: Belief, pointers: Floats) -> Iterator[States]:
    """Yield the present states that pointers fall on, (d, k), then those before them."""
    offset, chosen = 0, None
    while (points := belief.points(offset)) is not None:
        chosen = pointed_at(points[1], pointers) if chosen is None else chosen
        yield points[0][chosen].T
        offset -= 1


def _evidence(belief: Any) -> float:
    try:
        return float(belief.scan_log_evidence)
    except AttributeError:
        raise InputError(
            f"a belief of type {type(belief).__name__} has no scan_log_evidence, but both members "
            "of a hedge must tell log Σ w p(scan | pose), from their weights before the scan."
        ) from None


def _events(before: Events, *members: Any) -> Events:
    """Return the counts of both members; unusable beams, which both get, are counted once."""
    each = [getattr(belief, "events", None) for belief in members]
    counts = {
        count.name: sum(getattr(of, count.name, 0) for of in each) for count in fields(Events)
    }
    counts["skipped_beams"], counts["blind_scans"] = before.skipped_beams, before.blind_scans
    return Events(**counts)


@dataclass(frozen=True)
class Plugged:
    """A localizer as a member; it keeps its own state, and is never re-seeded."""

    localizer: Localizer

    def initial(self, prior: Prior, plan: Actions, rng: np.random.Generator) -> Belief:
        return self.localizer.reset(prior, plan, rng)

    def step(
        self, belief: Belief, scan: Scan, action: Action, plan: Actions, rng: np.random.Generator
    ) -> Belief:
        return self.localizer.update(scan.ranges, action, plan)


def hedged(
    robot: RobotModel,
    advised: Localizer,
    protected: Localizer,
    *,
    switching: float = 0.001,
    trust: float = 0.5,
    mutual: bool = False,
    own_plans: bool = True,
) -> FilterLocalizer[HedgedBelief]:
    """Return q A + (1 - q) B of two localizers for one robot: a plan that misleads A costs little.

    Their beliefs must have ``scan_log_evidence``, log Σ w p(scan | pose) by their weights before
    the scan, with the same scan model; those of built-in localizers but ``dead-reckoning`` and
    ``amcl`` have it. Particles of a built-in A are re-seeded from B; a plug-in's are not. Only A is
    shown plans; for the numbers see ``Hedge``.
    """
    both = advised, protected
    members = [m.filter if isinstance(m, FilterLocalizer) else Plugged(m) for m in both]
    hedge = Hedge(
        advised=members[0], protected=members[1], switching=switching, trust=trust, mutual=mutual,
        own_plans=own_plans,
    )  # fmt: skip
    return FilterLocalizer(robot, hedge)
