"""Looking ahead: what it changes and what it leaves alone; roll-outs bit by bit."""

import math

import numpy as np
import pytest
from following import STILL, follow, same

from deqmcl_gym.maps import Map
from localizers import OdometryMotion
from localizers.inference.futures import (
    RenewedFuture,
    Rollout,
    Sometimes,
    StepByStep,
    WhenResampled,
)
from localizers.inference.queue import Queue
from localizers.models import motion
from localizers.models.plan_sensor import FreeSpace

PAST, BOTH = range(-6, 1), range(-6, 7)


@pytest.mark.parametrize("name", ["deq-mcl-rejuvenated", "mcl-pilots"])
def test_without_lag_it_is_map_based_mcl_and_without_a_plan_its_smoother(make, prior, drive, name):
    looking = follow(make(name, lag=0), prior, drive)
    assert same(looking, follow(make("mcl-map"), prior, drive), offsets=BOTH)
    empty = [np.empty((0, 2))] * 13
    looking = follow(make(name, lag=5), prior, drive, plans=empty)
    smoother = follow(make("mcl-map-smoother", lag=5), prior, drive, plans=empty)
    assert same(looking, smoother, offsets=BOTH)


def test_an_estimate_by_h_has_the_cloud_of_the_map_based_smoother(make, prior, drive):
    looking = follow(make("mcl-pilots", lag=5), prior, drive)
    smoother = follow(make("mcl-map-smoother", lag=5), prior, drive)
    for belief, plain in zip(looking, smoother, strict=True):
        for offset in BOTH:
            points, expected = belief.points(offset), plain.points(offset)
            assert (points is None) == (expected is None)
            assert points is None or np.array_equal(points[0], expected[0])
        assert np.array_equal(belief.log_weights, plain.log_weights)
    assert not same(looking[:-1], smoother[:-1])
    assert same(looking[-1:], smoother[-1:])  # nothing is planned any more


def test_more_pilots_leave_the_cloud_as_it_is_and_of_a_free_map_they_say_nothing(
    make, prior, drive
):
    few, many = (follow(make("mcl-pilots", lag=5, pilots=k), prior, drive)[3] for k in (1, 8))
    assert np.array_equal(few.points()[0], many.points()[0])
    assert not np.array_equal(few.points()[1], many.points()[1])
    free = follow(make("mcl-pilots", lag=5, beta=0.0), prior, drive)
    assert same(free, follow(make("mcl-map-smoother", lag=5, beta=0.0), prior, drive), PAST)


@pytest.fixture
def queued(make, prior, drive):
    """A belief of DEQ-MCL in mid-drive, five steps looked ahead; some futures collide."""
    return follow(make("deq-mcl", lag=5, beta=0.0), prior, drive)[4]


def test_a_move_is_always_accepted_where_nothing_is_charged(robot, queued):
    move = RenewedFuture(Rollout(robot.motion))
    moved = move(queued, None, np.random.default_rng(0))
    for offset in range(1, 6):
        old, new = queued.queue.at(offset), moved.queue.at(offset)
        assert (old != new).any(axis=0).all()


def test_a_move_leaves_weights_present_and_past_as_they_are(robot, room, queued):
    feasibility = FreeSpace(floor_plan=room, radius=8.0, beta=2.0)
    move = RenewedFuture(Rollout(robot.motion, feasibility))
    moved = move(queued, None, np.random.default_rng(0))
    assert moved.log_weights is queued.log_weights
    assert moved.log_evidence == queued.log_evidence
    assert np.array_equal(moved.drawn, queued.drawn)
    for offset in range(-5, 1):
        assert np.array_equal(moved.queue.at(offset), queued.queue.at(offset))


def test_a_moved_future_starts_from_its_own_present(room, robot, queued):
    # Without noise the proposal is the plan rolled out from the particle's present.
    moved = RenewedFuture(Rollout(STILL))(queued, None, np.random.default_rng(0))
    expected = queued.present
    for offset, action in enumerate(queued.drawn, start=1):
        expected = STILL.sample(expected, action, np.random.default_rng(0))
        assert np.array_equal(moved.queue.at(offset), expected)


def test_where_collisions_are_forbidden_a_feasible_future_is_never_lost(room, robot, queued):
    rollout = Rollout(robot.motion, FreeSpace(floor_plan=room, radius=8.0, beta=np.inf))
    before = rollout.queued_log_g(queued)
    moved = RenewedFuture(rollout)(queued, None, np.random.default_rng(0))
    after = rollout.queued_log_g(moved)
    assert (before == 0).any()
    assert (before < 0).any()
    assert (after >= before).all()


def test_a_move_when_resampled_waits_for_it(robot, queued):
    move = WhenResampled(RenewedFuture(Rollout(robot.motion)))
    rng = np.random.default_rng(0)
    assert move(queued, None, rng) is queued
    assert not np.array_equal(move(queued, np.arange(60), rng).head, queued.head)


def test_a_move_of_some_steps_moves_that_share_of_them(robot, queued):
    move = Sometimes(RenewedFuture(Rollout(robot.motion)), 0.3)
    rng = np.random.default_rng(0)
    moved = sum(move(queued, None, rng) is not queued for _ in range(1000))
    assert abs(moved - 300) < 5 * np.sqrt(1000 * 0.3 * 0.7)  # false alarm 6e-7


