"""Deliberately wrong filters are caught by the same tests: the exactness tests can fail."""

from dataclasses import replace
from functools import cached_property

import numpy as np
import pytest
from ring import (
    AS_PLANNED,
    AUTHORS,
    DRIVES,
    RingPlans,
    deq,
    fresh,
    informed_throughout,
    with_plans,
    worst,
    z_scores,
)

from localizers.inference.futures import PlanEvidence, Redraw, Rollout
from localizers.inference.particle_filter import ParticleFilter

REPLICATES = 500  # fewer than where the right ones pass


class RechargesTheFuture(ParticleFilter):
    """Multiplies the g of the whole queued future into the weights at every step."""

    def step(self, belief, ranges, action, plan, rng):
        belief = super().step(belief, ranges, action, plan, rng)
        for s in range(belief.queue.ahead):
            before, after = belief.queue.at(s), belief.queue.at(s + 1)
            belief = belief.reweighted(self.feasibility.log_g(before, after))
        return belief


class OldFutureIsFree(Rollout):
    """Takes nothing back of the old future's g: the new one's is charged on top."""

    def queued_log_g(self, belief, shared=0):
        return np.zeros(belief.log_weights.size)


class NewFutureIsFree(Rollout):
    """Divides by the old future's g and never charges the new one."""

    def futures(self, anchor, actions, copies, rng):
        paths, log_g = super().futures(anchor, actions, copies, rng)
        return paths, np.zeros_like(log_g)


class KeepsAnyPilot(Rollout):
    """Keeps the first pilot instead of one in proportion to its g."""

    def futures(self, anchor, actions, copies, rng):
        paths, log_g = super().futures(anchor, actions, copies, rng)
        return lambda chosen: paths(np.zeros_like(chosen)), log_g


class NeverNotices(Redraw):
    """Keeps the future that was drawn by the old plan."""

    def __call__(self, belief, actions, rng):
        return belief


def redrawing_by(part: type[Redraw] | type[Rollout]) -> type[ParticleFilter]:
    class Varied(ParticleFilter):
        @cached_property
        def _redraw(self):
            if issubclass(part, Redraw):
                return part(self.rollout, self.pilots)
            return Redraw(part(self.motion, self.feasibility), self.pilots)

    return Varied


class CountsPilotsEveryStep(ParticleFilter):
    """Leaves the pilots' h in the filter's own weights."""

    def step(self, belief, ranges, action, plan, rng):
        belief = super().step(belief, ranges, action, plan, rng)
        return belief if belief.log_h is None else belief.reweighted(belief.log_h)


class ChargedTwice(PlanEvidence):
    """Takes every plan in twice."""

    def __call__(self, belief, plan, rng):
        return super().__call__(super().__call__(belief, plan, rng), plan.copy(), rng)


class FirstForgotten(PlanEvidence):
    """Leaves out the plan shown at reset."""

    def __call__(self, belief, plan, rng):
        return belief if len(plan) == 4 else super().__call__(belief, plan, rng)


class OneStepLate(PlanEvidence):
    """Lays the plan from where its first action leads."""

    def __call__(self, belief, plan, rng):
        return super().__call__(belief, plan[1:], rng)


class OnlyReported(PlanEvidence):
    """Weighs what is reported and forgets it."""

    def __call__(self, belief, plan, rng):
        read = super().__call__(belief, plan, rng)
        return belief._replace(log_h=read.log_weights - belief.log_weights)


class ChargesTheStartAgain(PlanEvidence):
    """Charges at reset what the start was chosen by."""

    def __call__(self, belief, plan, rng):
        return super().__call__(belief, plan.copy(), rng)


class Noisy(RingPlans):
    """Lays the plan as the robot would drive it."""

    def collisions(self, states, plan, first=0):
        drift = np.random.default_rng(states.size + len(plan)).integers(-1, 2, states.shape[1])
        return super().collisions((states + drift) % 5, plan, first)


def reading_by(part: type[PlanEvidence], ring: ParticleFilter) -> ParticleFilter:
    return replace(ring, lookahead=part(**vars(ring.lookahead)))


def looking_by(part: type[Rollout], ring: ParticleFilter) -> ParticleFilter:
    rollout = part(ring.motion, ring.feasibility)
    return replace(ring, lookahead=replace(ring.lookahead, rollout=rollout))


@pytest.mark.parametrize(
    ("ring", "drive", "replicates"),
    [
        (deq(1.0, RechargesTheFuture), "as planned", REPLICATES),
        (deq(1.0, redrawing_by(OldFutureIsFree)), "everything", REPLICATES),
        (deq(1.0, redrawing_by(NewFutureIsFree)), "everything", REPLICATES),
        (deq(1.0, redrawing_by(NeverNotices)), "executed differs", REPLICATES),
        (deq(1.0, redrawing_by(KeepsAnyPilot), pilots=16), "everything", REPLICATES),
        (fresh(1.0, filter_class=CountsPilotsEveryStep), "as planned", REPLICATES),
        (looking_by(KeepsAnyPilot, fresh(2.0)), "as planned", REPLICATES),
    ],
)
def test_a_wrong_filter_is_caught(ring, drive, replicates):
    assert worst(z_scores(ring, DRIVES[drive], replicates)) > 5


@pytest.mark.parametrize(
    "ring",
    [
        reading_by(ChargedTwice, with_plans(2.0)),
        reading_by(FirstForgotten, with_plans(2.0)),
        reading_by(OneStepLate, with_plans(2.0)),
        reading_by(OnlyReported, with_plans(2.0)),
        reading_by(ChargesTheStartAgain, informed_throughout(2.0)),
        replace(with_plans(2.0), lookahead=PlanEvidence(sensor=RingPlans(2.0), steps=3)),
        replace(with_plans(2.0), lookahead=PlanEvidence(sensor=Noisy(2.0), steps=2)),
        replace(with_plans(2.0), lookahead=PlanEvidence(sensor=RingPlans(2.0), steps=2, keep=0.8)),
    ],
    ids=lambda ring: type(ring.lookahead).__name__,
)
def test_plans_wrongly_taken_as_evidence_are_caught(ring):
    exact = with_plans(2.0) if ring.start is None else informed_throughout(2.0)
    scores = z_scores(ring, AUTHORS["anew"], REPLICATES, meant=exact)
    assert worst(scores) > 5


def test_charging_a_plan_that_goes_on_is_caught_where_each_step_is_to_be_charged_once():
    ring, exact = with_plans(2.0, steps=3), with_plans(2.0, steps=3, new_only=True)
    assert worst(z_scores(ring, AS_PLANNED, REPLICATES, meant=exact)) > 5
