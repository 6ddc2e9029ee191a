"""Poses from anywhere for a filter that is lost: augmented MCL, and the route as a hint."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from deqmcl_gym.numerics.types import Floats
from localizers.inference import kernels
from localizers.inference.adaptive import Recovery, Watch
from localizers.inference.belief import ParticleBelief
from localizers.inference.parts import Actions, Initial
from localizers.inference.start import FromPrior, Start, drawn
from localizers.models.scan_kernels import count_usable


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
    not go on as the one before, and stays so until 1 / α_fast scans in a row gave s = 0. Then the
    poses are chosen by it as the first particles are, by ``start``.

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
        news = self._news(watch, plan)
        return belief._replace(
            watch=Watch(recovery, plan, news if recovery.share > 0 else max(0, news - 1))
        )

    def _news(self, watch: Watch, plan: Actions) -> int:
        if not is_new(watch.plan, plan):
            return watch.news
        return math.ceil(1 / self.recovery.alpha_fast)


def is_new(last: Actions, plan: Actions) -> bool:
    """Whether a plan is not the last one without its first action, but longer or shorter."""
    if len(last) <= 1:
        return len(plan) > 1
    return kernels.agreeing(last[1:], plan) < min(len(last) - 1, len(plan))
