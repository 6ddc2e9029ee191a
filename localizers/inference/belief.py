"""The belief of a particle filter: a weighted cloud of queues Q(t) of states x_{t-L} … x_{t+F}.

Resampling does not copy states: each slot keeps them as they were drawn, with the index map from
the order of the next slot's particles to its own. A sliding window keeps the composition to the
present, which is read at every step; named tuples are made fastest.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import accumulate
from typing import NamedTuple, Self

import numpy as np

from deqmcl_gym.numerics import Floats, Indices
from localizers.inference.loss_detector import LossDetector, Watch
from localizers.inference.particles import (
    Actions,
    LogWeights,
    States,
    effective_sample_size,
    log_evidence,
    log_sum_exp,
    normalize,
    shifted,
)
from localizers.models.scan import Scan

Link = Indices | None  # None: the identity


class Queue(NamedTuple):
    """An immutable queue of slots.

    The links after the present are held as two halves, too, so that their composition costs the
    same for a queue of any length: ``old`` has the composition from each link of the older half to
    that half's end, ``new`` that of all others. Once ``old`` is used up, ``new`` is turned into it.
    """

    slots: tuple[States, ...]  # the states as they were drawn, (d, n) each, oldest first
    links: tuple[Link, ...] = ()  # links[i] maps the order of slot i + 1 to that of slot i
    pending: Link = None  # from the current order to that of the newest slot
    present: int = 0  # the index of x_t among the slots
    old: tuple[Link, ...] = ()  # the first link's is the last
    new: Link = None

    @classmethod
    def of(cls, states: Sequence[States]) -> "Queue":
        """Return a queue of states x_{t-L} … x_t, (d, n) each, in one order."""
        before = len(states) - 1
        return cls(tuple(states), (None,) * before, None, before)

    @property
    def ahead(self) -> int:
        """How many states after the present are held."""
        return len(self.slots) - 1 - self.present

    def resampled(self, ancestors: Indices) -> "Queue":
        """Keep the whole queues of these particles, (n,)."""
        pending = ancestors if self.pending is None else self.pending[ancestors]
        return Queue(self.slots, self.links, pending, self.present, self.old, self.new)

    def appended(self, states: States) -> "Queue":
        """Add a newest state, (d, n)."""
        slots, links = (*self.slots, states), (*self.links, self.pending)
        return Queue(slots, links, None, self.present, self.old, compose(self.new, self.pending))

    def stepped(self, past: int) -> "Queue":
        """Let the next state become the present; keep at most ``past`` states before it."""
        old, new = self.old[:-1], self.new
        if not self.old:
            later = reversed(self.links[self.present + 1 :])
            turned = accumulate(later, lambda after, link: compose(link, after))
            old, new = tuple(turned), None
        first = max(0, self.present + 1 - past)
        slots, links, present = self.slots[first:], self.links[first:], self.present + 1 - first
        return Queue(slots, links, self.pending, present, old, new)

    def cut(self, keep: int) -> "Queue":
        """Forget the states more than ``keep`` after the present, the current order unchanged."""
        last = self.present + keep
        slots, links, pending = self.slots[: last + 1], self.links[:last], self._order(last)
        new = reduce(compose, links[self.present :], None)
        return Queue(slots, links, pending, self.present, (), new)

    def at(self, offset: int) -> States | None:
        """Return the states at ``offset`` from the present, (d, n), as a fresh array, or None."""
        index = self.present + offset
        if not 0 <= index < len(self.slots):
            return None
        states = self.held(index)
        return states.copy() if states is self.slots[index] else states

    def held(self, index: int) -> States:
        """Return the states of slot ``index``, (d, n); read-only, as they may be the queue's."""
        order, states = self._order(index), self.slots[index]
        return states if order is None else states.take(order, axis=1)

    def since(self, offset: int) -> list[States]:
        """Return ``at`` of each offset from ``offset`` on, in one pass over the links."""
        order, clouds = self.pending, []
        for index in range(len(self.slots) - 1, self.present + offset - 1, -1):
            states = self.slots[index]
            clouds.append(states.copy() if order is None else states.take(order, axis=1))
            order = compose(self.links[index - 1], order) if index else order
        return clouds[::-1]

    def _order(self, index: int) -> Link:
        """Return the map from the current order to that of slot ``index``."""
        order, links = self.pending, self.links[index:]
        if links and index <= self.present:
            after = compose(self.old[-1], self.new) if self.old else self.new
            order = compose(after, order)
            links = links[: self.present - index]
        for link in reversed(links):
            order = compose(link, order)
        return order


