"""When the future is redrawn, and by how many pilots; that it is exact: ``test_ring_exactness``."""

from dataclasses import replace

import pytest
from ring_filters import beliefs, deq
from ring_world import AS_PLANNED, CHANGES, Drive, RingMotion


@pytest.mark.parametrize(("drive", "redraws"), [*zip(CHANGES, (1, 1, 0, 2, 3), strict=True)])
def test_a_redraw_is_counted_and_nothing_else_is(drive, redraws):
    last = list(beliefs(deq(1.0, pilots=2), CHANGES[drive], seed=0))[-1]
    assert last.events.replanned_steps == redraws
    assert last.events.weight_collapses == 0


def test_a_plan_that_is_kept_is_never_redrawn_and_draws_nothing_for_it():
    few, many = (list(beliefs(deq(1.0, pilots=m), AS_PLANNED, seed=0))[-1] for m in (1, 16))
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

    ring = replace(deq(1.0, pilots=pilots), motion=Counting())
    drive = Drive((3, 0, 0, 0), ((1, 2, 0, 0), (4, 0, 0), (0, 0), (0,), ()))
    running = beliefs(ring, drive, seed=0)
    next(running)
    assert drawn == [(1, 8), (2, 8)]  # the future of t = 0
    drawn.clear()
    next(running)
    old = [(1, 8 * (pilots - 1)), (2, 8 * (pilots - 1))] if pilots > 1 else []
    assert drawn == [*old, (3, 8 * pilots), (4, 8 * pilots), (0, 8)]  # and the newest state
