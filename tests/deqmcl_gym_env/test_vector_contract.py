"""RoomVectorEnv keeps Gymnasium's contract for vector envs, and refuses what RoomEnv refuses."""

import json

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from room_trace import ROOM_ID

from deqmcl_gym.envs.vector import RoomVectorEnv
from deqmcl_gym.validation import InputError

FORWARD = np.float32([5.0, 0.0])


def rooms(number: int = 3, **kwargs) -> RoomVectorEnv:
    """A native vector env, begun with seed 0."""
    env = gym.make_vec(ROOM_ID, num_envs=number, **kwargs)
    env.reset(seed=0)
    return env


def forward(number: int = 3) -> np.ndarray:
    return np.tile(FORWARD, (number, 1))


def test_make_vec_makes_the_native_env_and_says_how_it_resets():
    env = gym.make_vec(ROOM_ID, num_envs=3)
    assert isinstance(env, RoomVectorEnv)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert "autoreset_mode" not in RoomVectorEnv.metadata  # two modes can live side by side


def test_spaces_are_those_of_single_rooms_in_a_batch():
    env = rooms(lidar={"beams": 4})
    single = gym.make(ROOM_ID, lidar={"beams": 4})
    assert env.single_observation_space == single.observation_space
    assert env.single_action_space == single.action_space
    assert (env.observation_space.shape, env.action_space.shape) == ((3, 4), (3, 2))


def test_a_spec_with_json_kwargs_makes_the_same_env_again():
    first = rooms(2, preset="sharp", lidar={"beams": 4}, horizon=7, autoreset_mode="SameStep")
    second = gym.make_vec(EnvSpec.from_json(first.spec.to_json()))
    assert json.loads(first.spec.to_json())["kwargs"]["num_envs"] == 2
    assert second.world == first.world
    assert second.metadata == first.metadata
    np.testing.assert_equal(second.reset(seed=3), first.reset(seed=3))


def test_what_was_returned_does_not_change_later_and_may_be_written_to():
    env, untouched = rooms(), rooms()
    kept = []
    for _ in range(5):
        said = env.step(forward())
        kept.append((said, untouched.step(forward())))
        for values in (said[0], *said[4].values()):
            assert values.flags.owndata or values.base.flags.owndata
    for ours, same in kept:
        np.testing.assert_equal(ours, same)
    for values in (*said[:4], *said[4].values()):
        values[...] = 0
    np.testing.assert_equal(env.step(forward()), untouched.step(forward()))


def test_a_room_says_the_same_whatever_its_neighbours():
    alone, many = gym.make_vec(ROOM_ID, num_envs=1), gym.make_vec(ROOM_ID, num_envs=70)
    np.testing.assert_equal(alone.reset(seed=[66])[0][0], many.reset(seed=0)[0][66])
    for _ in range(100):
        one, same = alone.step(forward(1)), many.step(forward(70))
        np.testing.assert_equal(one[0][0], same[0][66])
        np.testing.assert_equal(one[4]["truth"][0], same[4]["truth"][66])


def test_rooms_without_a_seed_get_different_ones():
    env = gym.make_vec(ROOM_ID, num_envs=50)
    env.reset()
    assert len(set(env.np_random_seed)) == 50
    before = env.np_random_seed
    env.reset()
    assert env.np_random_seed == before  # the next episodes of the same seeds


@pytest.mark.parametrize("steps", [-1, 2**62, 10**30])  # -1 as in gym.make
def test_no_time_limit_or_one_beyond_all_counting_never_comes(steps):
    env = rooms(1, max_episode_steps=steps, ends_at_goal=False, lap={"step": 2.0})
    assert not any(env.step(np.zeros((1, 2), np.float32))[3][0] for _ in range(420))


def test_render_shows_each_room_as_a_single_env_does():
    env = rooms(2, render_mode="rgb_array")
    single = gym.make(ROOM_ID, render_mode="rgb_array")
    single.reset(seed=1)
    single.step(FORWARD)
    env.step(forward(2))
    pictures = env.render()
    assert len(pictures) == 2
    np.testing.assert_array_equal(pictures[1], single.render())


@pytest.mark.parametrize(
    ("call", "given", "text"),
    [
        ("step", {"actions": np.zeros((2, 2))},
         r"of shape \(2, 2\), but must be numbers of shape \(3, 2\)"),
        ("step", {"actions": None}, "None, but must be numbers"),
        ("step", {"actions": [[1, 0], [1, 0], [11, 0]]},
         "in room 2, the action is .* from 0 to 10 px"),
        ("step", {"actions": [[1, 0], [np.nan, 0], [1, 0]]}, "in room 1, the action is"),
        ("reset", {"seed": [1, 2]}, "seed has 2 numbers, but there are 3 rooms"),
        ("reset", {"seed": [1, 2, -3]}, "seed is -3"),
        ("reset", {"seed": "a"}, "seed is 'a'"),
        ("reset", {"options": {"mask": 1}}, "did you mean 'reset_mask'"),
        ("reset", {"options": 3}, "options is 3"),
        ("reset", {"options": {"reset_mask": [1, 0, 1]}}, "3 Boolean values"),
        ("reset", {"options": {"reset_mask": np.zeros(3, bool)}}, "at least one"),
    ],
)  # fmt: skip
def test_a_bad_call_is_refused_and_all_episodes_go_on(call, given, text):
    env, untouched = rooms(), rooms()
    with pytest.raises(InputError, match=text):
        getattr(env, call)(**given)
    np.testing.assert_equal(env.step(forward()), untouched.step(forward()))


def test_a_step_outside_an_episode_says_what_to_do():
    env = gym.make_vec(ROOM_ID, num_envs=3, autoreset_mode="Disabled", max_episode_steps=1)
    with pytest.raises(RuntimeError, match="room 0 has not begun: call reset"):
        env.step(forward())
    env.reset(seed=0, options={"reset_mask": np.array([True, False, True])})
    with pytest.raises(RuntimeError, match="room 1 has not begun: call reset"):
        env.step(forward())
    env.reset(seed=0)
    env.step(forward())
    with pytest.raises(RuntimeError, match="room 0 has ended: call reset"):
        env.step(forward())
