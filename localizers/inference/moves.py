"""Moves of the queued future: fresh noise for states drawn many steps ago."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Indices
from localizers.inference.belief import ParticleBelief
from localizers.inference.rollout import Rollout


class Move(Protocol):
    """A Markov kernel on each particle's queue that leaves the filter's target invariant."""

    def __call__(
        self, belief: ParticleBelief, ancestors: Indices | None, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief, moved; ``ancestors`` is None if this step did not resample."""
        ...


@dataclass(frozen=True)
class Stay:
    """No move: the queue stays as it was drawn, as published."""

    def __call__(
        self, belief: ParticleBelief, ancestors: Indices | None, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief."""
        return belief


@dataclass(frozen=True)
class RenewedFuture:
    """Resample-move on the future block (Gilks & Berzuini 2001), for every particle.

    Propose x'_s ~ p(· | x'_{s-1}, u_s), s = t + 1 … t + F_t, from the particle's own present;
    accept with probability min(1, Π g(x'_{s-1}, x'_s) / Π g(x_{s-1}, x_s)); weights unchanged. The
    proposal is the motion model itself, so only g is left in the ratio, and γ_t is invariant.
    """

    rollout: Rollout

    def __call__(
        self, belief: ParticleBelief, ancestors: Indices | None, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief with its future moved."""
        if belief.queue.ahead == 0:
            return belief
        proposed, log_new = self.rollout.futures(belief.present, belief.drawn, 1, rng)
        queued = belief.queue.since(0)
        log_old = self.rollout.log_g_of(queued)
        accepted = arrays.log(rng.random(log_old.size)) + log_old < log_new[0]
        return belief.followed(
            [
                np.where(accepted, new[:, 0], old)
                for new, old in zip(proposed, queued[1:], strict=True)
            ]
        )


@dataclass(frozen=True)
class WhenResampled:
    """Another move, only at the steps that resample.

    Whether a step resamples depends on the weights, and these on the future that is moved, so γ_t
    is approached as n grows but is not exact at every n. ``Sometimes`` is as cheap and exact.
    """

    move: Move

    def __call__(
        self, belief: ParticleBelief, ancestors: Indices | None, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief, moved if its queues were resampled."""
        return belief if ancestors is None else self.move(belief, ancestors, rng)


@dataclass(frozen=True)
class Sometimes:
    """Another move, at each step with a fixed probability: still invariant."""

    move: Move
    probability: float

    def __call__(
        self, belief: ParticleBelief, ancestors: Indices | None, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief, moved or not."""
        return self.move(belief, ancestors, rng) if rng.random() < self.probability else belief
