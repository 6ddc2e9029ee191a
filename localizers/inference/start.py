"""The particles at t = 0, and poses from anywhere for a filter that is lost."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.validation import InputError, digits, number
from localizers.inference.belief import ParticleBelief
from localizers.inference.futures import PlanEvidence, agreeing
from localizers.inference.particles import Actions, Initial, Memory, normalized_with_log_sum
from localizers.inference.queue import Queue
from localizers.inference.resampling import pointed_at
from localizers.models.scan import Scan


def initial_cloud(
    prior: Initial, count: int, dtype: Any, plan: Actions, rng: np.random.Generator
) -> ParticleBelief:
    """Return draws from a prior as a belief without a queued future."""
    states = np.ascontiguousarray(prior.sample(count, rng).T, dtype=dtype)
    return ParticleBelief(Queue((states,)), np.zeros(count), drawn=plan[:0])


@dataclass(frozen=True, kw_only=True)
class InformedStart:
    """Of K n draws from the prior, n chosen systematically by the feasibility of the first plan.

    If the prior is broad, a long plan is cheapest to use here: it is laid out once, from many
    poses. This is importance sampling of p(x_0) p(π_0 | x_0), exact at ``jitter`` = 0; a jitter
    separates draws that were chosen more than once. The choice charges π_0, so the evidence of
    the filter itself leaves it out.

    Attributes:
        evidence: p(π_0 | x_0, m), of as much of the plan as it reads.
        draws: K.
        jitter: standard deviation in x and y, in the map's unit; that of θ (rad) moves the end of
            the plan by as much.
    """

    evidence: PlanEvidence
    draws: int
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
class Averages:
    """w_slow and w_fast: max(0, 1 - w_fast / w_slow) of the draws are random poses.

    Exponential averages of how likely the scans were (Thrun et al. 2005, table 8.3).

    Attributes:
        alpha_slow, alpha_fast: rates in [0, 1], per scan; alpha_fast ≥ alpha_slow.
        slow, fast: w_slow and w_fast; 0 before the first scan.
    """

    alpha_slow: float = 0.0
    alpha_fast: float = 0.0
    slow: float = 0.0
    fast: float = 0.0

    def __post_init__(self) -> None:
        number("recovery_alpha_slow", self.alpha_slow, low=0, high=1)
        number("recovery_alpha_fast", self.alpha_fast, low=0, high=1)
        if self.alpha_fast < self.alpha_slow:
            raise InputError(
                f"recovery_alpha_fast is {digits(self.alpha_fast)}, but must be at least "
                f"recovery_alpha_slow, {digits(self.alpha_slow)}."
            )

    @property
    def share(self) -> float:
        """Probability that a draw is a random pose."""
        return max(0.0, 1.0 - self.fast / self.slow) if self.slow > 0 else 0.0


@dataclass(frozen=True, kw_only=True)
class Recovery(Averages):
    """``Averages`` that are plain means over the first 1 / α scans.

    So the first scan, which the particles of a lost robot hardly explain, is soon outweighed. With
    both rates 0 there are no random poses.

    Attributes:
        scans: how many were averaged.
    """

    scans: int = 0

    def after(self, log_evidence: float, beams: int) -> "Recovery":
        """Return the averages after a scan.

        The likelihood averaged is that of one beam, the geometric mean over the scan, so that scans
        with lost beams are comparable.

        Args:
            log_evidence: log p(o | belief); NaN changes nothing.
            beams: how many beams it is made of; 0 changes nothing.
        """
        if beams == 0 or math.isnan(log_evidence) or self.alpha_fast == 0:
            return self
        # exp of x ≤ 0 only: 1 / exp(-x) where a beam's density is above 1
        log_beam = log_evidence / beams
        size = float(arrays.exp(-abs(log_beam)))
        likelihood = size if log_beam <= 0 else 1.0 / size
        scans = self.scans + 1
        slow, fast = max(self.alpha_slow, 1 / scans), max(self.alpha_fast, 1 / scans)
        return replace(
            self,
            slow=self.slow + slow * (likelihood - self.slow),
            fast=self.fast + fast * (likelihood - self.fast),
            scans=scans,
        )


@dataclass(frozen=True)
class Watch(Memory):
    """What an injection remembers of scans and plans.

    Attributes:
        recovery: averages of how likely the scans were.
        plan: the latest, (h, k).
        news: for how many more steps, this one included, the route counts as new.
    """

    recovery: Recovery
    plan: Actions
    news: int = 0

    def scanned(self, scan: Scan, log_evidence: float) -> "Watch":
        """Return the same with the averages after a scan."""
        return replace(self, recovery=self.recovery.after(log_evidence, scan.beams))


@dataclass(frozen=True, kw_only=True)
class Injection:
    """bel ← (1 - s) bel + s p_anywhere before each scan, s = max(0, 1 - w_fast / w_slow).

    Thrun et al. 2005, table 8.3. w_slow and w_fast are averages of how likely scans are at the
    belief before them, see ``Recovery``. Each particle is exchanged with probability s for a pose
    of the cloud's mean weight; of its past it keeps what it had.

    Whoever plans a new route for a robot that is lost knows where it is. A route is new that does
    not go on as the one before, and stays so for the 1 / α_fast steps in which w_fast forgets. Then
    the poses are chosen by it as the first particles are, by ``start``.

    Attributes:
        recovery: the rates.
        poses: p_anywhere.
        start: chooses among its draws by a new route; None: the plan is not looked at.
    """

    recovery: Recovery
    poses: Initial
    start: InformedStart | None = None

    def begun(self, belief: ParticleBelief, plan: Actions) -> ParticleBelief:
        """Return the first belief, which remembers its plan."""
        return belief.remembering(Watch(self.recovery, plan))

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief, in part from anywhere; draws from a stream of its own."""
        last = belief.recall(Watch)
        assert last is not None, "begun at the start"
        news = max(0, last.news - 1)
        if is_new(last.plan, plan):
            news = math.ceil(1 / self.recovery.alpha_fast)
        belief, share = belief.remembering(Watch(last.recovery, plan, news)), last.recovery.share
        if share == 0.0:
            return belief
        stream = rng.spawn(1)[0]
        chosen = stream.random(belief.log_weights.size) < share
        count = int(np.count_nonzero(chosen))
        if count == 0:
            return belief
        dtype = belief.present.dtype
        if self.start is None or news == 0:
            return belief.exchanged(chosen, initial_cloud(self.poses, count, dtype, plan, stream))
        candidates = initial_cloud(self.poses, self.start.draws * count, dtype, plan, stream)
        return belief.exchanged(chosen, self.start(candidates, plan, stream))


def is_new(last: Actions, plan: Actions) -> bool:
    """Whether a plan is not the last one without its first action, but longer or shorter."""
    if len(last) <= 1:
        return len(plan) > 1
    return agreeing(last[1:], plan) < min(len(last) - 1, len(plan))
