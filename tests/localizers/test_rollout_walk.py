"""What a step is charged; roll-outs in one pass against one step after the other, bit by bit."""

import math

import numpy as np
import pytest

from deqmcl_gym.maps import Map
from localizers import OdometryMotion
from localizers.inference.futures import Rollout, StepByStep
from localizers.inference.queue import Queue
from localizers.models import motion
from localizers.models.plan_sensor import FreeSpace

RNG = np.random.default_rng
MOTION = OdometryMotion(drive=0.2, turn=0.2, drift=0.02)
PLAN = np.array([(5.0, 0.1), (0.0, -0.26), (5.0, 0.26), (40.0, 0.0), (-5.0, 3.0), (1e7, 0.0)])


def cloud(n: int) -> np.ndarray:
    return RNG(1).uniform((-20, -20, -3), (370, 320, 3), (n, 3)).T.astype(np.float32).copy()


@pytest.mark.parametrize("beta", [0.0, 0.1, 10.0, math.inf])
@pytest.mark.parametrize("n", [1, 63, 1500])
def test_a_walk_in_one_pass_has_the_bits_of_one_step_after_the_other(room, beta, n, monkeypatch):
    monkeypatch.setattr(motion, "_DRAWS", 6000)  # 1,500 poses are drawn two steps at a time
    walls = FreeSpace(floor_plan=room, radius=8.0, beta=beta)
    rngs = RNG(2), RNG(2)
    path, log_g = walls.walk(MOTION)(cloud(n), PLAN, rngs[0], keep=True)
    plain_path, plain_log_g = StepByStep(MOTION, walls)(cloud(n), PLAN, rngs[1], keep=True)
    assert np.array_equal(path, plain_path)
    assert log_g.tobytes() == plain_log_g.tobytes()
    assert rngs[0].bit_generator.state == rngs[1].bit_generator.state
    none, alone = walls.walk(MOTION)(cloud(n), PLAN, RNG(2), keep=False)
    assert none == []
    assert alone.tobytes() == log_g.tobytes()


def test_no_step_is_no_path_and_no_charge(room):
    rollout = Rollout(MOTION, FreeSpace(floor_plan=room, radius=8.0))
    paths, log_g = rollout.futures(cloud(5), PLAN[:0], 3, RNG(0))
    assert paths == []
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
    assert np.array_equal(paths[-1][:, 0], cloud(5))
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
