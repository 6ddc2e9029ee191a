"""Every method is unbiased for its γ_t, with eight particles (see ring): |z| < 5, fixed seeds."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from ring import (
    AS_PLANNED,
    AUTHORS,
    DRIVES,
    FUTURE,
    METHODS,
    PAST,
    PLANS,
    PRIOR,
    RESAMPLING,
    SENSOR,
    STATES,
    Drive,
    beliefs,
    deq,
    estimates,
    fresh,
    gamma,
    plans_shown,
    transition,
    with_plans,
    worst,
    z_scores,
)

from localizers.inference.futures import Foresight, PlanEvidence
from localizers.inference.particle_filter import ParticleFilter

ALWAYS, DEGENERATE = RESAMPLING
# How it resamples, and β: at β = 10 rare events would break the central limit theorem.
CONDITIONS = [(ALWAYS, 2.0), (DEGENERATE, 1.0)]


SLOW = [
    pytest.param(10_000, name, strategy, drive, beta, marks=pytest.mark.slow)
    for names, drives in ((METHODS, DRIVES), (PLANS, DRIVES | AUTHORS))
    for name, drive in product(names, drives)
    for strategy, beta in CONDITIONS
    if drive in ("as planned", "everything") or name.startswith("deq") or name in PLANS
]


@pytest.mark.parametrize(
    ("replicates", "name", "strategy", "drive", "beta"),
    [
        (600, "mcl", DEGENERATE, "as planned", 1.0),
        (600, "past", ALWAYS, "as planned", 1.0),
        (600, "g", DEGENERATE, "as planned", 1.0),
        (600, "g and past", ALWAYS, "as planned", 1.0),
        (600, "deq", ALWAYS, "as planned", 1.0),
        (600, "deq", DEGENERATE, "as planned", 1.0),
        (600, "deq", ALWAYS, "everything", 1.0),
        (600, "deq, 2 pilots", DEGENERATE, "everything", 1.0),
        (600, "deq, 16 pilots", ALWAYS, "everything", 1.0),
        (600, "fresh", ALWAYS, "as planned", 1.0),
        (600, "fresh", DEGENERATE, "everything", 1.0),
        (600, "fresh, one roll-out", ALWAYS, "everything", 1.0),
        (600, "plans", ALWAYS, "as planned", 1.0),
        (600, "plans", DEGENERATE, "anew", 2.0),
        (600, "plans", ALWAYS, "stale", 2.0),
        (600, "plans", DEGENERATE, "everything", 1.0),
        (600, "plans, to their end", ALWAYS, "none at first", 1.0),
        (600, "plans, when new", DEGENERATE, "as planned", 2.0),
        (600, "plans, when new", ALWAYS, "queued step changes", 1.0),
        (600, "start", ALWAYS, "stale", 2.0),
        (600, "start, two draws", DEGENERATE, "anew", 1.0),
        (600, "start and plans", ALWAYS, "anew", 1.0),
        (600, "start and plans, when new", DEGENERATE, "as planned", 1.0),
        (600, "start and plans, when new", ALWAYS, "anew", 1.0),
        *SLOW,
    ],
)
def test_the_unnormalised_estimate_is_unbiased_for_gamma(replicates, name, strategy, drive, beta):
    ring = (METHODS | PLANS)[name](beta, resampling=RESAMPLING[strategy])
    assert worst(z_scores(ring, (DRIVES | AUTHORS)[drive], replicates)) < 5


@pytest.mark.parametrize("ring", [deq(1.0), fresh(1.0)], ids=["deq", "fresh"])
def test_every_state_of_the_queue_is_tested_and_every_value_of_the_state(ring):
    scores = z_scores(ring, AS_PLANNED, replicates=3)
    held = {(t, s) for t in range(5) for s in range(-PAST, FUTURE + 1) if 0 <= t + s <= 4}
    assert set(scores) == held
    assert {z.shape for z in scores.values()} == {(STATES,)}


def foreseen(t: int, ahead: int, drive: Drive, beta: float) -> np.ndarray:
    """∫ γ_t 1{x_t = i} P(x_{t+ahead} = j | x_t = i, the planned steps feasible), summed over i."""
    ring = with_plans(beta)
    present = gamma(t, drive.executed[:t], beta, plans_shown(ring, drive))[t]
    commands = drive.plans[t][:FUTURE]
    steps = [transition(command, beta) for command in commands]
    before, after = np.eye(STATES), np.ones(STATES)
    for step in steps[:ahead]:
        before = before @ step
    for step in reversed(steps[ahead:]):
        after = step @ after
    joint = before * after
    return present @ (joint / joint.sum(axis=1, keepdims=True))


def test_where_the_plan_is_evidence_the_future_is_that_of_a_feasible_plan_as_roll_outs_grow():
    # Of M roll-outs one is kept in proportion to its g: a bias of O(1/M), no other.
    drive, beta, replicates = AUTHORS["anew"], 2.0, 1_500
    away = {}
    for copies in (1, 4, 64):
        ring = with_plans(beta)
        ahead = Foresight(
            rollout=ring.rollout, steps=FUTURE, copies=copies, evidence=ring.lookahead
        )
        looking = replace(ring, lookahead=ahead)
        runs, scores = [estimates(looking, drive, seed) for seed in range(replicates)], []
        for t, offset in ((0, 2), (1, 2), (2, 1)):
            seen = [run[t, offset] for run in runs]
            error = np.std(seen, axis=0, ddof=1) / math.sqrt(replicates)
            difference = np.mean(seen, axis=0) - foreseen(t, offset, drive, beta)
            scores.append(np.abs(difference / np.maximum(error, 1e-12)).max())
        away[copies] = max(scores)
    assert away[64] < 5  # 6e-7 for each of 15 if normal, beside a bias of 1/64
    assert away[1] > 5  # the motion alone is caught
    assert away[1] > away[4] > away[64]


def test_enumeration_agrees_with_the_forward_recursion():
    # γ by messages instead of paths: α_t forwards, then h_t(x) backwards over the planned steps.
    beta, t, commands = 1.0, 2, (1, 1, 2, 1)
    step = [transition(command, beta) for command in commands]
    forward = PRIOR @ step[0] * SENSOR[:, 0] @ step[1] * SENSOR[:, 1]
    lookahead = step[2] @ step[3] @ np.ones(STATES)
    assert gamma(t, commands, beta)[t] == pytest.approx(forward * lookahead, rel=1e-12)


def test_a_plan_that_is_kept_is_never_redrawn_and_draws_nothing_for_it():
    few, many = (list(beliefs(deq(1.0, pilots=m), AS_PLANNED, seed=0))[-1] for m in (1, 16))
    assert few.events.replanned_steps == 0
    assert few.log_weights.tolist() == many.log_weights.tolist()


class RechargesTheFuture(ParticleFilter):
    """Multiplies the g of the whole queued future into the weights at every step."""

    def step(self, belief, ranges, action, plan, rng):
        belief = super().step(belief, ranges, action, plan, rng)
        for s in range(belief.queue.ahead):
            before, after = belief.queue.at(s), belief.queue.at(s + 1)
            belief = belief.reweighted(self.feasibility.log_g(before, after))
        return belief


class NeverNotices(ParticleFilter):
    _redraw = staticmethod(lambda belief, actions, rng: belief)


class FirstForgotten(PlanEvidence):
    def __call__(self, belief, plan, rng):
        return belief if len(plan) == 4 else super().__call__(belief, plan, rng)


def reading_by(evidence: type[PlanEvidence], **changes) -> ParticleFilter:
    ring = with_plans(2.0)
    return replace(ring, lookahead=evidence(**vars(ring.lookahead) | changes))


@pytest.mark.parametrize(
    ("ring", "meant", "drive"),
    [
        (deq(1.0, RechargesTheFuture), deq(1.0), AS_PLANNED),
        (deq(1.0, NeverNotices), deq(1.0), DRIVES["executed differs"]),
        (reading_by(FirstForgotten), with_plans(2.0), AUTHORS["anew"]),
        (reading_by(PlanEvidence, keep=0.8), with_plans(2.0), AUTHORS["anew"]),
        (with_plans(2.0, steps=3), with_plans(2.0), AUTHORS["anew"]),
        (with_plans(2.0, steps=3), with_plans(2.0, steps=3, new_only=True), AS_PLANNED),
    ],
)
def test_a_wrong_filter_is_caught(ring, meant, drive):
    assert worst(z_scores(ring, drive, 500, meant)) > 5
