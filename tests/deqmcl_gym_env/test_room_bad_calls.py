"""Calls at the wrong time or with the wrong values are refused, and nothing has happened."""

import math

import numpy as np
import pytest
from room_cases import calm, drive

from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.envs.wrappers import BeamDropout, Kidnap, PlanChange
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.validation import InputError

BAD_ACTIONS = {
    "None": None,
    "word": "drive",
    "one entry": [5.0],
    "a batch of one": np.zeros((1, 2), np.float32),
    "ragged": [[5.0], [0.0, 0.0]],
    "complex": np.array([5 + 1j, 0]),
    "NaN": [np.nan, 0.0],
    "beyond float32": [1e300, 0.0],
    "backwards": [-0.01, 0.0],
    "too far": [10.01, 0.0],
    "too much to the left": [5.0, 0.79],
}


WRAPS = {
    "bare": lambda env: env,
    "kidnap": lambda env: Kidnap(env, step=3),
    "dropout": lambda env: BeamDropout(env, 0.5),
    "plan-change": lambda env: PlanChange(env, 3, [(1.0, 0.1)] * 20),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", BAD_ACTIONS)
@pytest.mark.parametrize("wrap", WRAPS)
def test_a_bad_action_is_refused_and_leaves_no_trace(wrap, name):
    env, other = (WRAPS[wrap](RoomEnv(lidar={"beams": 3})) for _ in range(2))
    for one in (env, other):
        one.reset(seed=9)
        drive(one, np.zeros((2, 2)))
    with pytest.raises(InputError, match=r"the action is .*, but must be two numbers") as caught:
        env.step(BAD_ACTIONS[name])
    assert len(str(caught.value).splitlines()) == 1
    for _ in range(10):
        action = np.float32([1.0, 0.2])
        np.testing.assert_equal(env.step(action), other.step(action))


@pytest.mark.parametrize("action", [[5, 0], (10.0, 0.0), np.array([0.0, -math.pi / 4])])
def test_two_real_numbers_of_any_kind_within_the_space_are_an_action(action):
    info = calm().step(action)[4]
    assert info["action"].dtype == np.float32
    np.testing.assert_array_equal(info["action"], np.float32(action))


def test_nothing_can_be_done_before_reset():
    env = RoomEnv(render_mode="rgb_array")
    calls = {
        "step": lambda: env.step(np.zeros(2, np.float32)),
        "place": lambda: env.place((175, 50, 0)),
        "render": env.render,
        "pose": lambda: env.pose,
        "steps": lambda: env.elapsed_steps,
        "kidnap": lambda: Kidnap(env, 1).step(np.zeros(2, np.float32)),
        "dropout": lambda: BeamDropout(env, 0.5).step(np.zeros(2, np.float32)),
        "plan change": lambda: PlanChange(env, 1, []).step(np.zeros(2, np.float32)),
    }
    for call in calls.values():
        with pytest.raises(RuntimeError, match=r"call reset\(\)"):
            call()
    env.reset(seed=0)  # and afterwards everything works
    assert env.step(env.plan[0])[4]["planned_count"] == 203


def test_no_step_follows_the_end_until_reset():
    env = calm(ends_at_goal=False)
    drive(env, np.zeros((204, 2)))
    pose = env.pose
    for _ in range(2):
        with pytest.raises(RuntimeError, match=r"the episode has ended: call reset\(\)"):
            env.step(np.zeros(2, np.float32))
    assert env.pose == pose
    assert env.elapsed_steps == 204
    env.reset()
    assert env.step(env.plan[0])[2] is False


@pytest.mark.parametrize("seed", [2**63, np.uint32(5)])
def test_whole_numbers_of_any_size_and_kind_are_seeds(seed):
    one, two = RoomEnv(), RoomEnv()
    np.testing.assert_equal(one.reset(seed=seed, options={}), two.reset(seed=int(seed)))


BAD_RESETS = {
    "seed is -1, but must be a whole number of 0 or more": {"seed": -1},
    "seed is 'a', but must be": {"seed": "a"},
    "seed is True, but must be": {"seed": True},
    "unknown reset option 'pose': allowed values: none": {"options": {"pose": (1, 2, 3)}},
    "options is 5, but must be None": {"seed": 1, "options": 5},
    "none of 1000 starts": {"seed": 3},
    "none of 1000 starts .* is free": {},  # in the next episode
}


@pytest.mark.parametrize("text", BAD_RESETS)
def test_a_refused_reset_leaves_the_episode_and_all_random_streams_as_they_were(text, monkeypatch):
    env, other = (RoomEnv(preset="matched", lidar={"beams": 3}) for _ in range(2))
    for one in (env, other):
        one.reset(seed=9)
        drive(one, one.plan[:5])
    rng = env.np_random.bit_generator.state
    with monkeypatch.context() as patched:
        if "none of" in text:
            patched.setattr(PolygonMap, "free", lambda *_: np.array([False]))
        with pytest.raises(InputError, match=text):
            env.reset(**BAD_RESETS[text])
    assert env.pose == other.pose
    assert env.elapsed_steps == 5
    assert (env.np_random_seed, env.np_random.bit_generator.state) == (9, rng)
    for action in env.plan[5:15]:
        np.testing.assert_equal(env.step(action), other.step(action))
    np.testing.assert_equal(env.reset(), other.reset())  # the next episode of the same seed


@pytest.mark.parametrize("pose", [(150, 150, 0), (5, 50, 0), (400, 50, 0), (np.nan, 50, 0), (1, 2)])
def test_the_robot_is_only_put_where_it_fits(pose):
    env = calm()
    before = env.pose
    with pytest.raises(InputError, match="the pose"):
        env.place(pose)
    assert env.pose == before