def compose(outer: Link, inner: Link) -> Link:
    """Return the map i → outer[inner[i]]."""
    if outer is None:
        return inner
    return outer if inner is None else outer[inner]


@dataclass(frozen=True)
class Events:
    """Counts of irregular events since reset."""

    # evidence to which every particle gave zero likelihood: dropped, and the weights kept
    weight_collapses: int = 0
    replanned_steps: int = 0  # updates at which the queued future was redrawn under a changed plan
    skipped_beams: int = 0  # beams that were NaN, infinite or outside [0, max range]
    blind_scans: int = 0  # scans without a usable beam; they changed no weight
    infeasible_plans: int = 0  # plans used as evidence that collide from every particle
    random_poses: int = 0  # particles replaced by random poses in free space, to recover

    def plus(self, **counts: int) -> Self:
        """Return these counts, increased by ``counts``."""
        return replace(self, **{name: getattr(self, name) + n for name, n in counts.items()})

    def of_scan(self, scan: Scan) -> Self:
        """Return these counts with the unusable beams of a scan added."""
        unusable = scan.ranges.size - scan.beams
        if unusable == 0:
            return self
        return self.plus(skipped_beams=unusable, blind_scans=int(scan.beams == 0))


@dataclass(frozen=True)
class FilteredEvents(Events):
    """Counts of a filter that chooses beams, also of the usable ones that it left out."""

    dropped_beams: int = 0


@dataclass(frozen=True, eq=False)
class PlanReading:
    """What the latest plan said about the present."""

    shown: Actions  # all of it, (h, k)
    seen: Actions  # its first steps that have been charged, now or before, (L, k)
    tempering: float = math.nan  # λ in [0, 1], exponent of its likelihood; NaN: no step charged
    feasible: float = math.nan  # P(feasible from x_t) under the belief before it; NaN likewise
    log_evidence: float = 0.0  # log E[p(π_t | x_t, m)^λ] under the belief before it


class _Cloud(NamedTuple):
    """Fields of a particle belief."""

    queue: Queue  # the states x_{t-L} … x_{t+F} of n particles
    log_weights: LogWeights  # not normalised, (n,)
    drawn: Actions  # the actions with which the states after the present were drawn, (F_t, k)
    log_normalizer: float = 0.0  # log of the evidence absorbed by resampling; see ``log_evidence``
    # log h_t(x_t), how feasible the planned future is from the present, if it is not queued, (n,).
    # It multiplies the reported weights, not those that are carried on; None: no look-ahead.
    log_h: LogWeights | None = None
    # the planned future of each particle where it is drawn from the present instead of queued:
    # states (d, n) of x_{t+k} by k ≥ 1, None beyond its end
    foreseen: Callable[[int], States | None] | None = None
    events: Events = Events()
    scan_log_evidence: float = math.nan  # log Σ w p(o_t | x_t, m), from some of the particles
    scan_power: float = 1.0  # λ_t, the exponent of the latest scan's likelihood
    detector: LossDetector | None = None  # evidence for and against it; None: none is kept
    plan_reading: PlanReading | None = None  # of the latest plan, where plans are evidence
    watch: Watch | None = None  # what is remembered to recover by; None: nothing is
    fixed: bool = True  # False: of hypotheses, as there was no scan yet, where the first decides


