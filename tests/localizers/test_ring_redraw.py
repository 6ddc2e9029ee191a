"""The redraw rule is exact: with it the target is γ_t of the new plan, for every number of pilots.

z-tests as in test_ring_exactness, 80 per case, |z| > 5 fails: 3e-4 for the six cases together.
"""

import pytest
from ring_world import FUTURE, PAST, RESAMPLING, Drive, beliefs, ring_filter, worst, z_scores

DRIVES = {
    "executed differs": Drive((1, 2, 2, 1), ((1, 1, 2, 1), (1, 2, 1), (2, 1), (1,), ())),
    "queued step changes": Drive((1, 2, 2, 1), ((1, 1, 2, 1), (2, 2, 1), (2, 1), (1,), ())),
    "plan grows": Drive((1, 1, 2, 1), ((), (1,), (2, 1), (1,), ())),
    "plan is cut short": Drive((1, 1, 2, 1), ((1, 1, 2, 1), (), (2, 1), (), ())),
    # executed differs at 1, a queued step at 2, executed differs and the plan ends at 3
    "everything": Drive((2, 1, 0, 1), ((1, 1, 2, 1), (1, 0, 1), (2, 1), (), ())),
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
        ("executed differs", 2, "always"),
        ("queued step changes", 1, "when degenerate"),
        ("plan grows", 2, "always"),
        ("plan is cut short", 16, "when degenerate"),
        ("everything", 1, "always"),
        ("everything", 16, "when degenerate"),
    ],
)
def test_after_a_redraw_the_target_is_gamma_of_the_new_plan(drive, pilots, strategy):
    ring = deq(pilots, strategy)
    assert worst(z_scores(ring, DRIVES[drive], 1.0, replicates=4_000)) < 5


@pytest.mark.slow
@pytest.mark.parametrize("beta", [1.0, 2.0])
@pytest.mark.parametrize("strategy", RESAMPLING)
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


def test_the_ess_after_the_latest_redraw_is_reported():
    before, *_, last = beliefs(deq(2), DRIVES["everything"], seed=0)
    assert before.redraw_ess != before.redraw_ess  # NaN: none yet
    assert 1 <= last.redraw_ess <= 8
