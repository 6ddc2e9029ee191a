"""Where the particles of t = 0 come from: the prior, or the prior and the first plan."""

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
    """Chooses the particles to begin with among draws from the prior."""

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
    """Return draws from a prior, as a belief that no action of the plan (h, k) has moved."""
    states = np.ascontiguousarray(prior.sample(count, rng).T, dtype=dtype)
    return ParticleBelief(Queue((states,)), np.zeros(count), drawn=plan[:0])


@dataclass(frozen=True)
class FromPrior:
    """The draws as they are."""

    draws: int = 1

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief."""
        return belief


@dataclass(frozen=True, kw_only=True)
class InformedStart:
    """Of K n draws from the prior, n by the feasibility of the plan shown at reset (systematic).

    Where the prior is broad this is the cheapest place for a long plan: it is followed once, from
    many poses. Importance sampling of p(x_0) p(π_0 | x_0), exact at ``jitter`` = 0; with a jitter,
    which tells apart draws that were taken twice, it is not. The plan is charged by this, so the
    filter's own evidence leaves it out.

    Attributes:
        evidence: p(π_0 | x_0, m), of as much of the plan as is to be followed.
        draws: K.
        jitter: standard deviation in x and y of poses; in θ as much as moves the end of the plan
            by it.
    """

    evidence: PlanEvidence
    draws: int
    jitter: float = 0.0

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the particles to begin with, all of one weight."""
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
        length = float(np.abs(plan[:, 0]).sum())
        sd = np.array([self.jitter, self.jitter, self.jitter / length if length > 0 else 0.0])
        noise: States = sd[:, None] * rng.standard_normal(states.shape)
        return noise.astype(states.dtype)
