"""The particles at t = 0, and poses from anywhere for a filter that is lost."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from localizers.inference.belief import ParticleBelief
from localizers.inference.futures import PlanEvidence, agreeing
from localizers.inference.loss_detector import Recovery, Watch
from localizers.inference.particles import Actions, Initial, normalized_with_log_sum
from localizers.inference.queue import Queue
from localizers.inference.resampling import pointed_at


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
