"""The queue by ancestry, and what it holds: L states back, min(L, what is planned) ahead."""

import numpy as np
import pytest
from following import follow

import localizers
from localizers.inference.belief import Queue
from localizers.models.motion import increments

T = 12


@pytest.mark.parametrize("seed", range(20))
def test_a_random_program_gives_the_states_of_a_list_that_is_copied_as_a_whole(seed):
    rng = np.random.default_rng(seed)
    n, past = int(rng.integers(1, 9)), int(rng.integers(0, 6))
    states, present = [rng.integers(0, 10**9, (2, n))], 0  # every state tells its origin
    queue = Queue((states[0],))
    for _ in range(120):
        move = rng.choice(["resample", "append", "step", "cut"], p=[0.35, 0.3, 0.25, 0.1])
        if move == "resample":
            ancestors = np.sort(rng.integers(0, n, n))
            queue, states = queue.resampled(ancestors), [one[:, ancestors] for one in states]
        elif move == "append" and queue.ahead < 8:
            states.append(rng.integers(0, 10**9, (2, n)))
            queue = queue.appended(states[-1])
        elif move == "step" and queue.ahead:
            queue, drop = queue.stepped(past), max(present + 1 - past, 0)
            states, present = states[drop:], present + 1 - drop
        elif move == "cut" and queue.ahead:
            keep = int(rng.integers(0, queue.ahead + 1))
            queue, states = queue.cut(keep), states[: present + keep + 1]
        assert queue.ahead == len(states) - 1 - present
        held = dict(enumerate(states, -present))
        for offset in range(-12, 13):
            np.testing.assert_equal(queue.at(offset), held.get(offset))
        for offset in range(queue.ahead + 1):
            assert np.array_equal(queue.since(offset), states[present + offset :])


def test_an_older_queue_stays_right_whatever_is_made_of_it_or_written_into_its_states():
    start = np.random.default_rng(1).integers(0, 99, (1, 4))
    queue = Queue((start.copy(),)).appended(start + 100)
    resampled = queue.resampled(np.array([3, 3, 3, 3]))
    resampled.appended(start).stepped(0).cut(0)
    for offset in (0, 1):
        queue.at(offset)[:] = resampled.at(offset)[:] = 777
        assert np.array_equal(queue.at(offset), start + 100 * offset)
        assert (resampled.at(offset) == start[0, 3] + 100 * offset).all()


def held(belief, reach: int = 30) -> list[int]:
    return [offset for offset in range(-reach, reach + 1) if belief.points(offset) is not None]


def deq(robot, lag: int, **params):
    return localizers.make("deq-mcl", robot, particles=20, lag=lag, **params)


@pytest.mark.parametrize("lag", [0, 1, 3, 12, 25])
def test_the_queue_holds_lag_states_to_either_side_as_far_as_they_exist(robot, prior, drive, lag):
    for t, belief in enumerate(follow(deq(robot, lag), prior, drive)):
        assert held(belief) == list(range(-min(lag, t), min(lag, T - t) + 1))


@pytest.mark.parametrize("empty", [[], np.empty(0), [[]]])
def test_an_empty_plan_may_come_in_any_shape(robot, prior, drive, empty):
    localizer = deq(robot, 3)
    assert held(localizer.reset(prior, empty, np.random.default_rng(0))) == [0]
    assert held(localizer.update(drive[1][0], drive[0][0], empty)) == [-1, 0]


@pytest.mark.parametrize("horizon", [0, 1, 2, 4])
def test_a_plan_shorter_than_the_lag_shrinks_the_window(robot, prior, drive, horizon):
    actions, _ = drive
    plans = [actions[t : t + horizon] for t in range(T + 1)]
    beliefs = follow(deq(robot, 5), prior, drive, plans=plans)
    for t, belief in enumerate(beliefs):
        assert held(belief) == list(range(-min(5, t), min(horizon, T - t) + 1))
    assert beliefs[-1].events.replanned_steps == 0  # it ends earlier and grows by itself


def test_a_plan_that_is_cut_and_grows_again_is_followed_and_the_cut_is_counted(robot, prior, drive):
    actions, _ = drive
    plans = [actions[t:] for t in range(T + 1)]
    plans[4], plans[5] = actions[4:5], actions[5:5]
    beliefs = follow(deq(robot, 5), prior, drive, plans=plans)
    assert [held(belief)[-1] for belief in beliefs] == [5, 5, 5, 5, 1, 0, 5, 5, 4, 3, 2, 1, 0]
    # at 4 four queued steps are dropped; at 5 the queue has no more than was carried out
    assert [belief.events.replanned_steps for belief in beliefs] == [0] * 4 + [1] * 9


@pytest.mark.parametrize("change", [0, 1, 3])
def test_a_changed_action_is_redrawn_and_steps_before_it_are_kept(robot, prior, drive, change):
    # At t = 5 the action ``change`` steps on becomes another one; 0: the one carried out.
    actions, scans = drive
    driven = actions.copy()
    driven[4 + change] += (0.0, 0.05)
    plans = [actions[t:] if t < 5 else driven[t:] for t in range(T + 1)]
    changed = follow(deq(robot, 4, beta=1.0), prior, (driven, scans), plans=plans)
    assert [belief.events.replanned_steps for belief in changed] == [0] * 5 + [1] * 8
    for belief in changed:
        assert belief.drawn.shape[0] == held(belief)[-1]
    after = changed[5]
    assert np.array_equal(after.drawn, increments(driven[5:9]))
    # The steps that both plans share are those of the run without a change.
    kept = follow(deq(robot, 4, beta=1.0), prior, drive)[5]
    for offset in range(-4, 5):
        equal = np.array_equal(after.points(offset)[0], kept.points(offset)[0])
        assert equal == (offset < change)