def test_the_forms_of_moving_differ(make, prior, drive):
    ends = [
        follow(make("deq-mcl-rejuvenated", lag=5, ess_threshold=0.5, moves=moves), prior, drive)[-1]
        for moves in ("always", "resampled", "third")
    ]
    ends.append(follow(make("deq-mcl", lag=5, ess_threshold=0.5), prior, drive)[-1])
    clouds = {end.points()[0].tobytes() for end in ends}
    assert len(clouds) == 4


RNG = np.random.default_rng
MOTION = OdometryMotion(drive=0.2, turn=0.2, drift=0.02)
PLAN = np.array([(5.0, 0.1), (0.0, -0.26), (5.0, 0.26), (40.0, 0.0), (-5.0, 3.0), (1e7, 0.0)])


def cloud(n: int) -> np.ndarray:
    return RNG(1).uniform((-20, -20, -3), (370, 320, 3), (n, 3)).T.astype(np.float32).copy()


@pytest.mark.parametrize("beta", [0.0, 0.1, 10.0, math.inf])
@pytest.mark.parametrize(("n", "wide"), [(1, 2000), (63, 2000), (1500, 2000), (4000, 1500)])
def test_a_walk_in_one_pass_has_the_bits_of_one_step_after_the_other(
    room, beta, n, wide, monkeypatch
):
    monkeypatch.setattr(motion, "_DRAWS", 6000)  # 1,500 poses are drawn two steps at a time,
    monkeypatch.setattr(motion, "_WIDE", wide)  # and 4,000 driven in three parts
    walls = FreeSpace(floor_plan=room, radius=8.0, beta=beta)
    rngs = RNG(2), RNG(2)
    paths, log_g = walls.walk(MOTION)(cloud(n), PLAN, rngs[0], keep=True)
    plain_paths, plain_log_g = StepByStep(MOTION, walls)(cloud(n), PLAN, rngs[1], keep=True)
    for asked in (np.arange(n), RNG(3).integers(0, n, 5)):
        assert np.array_equal(paths(asked), plain_paths(asked))
    assert log_g.tobytes() == plain_log_g.tobytes()
    assert rngs[0].bit_generator.state == rngs[1].bit_generator.state
    none, alone = walls.walk(MOTION)(cloud(n), PLAN, RNG(2), keep=False)
    assert none(np.arange(n)) == []
    assert alone.tobytes() == log_g.tobytes()


def test_no_step_is_no_path_and_no_charge(room):
    rollout = Rollout(MOTION, FreeSpace(floor_plan=room, radius=8.0))
    paths, log_g = rollout.futures(cloud(5), PLAN[:0], 3, RNG(0))
    assert paths(np.zeros(5, int)) == []
    assert np.array_equal(log_g, np.zeros((3, 5)))


def test_parts_of_ones_own_are_asked_step_by_step(room):
    class Straight:
        def sample(self, states, action, rng):
            return states

    class Solid(Map):
        def collides(self, starts, ends, radius):
            return np.full(len(ends), True)

    walls = FreeSpace(floor_plan=room, radius=8.0)
    assert walls.walk(Straight()) is None
    paths, _ = Rollout(Straight(), walls).futures(cloud(5), PLAN, 1, RNG(0))
    assert np.array_equal(paths(np.zeros(5, int))[-1], cloud(5))
    walls = FreeSpace(floor_plan=Solid(), radius=8.0, beta=2.0)
    _, log_g = Rollout(MOTION, walls).futures(cloud(5), PLAN, 1, RNG(0))
    assert np.array_equal(log_g, np.full((1, 5), -2.0 * len(PLAN)))


def test_the_states_of_a_queue_from_a_step_on_are_those_at_each():
    rng = RNG(0)
    queue = Queue((cloud(20),))
    for step in range(6):
        queue = queue.resampled(rng.integers(0, 20, 20)).appended(cloud(20) + np.float32(step))
    queue = queue.stepped(1).resampled(rng.integers(0, 20, 20))
    for offset in range(queue.ahead + 1):
        each = [queue.at(k) for k in range(offset, queue.ahead + 1)]
        assert np.array_equal(queue.since(offset), each)


@pytest.mark.parametrize("beta", [0.0, 2.0, math.inf])
@pytest.mark.parametrize("radius", [0.0, 5.0, 20.0])
def test_a_step_whose_swept_disc_collides_is_charged_beta_and_a_free_one_nothing(
    room, beta, radius
):
    rng = np.random.default_rng(1)
    before = rng.uniform((0, 0, -3), (350, 300, 3), (2000, 3)).astype(np.float32).T
    after = before + rng.normal(0, 15, (3, 2000)).astype(np.float32)
    log_g = FreeSpace(floor_plan=room, radius=radius, beta=beta).log_g(before, after)
    collides = room.collides(before.T, after.T, radius)
    assert 0.1 < collides.mean() < 0.9
    assert log_g.dtype == np.float64
    assert np.array_equal(log_g, np.where(collides, -beta, 0.0))
