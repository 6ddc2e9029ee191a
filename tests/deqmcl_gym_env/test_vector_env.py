"""Many rooms say what as many single environments on pymunk say, and keep Gymnasium's contract."""

import importlib
import sys

import gymnasium as gym
import numpy as np
import pytest
from refusals import refused
from room_cases import FLOOR_PLANS, ROOM_ID, SPIKE
from side_by_side import NEAR, assert_same, both, run_beside

import deqmcl_gym  # noqa: F401
from deqmcl_gym.envs.vector import RoomVectorEnv
from deqmcl_gym.maps import Lidar, Mount
from deqmcl_gym.validation import InputError

PLANS = FLOOR_PLANS | {"spike": SPIKE}
MODES = ("NextStep", "SameStep")

# beams, a start of its own for each room, and long steps that meet walls and pass corners
ROUGH = {
    "lidar": {"beams": 5, "field_of_view": 2 * np.pi, "sigma": 5.0},
    "start": {"sd_position": 5.0, "sd_heading": 0.5},
    "noise": {"drive": 0.3, "turn": 0.3, "drift": 0.01},
    "robot": {"max_distance": 60.0, "max_turn": np.pi},
}
OTHERWISE = {"clutter": {"number": 6}}
BLIND = Mount(x=-6.0, heading=2.5, upside_down=True, blind=((0.1, 1.0),))
MOUNTS = (Mount(x=5.0, y=2.0, heading=0.3), BLIND)
MOUNTED = {**ROUGH, "lidar": Lidar(beams=10, sigma=5.0, mounts=MOUNTS, min_range=30.0)}
WHOLE = {"planned": 1.0, "steps": 450, "ends": 8}
DRIVES = [  # the world; the share of planned actions, the steps; least contacts and ends
    *(({"floor_plan": plan, "max_episode_steps": 120, "rooms": 8, **ROUGH},
       {"planned": 0.3, "steps": 250, "contacts": 250, "ends": 16}) for plan in PLANS.values()),
    ({"max_episode_steps": 120, **MOUNTED},
     {"planned": 0.3, "steps": 150, "contacts": 50, "ends": 4}),
    *(({"mode": mode, "max_episode_steps": 60, **OTHERWISE, **ROUGH},
       {"planned": 0.3, "steps": 150, "contacts": 50, "ends": 8}) for mode in MODES),
    *(({"mode": mode, "preset": name}, WHOLE)
      for mode in MODES for name in ("paper", "matched", "sharp")),
    *(({"mode": mode, "observation": "dict", "horizon": 5, "max_episode_steps": 30},
       {"planned": 0.7, "steps": 70}) for mode in MODES),
    ({"horizon": 5, "ends_at_goal": False}, {"planned": 1.0, "steps": 210}),
]  # fmt: skip
FORWARD = np.float32([5.0, 0.0])


@pytest.mark.parametrize(("world", "drive"), DRIVES)
def test_rooms_side_by_side_say_what_as_many_single_ones_on_pymunk_say(world, drive):
    """Through contacts, to the end and into the next episodes."""
    native, loop = both(ROOM_ID, **{"rooms": 4, **world})
    assert isinstance(native, RoomVectorEnv)
    assert native.metadata["autoreset_mode"] is loop.metadata["autoreset_mode"]
    for name in ("observation_space", "single_observation_space", "single_action_space"):
        assert getattr(native, name) == getattr(loop, name)
    run = {"contacts": 0, "ends": 0, **drive}
    contacts, ends = run_beside((native, loop), run["steps"], run["planned"], seed=3, near=NEAR)
    assert contacts >= run["contacts"]
    assert ends >= run["ends"]
    assert native.step(native.action_space.sample())[0] in native.observation_space


@pytest.mark.parametrize(
    ("part", "room", "words"),
    [("people", ROOM_ID, "people have"), ("glass", "deqmcl_gym/Journey-v1", "glass have")],
)
def test_rooms_with_people_or_glass_run_one_by_one(part, room, words):
    with refused(words, 'vectorization_mode="sync"'):
        gym.make_vec(room, num_envs=2, **{part: {}})
    many = gym.make_vec(ROOM_ID, num_envs=2, vectorization_mode="sync", people={})
    assert many.reset(seed=0)[0].shape == (2, 1)


def test_frames_of_rooms_that_differ_are_those_of_single_rooms():
    native, loop = both(ROOM_ID, 2, render_mode="rgb_array", **OTHERWISE)
    frames = []
    for envs in (native, loop):
        envs.reset(seed=4)
        frames.append(envs.render())
    for ours, theirs in zip(*frames, strict=True):
        assert (ours != theirs).mean() < 1e-3  # scans differ by rounding errors
    assert (frames[0][0] != frames[0][1]).any()


@pytest.mark.parametrize("seed", [[11, 5, 11], None, 7])
def test_masked_resets_agree(seed):
    native, loop = both(ROOM_ID, 3, "Disabled", preset="matched")
    assert_same(native.reset(seed=2), loop.reset(seed=2), NEAR)
    actions = np.tile(np.float32([9, 0.5]), (3, 1))
    for mask in ([True, False, False], [False, True, True], [True, True, True]):
        assert_same(native.step(actions), loop.step(actions), NEAR)
        chosen = {"reset_mask": np.array(mask)}
        ours = native.reset(seed=seed, options=dict(chosen))
        theirs = loop.reset(seed=seed, options=dict(chosen))
        assert_same(ours, theirs, NEAR)


def rooms(number: int = 3, **kwargs) -> RoomVectorEnv:
    env = gym.make_vec(ROOM_ID, num_envs=number, **kwargs)
    env.reset(seed=0)
    return env


def forward(number: int = 3) -> np.ndarray:
    return np.tile(FORWARD, (number, 1))


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


@pytest.mark.parametrize(
    ("call", "given", "text"),
    [
        ("step", {"actions": np.zeros((2, 2))},
         r"of shape \(2, 2\), but must be numbers of shape \(3, 2\)"),
        ("step", {"actions": [[1, 0], [1, 0], [11, 0]]},
         "in room 2, the action is .* from 0 to 10 px"),
        ("reset", {"seed": [1, 2]}, "seed has 2 numbers, but there are 3 rooms"),
        ("reset", {"seed": [1, 2, -3]}, "seed is -3"),
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
