"""``deqmcl_gym.sb3``: native rooms as a VecEnv, or one sentence that says what to install."""

import importlib
import sys

import gymnasium as gym
import numpy as np
import pytest
from refusals import refused

import deqmcl_gym  # noqa: F401


def test_without_the_library_its_extra_is_named(monkeypatch):
    for name in ("stable_baselines3", "deqmcl_gym.sb3"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.vec_env", None)
    with pytest.raises(ModuleNotFoundError, match=r'pip install "deqmcl-gym\[rl\]"'):
        importlib.import_module("deqmcl_gym.sb3")


def test_rooms_are_a_vec_env_with_actions_from_minus_one_to_one():
    pytest.importorskip("stable_baselines3")
    from deqmcl_gym.sb3 import Rooms

    rooms = gym.make_vec("deqmcl_gym/Sharp-v0", num_envs=3, autoreset_mode="SameStep")
    envs = Rooms(rooms)
    envs.seed(4)
    first = envs.reset()
    assert (first == rooms.reset(seed=[4, 5, 6])[0]).all()
    ends = 0
    for _ in range(250):
        seen, paid, ended, infos = envs.step(np.float32([[1, 0]] * 3))
        assert seen.shape == (3, 9)
        assert paid.shape == ended.shape == (3,)
        assert all(("terminal_observation" in infos[i]) == ended[i] for i in range(3))
        ends += ended.sum()
    with refused('give gym.make_vec(..., autoreset_mode="SameStep")'):
        Rooms(gym.make_vec("deqmcl_gym/Sharp-v0", num_envs=3))
