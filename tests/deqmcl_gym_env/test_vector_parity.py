"""Many rooms say what as many single environments on pymunk say, step for step."""

import gymnasium as gym
import numpy as np
import pytest
from room_cases import EMPTY, PAPER, SEVERAL, SPIKE, TRIANGLE
from room_trace import ROOM_ID

PLANS = {
    "paper": PAPER, "triangle": TRIANGLE, "several": SEVERAL, "spike": SPIKE, "empty": EMPTY,
}  # fmt: skip

# Contacts differ by rounding errors, some 1e-13 px a step. What is asked for is a thousandth of a
# pixel.
NEAR = 1e-3
# Ranges, as float32, from poses rounded to float32: off by 3e-5 px and by as much along a slant.
NEAR_SCAN = 1e-2


def both(rooms: int, mode: str = "NextStep", **kwargs):
    """The native vector env, and Gymnasium's around single ones."""
    native = gym.make_vec(ROOM_ID, num_envs=rooms, autoreset_mode=mode, **kwargs)
    loop = gym.make_vec(
        ROOM_ID, num_envs=rooms, vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode}, **kwargs,
    )  # fmt: skip
    return native, loop


def assert_same(ours, theirs, what="the step"):
    """Same keys, types and shapes; numbers near, everything that is no measure equal."""
    if isinstance(theirs, dict):
        assert ours.keys() == theirs.keys()
        for key in theirs:
            assert_same(ours[key], theirs[key], key)
    elif isinstance(theirs, tuple):
        for name, *pair in zip(("scan", "reward", "ended", "cut", "info"), ours, theirs):  # noqa: B905
            assert_same(*pair, name)
    elif theirs.dtype == object:  # final_obs
        for one, other in zip(ours, theirs, strict=True):
            assert (one is None) == (other is None)
            if other is not None:
                assert_same(one, other, "scan" if isinstance(other, np.ndarray) else "final_obs")
    else:
        assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape), what
        near = {"truth": NEAR, "reward": NEAR, "progress": 1e-5, "scan": NEAR_SCAN}.get(what, 0)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=near, err_msg=what)


def run_beside(native, loop, steps: int, planned: float, seed: int) -> tuple[int, int]:
    """Run both; a share of the actions is the planned one. Return contacts and ends."""
    agent = np.random.default_rng(seed)
    said = native.reset(seed=seed), loop.reset(seed=seed)
    assert_same(*said)
    assert_same(said[0][1], said[1][1])
    plans = said[1][1]["planned_actions"]
    low, high = loop.action_space.low, loop.action_space.high
    contacts = ends = 0
    for _ in range(steps):
        follow = agent.random((loop.num_envs, 1)) < planned
        anything = agent.uniform(low, high).astype(np.float32)
        actions = np.where(follow, plans[:, 0], anything).clip(low, high)
        ours, theirs = native.step(actions), loop.step(actions)
        assert_same(ours, theirs)
        plans = theirs[4]["planned_actions"]
        contacts += theirs[4]["collided"].sum()
        ends += (theirs[2] | theirs[3]).sum()
    return int(contacts), int(ends)


# beams, a start of its own for each room, and long steps that meet walls and pass corners
ROUGH = {
    "lidar": {"beams": 5, "field_of_view": 2 * np.pi, "sigma": 5.0},
    "start": {"sd_position": 5.0, "sd_heading": 0.5},
    "noise": {"drive": 0.3, "turn": 0.3, "drift": 0.01},
    "robot": {"max_distance": 60.0, "max_turn": np.pi},
}


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("plan", PLANS)
def test_rough_drives_agree_contacts_and_new_episodes_included(plan, seed):
    native, loop = both(8, floor_plan=PLANS[plan], max_episode_steps=120, **ROUGH)
    contacts, ends = run_beside(native, loop, 250, planned=0.3, seed=seed)
    assert contacts > 250
    assert ends >= 2 * 8


def test_a_lidar_that_is_not_in_the_robots_centre_agrees():
    lidar = {**ROUGH["lidar"], "mounting": (4.0, -6.0)}
    native, loop = both(4, max_episode_steps=120, **{**ROUGH, "lidar": lidar})
    contacts, ends = run_beside(native, loop, 150, planned=0.3, seed=1)
    assert contacts > 50
    assert ends >= 4


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("preset", ["paper", "matched", "sharp"])
def test_laps_agree_to_their_end_and_into_the_next(preset, mode):
    native, loop = both(4, mode, preset=preset)
    _, ends = run_beside(native, loop, 450, planned=1.0, seed=3)
    assert ends >= 8


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_dict_observations_agree(mode):
    native, loop = both(3, mode, observation="dict", horizon=5, max_episode_steps=30)
    assert native.observation_space == loop.observation_space
    run_beside(native, loop, 70, planned=0.7, seed=8)
    assert native.observation_space.contains(native.step(native.action_space.sample())[0])


def test_a_short_horizon_and_no_goal_agree():
    native, loop = both(3, horizon=5, ends_at_goal=False)
    run_beside(native, loop, 210, planned=1.0, seed=5)


@pytest.mark.parametrize("seed", [[11, 5, 11], None, 7])
def test_masked_resets_agree(seed):
    native, loop = both(3, "Disabled", preset="matched")
    assert_same(native.reset(seed=2), loop.reset(seed=2))
    actions = np.tile(np.float32([9, 0.5]), (3, 1))
    for mask in ([True, False, False], [False, True, True], [True, True, True]):
        assert_same(native.step(actions), loop.step(actions))
        chosen = {"reset_mask": np.array(mask)}
        ours = native.reset(seed=seed, options=dict(chosen))
        theirs = loop.reset(seed=seed, options=dict(chosen))
        assert_same(ours, theirs)
        assert_same(ours[1], theirs[1])


@pytest.mark.slow
@pytest.mark.parametrize("plan", PLANS)
def test_rough_drives_agree_over_a_hundred_thousand_steps(plan):
    native, loop = both(50, floor_plan=PLANS[plan], **ROUGH)
    contacts, _ = run_beside(native, loop, 2000, planned=0.3, seed=6)
    assert contacts > 10_000