class ParticleBelief(_Cloud):
    """An immutable weighted cloud of queues; a named tuple, as several are made at every step."""

    def __repr__(self) -> str:
        past, steps = self.queue.present, len(self.queue.slots)
        of = f"{self.log_weights.size} particles at steps {-past} to {steps - 1 - past}"
        return f"<ParticleBelief of {of}>"

    @property
    def quality(self) -> float | None:
        """P(not lost | o_{1:t}), in [0, 1]; None if no evidence is kept."""
        return None if self.detector is None else self.detector.quality

    @property
    def present(self) -> States:
        """States x_t, (d, n); read-only."""
        return self.queue.held(self.queue.present)

    @property
    def head(self) -> States:
        """The newest states x_{t+F_t}, (d, n); read-only."""
        return self.queue.held(len(self.queue.slots) - 1)

    @property
    def reported_log_weights(self) -> LogWeights:
        """Log of w h_t(x_t), not normalised, (n,)."""
        return self.log_weights if self.log_h is None else self.log_weights + self.log_h

    @cached_property
    def weights(self) -> Floats:
        """Reported weights with sum 1, (n,); read-only."""
        weights = np.empty(self.log_weights.size)
        normalize(self.log_weights if self.log_h is None else self.reported_log_weights, weights)
        return weights

    @property
    def effective_sample_size(self) -> float:
        """1 / Σ w², from 1 to n."""
        return effective_sample_size(self.weights)

    @property
    def log_evidence(self) -> float:
        """Log of the unbiased estimate of ∫γ_t: p(o_{1:t}, every step of the queue feasible)."""
        log_weights = self.reported_log_weights
        return self.log_normalizer + log_sum_exp(log_weights) - math.log(log_weights.size)

    def points(self, offset: int = 0) -> tuple[States, Floats] | None:
        """Return states (n, d) and weights (n,) of x_{t+offset}; None if the queue lacks it."""
        if offset > 0 and self.foreseen is not None:
            states = self.foreseen(offset)
        else:
            held = 0 <= self.queue.present + offset < len(self.queue.slots)  # a call less, if not
            states = self.queue.at(offset) if held else None
        return None if states is None else (states.T, self.weights.copy())

    def resampled(self, ancestors: Indices, log_sum: float) -> "ParticleBelief":
        """Keep the ``ancestors``, drawn in proportion to w; ``log_sum`` is log Σ w."""
        return self._replace(
            queue=self.queue.resampled(ancestors),
            log_weights=np.zeros(ancestors.size),
            log_normalizer=self.log_normalizer + log_sum - math.log(self.log_weights.size),
            log_h=None,
            foreseen=None,
        )

    def appended(self, states: States, drawn: Actions) -> "ParticleBelief":
        """Add newest states (d, n), drawn with the last of the actions ``drawn``, (F_t + 1, k)."""
        return self._replace(queue=self.queue.appended(states), drawn=drawn)

    def stepped(self, past: int) -> "ParticleBelief":
        """Let the next state become the present; keep at most ``past`` states before it."""
        queue = self.queue.stepped(past)
        return self._replace(queue=queue, drawn=self.drawn[1:], log_h=None, foreseen=None)

    def cut(self, keep: int) -> "ParticleBelief":
        """Forget the states more than ``keep`` steps after the present."""
        return self._replace(queue=self.queue.cut(keep), drawn=self.drawn[:keep])

    def foreseeing(self, log_h: LogWeights) -> "ParticleBelief":
        """Multiply the reported weights by h_t(x_t), (n,); dropped as in ``reweighted``."""
        if math.isfinite((self.log_weights + log_h).max()):
            return self._replace(log_h=log_h)
        return self._collapsed()

    def reweighted(self, log_factor: LogWeights) -> "ParticleBelief":
        """Multiply each weight by exp(log_factor), (n,).

        If that leaves no particle any weight, or one an infinite weight, the factor is dropped and
        a weight collapse is counted: the cloud follows the motion model until one explains a scan.
        """
        total = np.empty(self.log_weights.size)
        if math.isfinite(shifted(self.log_weights, log_factor, total)):
            return self._replace(log_weights=total)
        return self._collapsed()

    def exchanged(self, chosen: Indices, paths: Iterable[States]) -> "ParticleBelief":
        """Replace the states of ``chosen`` particles, at mean weight; no future may be queued.

        By ``paths``, which have their present states, (d, k), then those before them, if any.
        """
        states, log_weights = self.queue.since(-self.queue.present), self.log_weights.copy()
        for held, new in zip(reversed(states), paths, strict=False):
            held[:, chosen] = new
        log_weights[chosen] = log_sum_exp(log_weights) - math.log(log_weights.size)
        return self._replace(queue=Queue.of(states), log_weights=log_weights)

    def scanned(
        self, scan: Scan, log_likelihood: LogWeights, most: int, power: float = 1.0
    ) -> "ParticleBelief":
        """Weight by a scan of log-likelihoods (n,); record how well this belief predicted it.

        The record is taken from at most ``most`` evenly spaced particles and does not depend on
        ``power``, the exponent of the likelihood.
        """
        evidence = log_evidence(self.log_weights, log_likelihood, most)
        # a likelihood of 0 to the power of 0 is 1
        factor = power * log_likelihood if power > 0.0 else np.zeros(log_likelihood.size)
        return self.reweighted(factor)._replace(scan_power=power).learned(scan, evidence)

    def learned(self, scan: Scan, log_evidence: float) -> "ParticleBelief":
        """Keep how well a scan was predicted, for the quality and for recovery."""
        detector, watch = self.detector, self.watch
        return self._replace(
            scan_log_evidence=log_evidence,
            detector=None if detector is None else detector.scanned(scan, log_evidence),
            watch=None if watch is None else watch.scanned(scan, log_evidence),
        )

    def _collapsed(self) -> "ParticleBelief":
        return self._replace(events=self.events.plus(weight_collapses=1))
