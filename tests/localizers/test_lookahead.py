"""Looking ahead: what it changes and what it leaves alone; roll-outs bit by bit."""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from following import STILL, follow, same

from deqmcl_gym.maps import Map
from localizers import OdometryMotion
from localizers.inference.futures import Rollout
from localizers.inference.hedge import hedged
from localizers.models.feasibility import CostMap

PAST, BOTH = range(-6, 1), range(-6, 7)
RNG = np.random.default_rng
MOTION = OdometryMotion(drive=0.2, turn=0.2, drift=0.02)
PLAN = np.array([(5.0, 0.1), (0.0, -0.26), (5.0, 0.26), (40.0, 0.0), (-5.0, 3.0), (1e7, 0.0)])


@pytest.mark.parametrize("evidence", ["plan", "future"])
def test_without_lag_it_is_mcl_map_and_without_a_plan_its_smoother(make, prior, drive, evidence):
    make_fresh = partial(make, "deq-mcl-fresh", evidence=evidence)
    looking = follow(make_fresh(lag=0), prior, drive)
    assert same(looking, follow(make("mcl-map"), prior, drive), offsets=BOTH)
    empty = [np.empty((0, 2))] * 13
    looking = follow(make_fresh(lag=5), prior, drive, plans=empty)
    smoother = follow(make("mcl-map-smoother", lag=5), prior, drive, plans=empty)
    assert same(looking, smoother, offsets=BOTH)


def test_an_estimate_by_h_has_the_cloud_of_the_map_based_smoother(make, prior, drive):
    looking = follow(make("deq-mcl-fresh", lag=5), prior, drive)
    smoother = follow(make("mcl-map-smoother", lag=5), prior, drive)
    for belief, plain in zip(looking, smoother, strict=True):
        for offset in PAST:
            points, expected = belief.points(offset), plain.points(offset)
            assert (points is None) == (expected is None)
            assert points is None or np.array_equal(points[0], expected[0])
        assert np.array_equal(belief.log_weights, plain.log_weights)
    assert not same(looking[:-1], smoother[:-1])
    assert same(looking[-1:], smoother[-1:])  # nothing is planned any more


def test_more_pilots_leave_the_cloud_as_it_is_and_tell_nothing_of_a_free_map(make, prior, drive):
    few, many = (follow(make("deq-mcl-fresh", lag=5, pilots=k), prior, drive)[3] for k in (1, 8))
    assert np.array_equal(few.points()[0], many.points()[0])
    assert not np.array_equal(few.points()[1], many.points()[1])
    free = follow(make("deq-mcl-fresh", lag=5, beta=0.0), prior, drive)
    assert same(free, follow(make("mcl-smoother", lag=5), prior, drive), PAST)
    assert same(free, follow(make("mcl-map-smoother", lag=5, beta=0.0), prior, drive), PAST)


def test_a_future_drawn_anew_changes_no_weight_and_no_present(make, prior, drive):
    looking = follow(make("deq-mcl-fresh", evidence="plan", lag=5, charge="always"), prior, drive)
    plain = follow(make("mcl-plan", lag=5), prior, drive)
    assert same(looking, plain, PAST)
    assert all(belief.points(1) is None for belief in plain)
    ahead = [sum(belief.points(k) is not None for k in range(1, 7)) for belief in looking[-7:]]
    assert ahead == [5, 5, 4, 3, 2, 1, 0]


def test_a_drawn_future_starts_from_its_own_present_and_follows_the_plan():
    # Without noise it is the plan rolled out from each particle's present.
    present = cloud(30)
    path, _ = Rollout(STILL).one(present, PLAN[:3], 4, RNG(0))
    expected = present
    for states, action in zip(path, PLAN[:3], strict=True):
        expected = STILL.sample(expected, action, RNG(0))
        assert np.array_equal(states, expected)


def test_where_collisions_are_forbidden_a_feasible_roll_out_is_kept_if_there_is_one(room):
    walls = CostMap(floor_plan=room, radius=8.0, beta=np.inf)
    present = cloud(200)
    path, log_h = Rollout(MOTION, walls).one(present, PLAN[:3], 8, RNG(0))
    kept = sum(walls.log_g(a, b) for a, b in pairwise([present, *path]))
    possible = np.isfinite(log_h)
    assert 0 < possible.sum() < 200
    np.testing.assert_array_equal(np.isfinite(kept), possible)


def test_a_hedge_looks_ahead_if_its_advised_member_does(make, robot, prior, drive):
    def member(name, **params):
        return make(name, lag=5, **params)

    fresh = member("deq-mcl-fresh", evidence="plan", keep=0.0, charge="always")
    ahead = follow(hedged(robot, fresh, member("mcl-map-smoother")), prior, drive)
    blind = member("mcl-plan", keep=0.0), member("mcl-map-smoother")
    plain = follow(hedged(robot, *blind), prior, drive)
    assert same(ahead, plain, PAST)
    assert plain[3].points(5) is None
    for belief in ahead[:8]:
        members = belief.advised.points(5), belief.protected.points(5)
        poses, weights = belief.points(5)
        assert np.array_equal(poses, np.concatenate([poses for poses, _ in members]))
        assert np.array_equal(weights, belief.points()[1])


def cloud(n: int) -> np.ndarray:
    return RNG(1).uniform((-20, -20, -3), (370, 320, 3), (n, 3)).T.astype(np.float32).copy()


def test_parts_of_ones_own_are_asked_step_by_step(room):
    class Straight:
        def sample(self, states, action, rng):
            return states

    class Solid(Map):
        def collides(self, starts, ends, radius):
            return np.full(len(ends), True)

    walls = CostMap(floor_plan=room, radius=8.0)
    path, _ = Rollout(Straight(), walls).futures(cloud(5), PLAN, 1, RNG(0))
    assert np.array_equal(path[-1], cloud(5))
    walls = CostMap(floor_plan=Solid(), radius=8.0, beta=2.0)
    _, log_g = Rollout(MOTION, walls).futures(cloud(5), PLAN, 1, RNG(0))
    assert np.array_equal(log_g, np.full((1, 5), -2.0 * len(PLAN)))
