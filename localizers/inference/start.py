"""The particles at t = 0, and poses from anywhere for a filter that is lost."""

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from deqmcl_gym.numerics.types import Floats
from localizers.inference import weight_kernels
from localizers.inference.adaptive import Recovery, Watch
from localizers.inference.belief import ParticleBelief
from localizers.inference.parts import Actions, Initial, States
from localizers.inference.plan_evidence import PlanEvidence
from localizers.inference.queue import Queue
from localizers.inference.weight_kernels import normalized_with_log_sum
from localizers.models.scan import count_usable


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
        weight_kernels.pointed_at(weights, (np.arange(n) + rng.random()) / n, chosen)
        states = read.present.take(chosen, axis=1)
        if self.jitter > 0:
            states = states + self._noise(states, plan, rng)
        return read.resampled(chosen, by, log_sum)._replace(queue=Queue((states,)))

    def _noise(self, states: States, plan: Actions, rng: np.random.Generator) -> States:
        length = float(np.sqrt(plan[:, 0] ** 2 + plan[:, 1] ** 2).sum())
        sd = np.array([self.jitter, self.jitter, self.jitter / length if length > 0 else 0.0])
        noise: States = sd[:, None] * rng.standard_normal(states.shape)
        return noise.astype(states.dtype)


class Injection(Protocol):
    """Mixes poses into a belief."""

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief of a step that is to be scanned, in part from anywhere."""
        ...

    def noted(
        self, belief: ParticleBelief, plan: Actions, ranges: Floats | None = None
    ) -> ParticleBelief:
        """Return the belief, remembering how likely its scan (B,) was; None: it has had none."""
        ...


@dataclass(frozen=True)
class Nothing:
    """No pose is mixed in."""

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief."""
        return belief

    def noted(
        self, belief: ParticleBelief, plan: Actions, ranges: Floats | None = None
    ) -> ParticleBelief:
        """Return the belief."""
        return belief


@dataclass(frozen=True, kw_only=True)
class Anywhere:
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
        start: chooses among its draws by a new route.
        max_range: of a beam.
    """

    recovery: Recovery
    poses: Initial
    start: Start
    max_range: float

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief, in part from anywhere; draws from a stream of its own."""
        watch = belief.watch
        assert watch is not None  # noted at the start
        if watch.recovery.share == 0.0:
            return belief
        stream = rng.spawn(1)[0]
        chosen = stream.random(belief.log_weights.size) < watch.recovery.share
        count = int(np.count_nonzero(chosen))
        if count == 0:
            return belief
        start = self.start if self._news(watch, plan) else FromPrior()
        dtype = belief.present.dtype
        return belief.exchanged(
            chosen, start(drawn(self.poses, start.draws * count, dtype, plan, stream), plan, stream)
        )

    def noted(
        self, belief: ParticleBelief, plan: Actions, ranges: Floats | None = None
    ) -> ParticleBelief:
        """Return the belief, with the averages after its scan."""
        watch = belief.watch
        if watch is None or ranges is None:
            return belief._replace(watch=Watch(self.recovery, plan))
        beams = count_usable(ranges, self.max_range)
        recovery = watch.recovery.after(belief.scan_log_evidence, beams)
        return belief._replace(watch=Watch(recovery, plan, max(0, self._news(watch, plan) - 1)))

    def _news(self, watch: Watch, plan: Actions) -> int:
        if not is_new(watch.plan, plan):
            return watch.news
        return math.ceil(1 / self.recovery.alpha_fast)


def is_new(last: Actions, plan: Actions) -> bool:
    """Whether a plan is not the last one without its first action, but longer or shorter."""
    if len(last) <= 1:
        return len(plan) > 1
    return weight_kernels.agreeing(last[1:], plan) < min(len(last) - 1, len(plan))
