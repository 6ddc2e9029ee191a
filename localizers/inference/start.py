"""The particles at t = 0: drawn from the prior, or chosen among its draws by the first plan."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from localizers.inference import kernels
from localizers.inference.belief import ParticleBelief
from localizers.inference.parts import Actions, Initial, States
from localizers.inference.plan_evidence import PlanEvidence
from localizers.inference.queue import Queue
from localizers.inference.weights import normalized_with_log_sum


class Start(Protocol):
    """Chooses the first particles among draws from the prior."""

    @property
    def draws(self) -> int:
        """K, draws for each particle."""
        ...

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return a belief of n particles, of K n draws from the prior."""
        ...


def drawn(
    prior: Initial, count: int, dtype: Any, plan: Actions, rng: np.random.Generator
) -> ParticleBelief:
    """Return draws from a prior as a belief without a queued future."""
    states = np.ascontiguousarray(prior.sample(count, rng).T, dtype=dtype)
    return ParticleBelief(Queue((states,)), np.zeros(count), drawn=plan[:0])


@dataclass(frozen=True)
class FromPrior:
    """All draws from the prior."""

    draws: int = 1

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief."""
        return belief


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
        by, n = read.log_weights, read.log_weights.size // self.draws
        weights, log_sum = normalized_with_log_sum(by)
        chosen = np.empty(n, np.intp)
        kernels.pointed_at(weights, (np.arange(n) + rng.random()) / n, chosen)
        states = read.present.take(chosen, axis=1)
        if self.jitter > 0:
            states = states + self._noise(states, plan, rng)
        return read.resampled(chosen, by, log_sum)._replace(queue=Queue((states,)))

    def _noise(self, states: States, plan: Actions, rng: np.random.Generator) -> States:
        length = float(np.sqrt(plan[:, 0] ** 2 + plan[:, 1] ** 2).sum())
        sd = np.array([self.jitter, self.jitter, self.jitter / length if length > 0 else 0.0])
        noise: States = sd[:, None] * rng.standard_normal(states.shape)
        return noise.astype(states.dtype)
