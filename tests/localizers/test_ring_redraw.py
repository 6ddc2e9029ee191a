"""The redraw rule is exact: with it the target is γ_t of the new plan, for every number of pilots.

z-tests as in test_ring_exactness, at most 80 per case, |z| > 5 fails: 2e-4 for the three of the
default run together. "everything" holds each kind of change; one kind at a time: slow.
"""

from dataclasses import replace

import pytest
from ring_world import (
    FUTURE,
    PAST,
    RESAMPLING,
    Drive,
    RingMotion,
    beliefs,
    ring_filter,
    worst,
    z_scores,
)

DRIVES = {
    "executed differs": Drive((1, 2, 2, 1), ((1, 1, 2, 1), (1, 2, 1), (2, 1), (1,), ())),
    "queued step changes": Drive((1, 2, 2, 1), ((1, 1, 2, 1), (2, 2, 1), (2, 1), (1,), ())),
    "plan grows": Drive((1, 1, 2, 1), ((), (1,), (2, 1), (1,), ())),
    "plan is cut short": Drive((1, 1, 2, 1), ((1, 1, 2, 1), (), (2, 1), (), ())),
    # executed differs and the plan grows at 1; a queued step changes and the plan grows at 2;
    # executed differs and the plan is cut short at 3
    "everything": Drive((2, 1, 0, 1), ((1,), (1, 0), (2, 1), (), ())),
}
REDRAWS = {  # updates at which the future is redrawn
    "executed differs": 1,
    "queued step changes": 1,
    "plan grows": 0,
    "plan is cut short": 2,
    "everything": 3,
}


def deq(pilots: int, strategy: str = "always", beta: float = 1.0):
    return ring_filter(
        beta, past=PAST, future=FUTURE, pilots=pilots, resampling=RESAMPLING[strategy]
    )


@pytest.mark.parametrize(
    ("drive", "pilots", "strategy"),
    [
        ("everything", 1, "always"),
        ("everything", 2, "when degenerate"),
        ("everything", 16, "always"),
    ],
)
def test_after_a_redraw_the_target_is_gamma_of_the_new_plan(drive, pilots, strategy):
    ring = deq(pilots, strategy)
    assert worst(z_scores(ring, DRIVES[drive], 1.0, replicates=2_000)) < 5


@pytest.mark.slow
@pytest.mark.parametrize(("strategy", "beta"), [("always", 2.0), ("when degenerate", 1.0)])
@pytest.mark.parametrize("pilots", [1, 2, 16])
@pytest.mark.parametrize("drive", DRIVES)
def test_after_a_redraw_the_target_is_gamma_at_10_000_replicates(drive, pilots, strategy, beta):
    ring = deq(pilots, strategy, beta)
    assert worst(z_scores(ring, DRIVES[drive], beta, replicates=10_000)) < 5


@pytest.mark.parametrize("drive", DRIVES)
def test_a_redraw_is_counted_and_nothing_else_is(drive):
    last = list(beliefs(deq(2), DRIVES[drive], seed=0))[-1]
    assert last.events.replanned_steps == REDRAWS[drive]
    assert last.events.weight_collapses == 0


def test_a_plan_that_is_kept_is_never_redrawn_and_draws_nothing_for_it():
    drive = Drive.as_planned(1, 1, 2, 1)
    few, many = (list(beliefs(deq(pilots), drive, seed=0))[-1] for pilots in (1, 16))
    assert few.events.replanned_steps == 0
    assert few.log_weights.tolist() == many.log_weights.tolist()


@pytest.mark.parametrize("pilots", [1, 2, 16])
def test_a_redraw_rolls_out_one_pilot_less_of_the_old_plan_than_of_the_new(pilots):
    # The particle's own old future is the M-th: M = 1 needs no fresh rollout of the old plan.
    drawn = []

    class Counting(RingMotion):
        def sample(self, states, action, rng):
            drawn.append((action[0], states.shape[1]))
            return super().sample(states, action, rng)

    ring = replace(deq(pilots), motion=Counting())
    drive = Drive((3, 0, 0, 0), ((1, 2, 0, 0), (4, 0, 0), (0, 0), (0,), ()))
    running = beliefs(ring, drive, seed=0)
    next(running)
    assert drawn == [(1, 8), (2, 8)]  # the future of t = 0
    drawn.clear()
    next(running)
    old = [(1, 8 * (pilots - 1)), (2, 8 * (pilots - 1))] if pilots > 1 else []
    assert drawn == [*old, (3, 8 * pilots), (4, 8 * pilots), (0, 8)]  # and the newest state
