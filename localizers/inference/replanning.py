"""Redrawing the queued future when the actions it was drawn with have changed."""

from dataclasses import dataclass

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Indices
from localizers.inference import kernels
from localizers.inference.belief import ParticleBelief
from localizers.inference.parts import Actions, States
from localizers.inference.rollout import Rollout, log_mean


@dataclass(frozen=True)
class Redraw:
    """log w += log ĥ_new - log ĥ_old: replace the future drawn with an old plan.

    The weights already hold the g of the old future, most of it absorbed by past resampling, so it
    can be neither divided out nor left in. Per particle, from the last state x the plans share:
    ĥ_old is the mean of Π g over the particle's own old future and M - 1 fresh ones, ĥ_new the
    mean over M fresh futures under the new plan, of which one is kept with probability ∝ Π g.
    Properly weighted for every M ≥ 1 (random weights by pilots: Lin, Chen & Liu 2013).

    Attributes:
        pilots: M.
    """

    rollout: Rollout
    pilots: int = 16

    def __call__(
        self, belief: ParticleBelief, actions: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return a belief whose future is drawn with ``actions``, (steps, k).

        A future that merely ends earlier than ``actions`` is left alone; it is extended later.
        """
        held = belief.queue.ahead
        shared = kernels.agreeing(belief.drawn, actions) if held else 0
        if shared == held:
            return belief
        anchor = belief.queue.at(shared)
        assert anchor is not None, "the shared steps are held"
        old = self._pilot_log_g(anchor, belief.drawn[shared:], self.pilots - 1, rng)
        old = np.vstack([old, self.rollout.queued_log_g(belief, shared)])
        paths, new = self.rollout.futures(anchor, actions[shared:held], self.pilots, rng)
        log_old = log_mean(old)
        # Where β = inf and every old future collides, the weight is zero already, or the charge
        # was dropped by a weight collapse: either way there is nothing to undo.
        log_factor = log_mean(new) - np.where(np.isneginf(log_old), 0.0, log_old)
        kept = _choose(new, rng)
        redrawn = belief.cut(shared)
        for ahead, states in enumerate(paths, start=shared + 1):
            redrawn = redrawn.appended(states[:, kept, np.arange(kept.size)], actions[:ahead])
        redrawn = redrawn.reweighted(log_factor)
        return redrawn._replace(events=redrawn.events.plus(replanned_steps=1))

    def _pilot_log_g(
        self, anchor: States, actions: Actions, pilots: int, rng: np.random.Generator
    ) -> Floats:
        if pilots == 0:
            return np.empty((0, anchor.shape[1]))
        return self.rollout.log_g(anchor, actions, pilots, rng)


def _choose(log_weights: Floats, rng: np.random.Generator) -> Indices:
    """One row per column, drawn with probability ∝ exp(log_weights); the first if all are -inf."""
    top = log_weights.max(axis=0)
    cumulative = np.cumsum(arrays.exp(log_weights - np.where(np.isfinite(top), top, 0.0)), axis=0)
    pointers = rng.random(log_weights.shape[1]) * cumulative[-1]
    chosen: Indices = (cumulative <= pointers).sum(axis=0)
    return np.where(cumulative[-1] > 0, np.minimum(chosen, len(log_weights) - 1), 0)
