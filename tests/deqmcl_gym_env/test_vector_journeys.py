"""Many rooms with routes, drivers and offices say what as many single environments say."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from refusals import refused
from room_cases import FLOOR_PLANS, ROOM_ID, SMALL
from side_by_side import assert_same, both, run_beside

from deqmcl_gym.envs.vector import RoomVectorEnv

JOURNEY = "deqmcl_gym/Journey-v1"
OFFICES = {"office": SMALL | {"seeds": [0, 1000]}}
SHORT = {"floor_plan": OFFICES, "route": {"min_length": 4.0, "max_length": 12.0}}
ROUGH = {"noise": {"drive": 0.3, "turn": 0.3, "drift": 0.2}}
WORLDS = [
    {"driver": "none", "observation": "scan"},
    {"plan": False, "goal": "relative"},
    {"ends_at_goal": False},
    {"lidar": {"mounting": (0.1, 0.05)}},
    {"clutter": {"number": 3}},
    {"clutter": {"number": 3, "keep_route": False}},
    {"changed_walls": {"share": 0.2, "keep_route": False}},
]
GUIDED, AMONG = "deqmcl_gym/Guided-v0", {"route": {}, "driver": {}, "horizon": 9}
# id, rooms, mode, world; steps, share of planned actions, seed; least contacts and ends.
# Among polygons pymunk's contacts and those of the kernel differ by some 1e-13 px (record 0022),
# which may round to another float32 in plans and scans: without a contact both move by one kernel.
DRIVES = [
    *((JOURNEY, 3, mode, SHORT, (200, 1.0, seed), (0, 3))
      for mode in ("NextStep", "SameStep", "Disabled") for seed in (0, 7)),
    (JOURNEY, 2, "NextStep", ROUGH, (60, 0.9, 4), (0, 0)),
    (JOURNEY, 3, "NextStep", SHORT | ROUGH, (500, 0.4, 1), (21, 1)),  # a shaken driver
    *((JOURNEY, 2, "SameStep", SHORT | ROUGH | world, (120, 0.8, 2), (0, 0)) for world in WORLDS),
    *((GUIDED, 4, mode, {}, (300, 1.0, 3), (0, 4)) for mode in ("NextStep", "SameStep")),
    (ROOM_ID, 3, "NextStep", AMONG | {"floor_plan": FLOOR_PLANS["paper"]}, (120, 1.0, 3), (0, 0)),
]  # fmt: skip


@pytest.mark.parametrize(("name", "rooms", "mode", "world", "run", "least"), DRIVES, ids=str)
def test_rooms_agree_bit_for_bit_into_the_next_episodes(name, rooms, mode, world, run, least):
    native, loop = both(name, rooms, mode, **world)
    assert isinstance(native, RoomVectorEnv)
    contacts, ends = run_beside((native, loop), *run)
    assert (contacts >= least[0]) & (ends >= least[1])
    assert contacts == 0 or name == JOURNEY
    plans = native.floor_plans
    if "floor_plan" in world and name == JOURNEY:  # each in another office
        assert len({id(plan) for plan in plans}) == rooms
        assert [plan.digest for plan in plans] == [e.unwrapped.floor_plan.digest for e in loop.envs]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize(
    ("name", "world"), [(JOURNEY, SHORT), ("deqmcl_gym/Guided-v0", {}), (ROOM_ID, {})]
)
def test_running_rooms_go_on_as_their_copy_does(name, world, copied):
    envs = gym.make_vec(name, num_envs=2, **world)
    _, info = envs.reset(seed=3)
    for _ in range(5):
        *_, info = envs.step(info["planned_actions"][:, 0])
    twin = copied(envs)
    for _ in range(100):
        actions = info["planned_actions"][:, 0]
        said = envs.step(actions)
        assert_same(twin.step(actions), said)
        info = said[4]


def test_rooms_with_routes_have_a_course_each():
    envs = gym.make_vec(JOURNEY, num_envs=2, **SHORT)
    with pytest.raises(RuntimeError, match="call reset"):
        _ = envs.courses
    seen, _ = envs.reset(seed=0)
    np.testing.assert_equal(np.float32([course.goal for course in envs.courses]), seen["goal"])


def test_journeys_have_a_time_limit_only_if_one_is_given():
    envs = gym.make_vec(JOURNEY, num_envs=2, max_episode_steps=3, **SHORT)
    envs.reset(seed=0)
    ends = [envs.step(np.zeros((2, 2), np.float32))[3].all() for _ in range(3)]
    assert ends == [False, False, True]


def test_an_episode_that_cannot_begin_leaves_all_rooms_as_they_are():
    world = SHORT | {"start": {"sd_position": 1e6}}  # no drawn start is free
    envs = gym.make_vec(JOURNEY, num_envs=2, **world)
    with refused("starts drawn"):
        envs.reset(seed=0)
    assert envs.np_random_seed == (None, None)
