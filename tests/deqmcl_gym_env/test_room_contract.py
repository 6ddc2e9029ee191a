"""RoomEnv keeps Gymnasium's contract: import, registration, checker, specs, vector envs."""

import subprocess
import sys
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from room_cases import STILL
from room_trace import ROOM_ID

import deqmcl_gym
from deqmcl_gym import PRESETS
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.envs.vector import RoomVectorEnv
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.config import WORLDS as WORLDS_BY_NAME

MAKE = 'assert gymnasium.make("deqmcl_gym/Room-v0").reset(seed=1)[1]["planned_count"] == 204'
FIRST_CALL = "numba.core.typing.cffi_utils"  # which the first call of a kernel loads
MANY = 'gymnasium.make_vec("deqmcl_gym:deqmcl_gym/Room-v0", num_envs=2, vectorization_mode="{}")'


def run(code: str) -> None:
    subprocess.run([sys.executable, "-W", "error::UserWarning", "-c", code], check=True)


def test_what_is_not_needed_is_not_loaded():
    unused = "seen = set(sys.modules) & {}; assert not seen, seen".format
    steps = [
        "import sys, deqmcl_gym.maps",
        unused({"gymnasium", "pymunk", "cv2", "benchmarks", "localizers", FIRST_CALL}),
        "import localizers; localizers.names()",
        unused({"gymnasium", "pymunk", "cv2", "benchmarks"}),
        f"import gymnasium; {MANY.format('vector_entry_point')}",
        unused({"pymunk"}),
    ]
    run("; ".join(steps))


@pytest.mark.parametrize(
    "code",
    [
        f"import gymnasium, deqmcl_gym; {MAKE}",
        f"import localizers, gymnasium; {MAKE}",
        f"import gymnasium; {MANY.format('sync')}.reset(seed=1)",
    ],
)
def test_the_id_is_known_in_whatever_order_things_are_imported(code):
    run(code)


@pytest.mark.parametrize("preset", WORLDS_BY_NAME)
def test_each_preset_has_an_id_of_its_own_for_one_room_and_for_many(preset):
    assert tuple(WORLDS_BY_NAME) == PRESETS
    name = f"deqmcl_gym/{preset.capitalize()}-v0"
    env, same = gym.make(name), RoomEnv(preset=preset)
    assert env.unwrapped.world == same.world
    np.testing.assert_equal(env.reset(seed=3), same.reset(seed=3))
    assert isinstance(gym.make_vec(name, num_envs=2), RoomVectorEnv)


def test_a_world_can_be_given_whole_and_changed_in_part():
    world = WORLDS_BY_NAME["guided"].changed(lidar={"beams": 5})
    env = RoomEnv(world=world, noise={"drive": 0.3})
    assert env.world == world.changed(noise={"drive": 0.3})
    with pytest.raises(InputError, match="world is 'guided', but must be a World"):
        RoomEnv(world="guided")


@pytest.mark.parametrize("make", [gym.make, partial(gym.make_vec, num_envs=2)])
def test_an_unknown_argument_is_refused_with_the_nearest_one(make):
    with pytest.raises(InputError, match="keyword argument 'lidr': did you mean 'lidar'"):
        make("deqmcl_gym/Sharp-v0", lidr=1)


def test_a_dict_shows_the_plan_the_share_of_the_lap_and_of_the_time():
    env = RoomEnv(preset="sharp", observation="dict", horizon=4, noise=STILL)
    for _ in range(2):
        seen, info = env.reset(seed=0)
        for step in range(20):
            assert env.observation_space.contains(seen)
            np.testing.assert_array_equal(seen["plan"], info["planned_actions"])
            assert seen["progress"] == pytest.approx(5 * step / 900)
            assert seen["clock"] == pytest.approx(step / 204)
            seen, *_, info = env.step(env.plan[step])
    plain = RoomEnv(preset="sharp", noise=STILL)
    np.testing.assert_array_equal(env.reset(seed=7)[0]["scan"], plain.reset(seed=7)[0])


def test_a_journey_may_be_longer_than_the_limit_of_the_room():
    route = {"min_length": 45.0}  # m: 450 drives of 0.1 m
    env = gym.make("deqmcl_gym/Journey-v1", route=route, driver="none")
    cut = gym.make(deqmcl_gym.ENV_ID, floor_plan={"office": {}}, route=route)
    assert env.spec.max_episode_steps is None
    env.reset(seed=0)
    cut.reset(seed=0)
    planned = len(env.unwrapped.plan)
    assert planned > 450
    stand = np.zeros(2, np.float32)
    said = [env.step(stand)[2:4] for _ in range(planned)]
    assert said == [(False, False)] * (planned - 1) + [(False, True)]
    assert [cut.step(stand)[3] for _ in range(408)] == [False] * 407 + [True]


def test_spaces_are_the_documented_boxes():
    env = RoomEnv(lidar={"beams": 4, "max_range": 123.0}, robot={"max_turn": 0.5})
    assert env.observation_space == gym.spaces.Box(0.0, 123.0, (4,), np.float32)
    low, high = np.float32([0, -0.5]), np.float32([10, 0.5])
    assert env.action_space == gym.spaces.Box(low, high, dtype=np.float32)


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_rooms_in_processes_of_their_own_say_what_rooms_in_this_one_say(context):
    kwargs = {"num_envs": 2, "horizon": 20}
    own = {"vectorization_mode": "async", "vector_kwargs": {"context": context}}
    away = gym.make_vec(ROOM_ID, **own, **kwargs)
    here = gym.make_vec(ROOM_ID, vectorization_mode="sync", **kwargs)
    actions = np.float32([(5.0, 0.0), (2.0, 0.3)])
    try:
        np.testing.assert_equal(away.reset(seed=11), here.reset(seed=11))
        for _ in range(5):
            np.testing.assert_equal(away.step(actions), here.step(actions))
    finally:
        away.close()
