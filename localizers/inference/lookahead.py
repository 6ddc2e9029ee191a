"""What the plan says of the present, without queueing its future: how feasible it is from there."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from localizers.inference.belief import ParticleBelief
from localizers.inference.parts import Actions, LogWeights, States
from localizers.inference.rollout import Rollout, log_mean


class Lookahead(Protocol):
    """Takes in what the plan says of the present, at the start and at every step.

    By h_t(x_t) = E[Π g of the planned future | x_t], which weights what is reported; or, as
    ``PlanEvidence``, by an observation of x_t, which stays.
    """

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief, looking ahead along the plan (h, k)."""
        ...


@dataclass(frozen=True)
class Myopic:
    """h = 1: nothing is looked ahead for."""

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief, without a reading of an earlier plan."""
        reading = belief.plan_reading
        if reading is None or reading.shown is plan:  # the start was chosen by it
            return belief
        return belief._replace(plan_reading=None)


class Table(Protocol):
    """h at hand for any state, under a window of actions."""

    def log_h(self, states: States, window: Actions) -> LogWeights:
        """Log h of states (d, n) under the actions (F, k), (n,)."""
        ...


@dataclass(frozen=True, kw_only=True)
class Tabulated:
    """h_t(x) of the next F planned steps, looked up.

    Attributes:
        steps: F, how far to look.
    """

    table: Table
    steps: int

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief, looking ahead; draws nothing."""
        window = plan[: self.steps]
        if len(window) == 0:
            return belief
        return belief.foreseeing(self.table.log_h(belief.present, window))


@dataclass(frozen=True, kw_only=True)
class Pilots:
    """ĥ_t(x) = mean of Π g over K fresh rollouts of the plan: unbiased for h_t(x).

    Multiplied into the reported weights only. Multiplied into the filter's own at every step it
    would count the future up to F times. Lin, Chen & Liu 2013 call such rollouts pilots.

    Attributes:
        steps: F, how far to look.
        pilots: K.
    """

    rollout: Rollout
    steps: int
    pilots: int

    def __call__(
        self, belief: ParticleBelief, plan: Actions, rng: np.random.Generator
    ) -> ParticleBelief:
        """Return the belief, looking ahead by a stream of its own: the filter's draws stay."""
        window = plan[: self.steps]
        if len(window) == 0:
            return belief
        stream = rng.spawn(1)[0]
        log_g = self.rollout.log_g(belief.present, window, self.pilots, stream)
        return belief.foreseeing(log_mean(log_g))
