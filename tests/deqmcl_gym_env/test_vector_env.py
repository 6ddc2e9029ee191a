"""Many rooms say what as many single environments on pymunk say, and keep Gymnasium's contract."""

import json

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from refusals import refused
from room_cases import FLOOR_PLANS, SPIKE
from room_trace import ROOM_ID

from deqmcl_gym.envs.vector import RoomVectorEnv
from deqmcl_gym.maps import GridMap
from deqmcl_gym.validation import InputError

PLANS = FLOOR_PLANS | {"spike": SPIKE}

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


@pytest.mark.parametrize("plan", PLANS)
def test_rough_drives_agree_contacts_and_new_episodes_included(plan):
    native, loop = both(8, floor_plan=PLANS[plan], max_episode_steps=120, **ROUGH)
    contacts, ends = run_beside(native, loop, 250, planned=0.3, seed=1)
    assert contacts > 250
    assert ends >= 2 * 8


def test_a_lidar_that_is_not_in_the_robots_centre_agrees():
    lidar = {**ROUGH["lidar"], "mounting": (4.0, -6.0)}
    native, loop = both(4, max_episode_steps=120, **{**ROUGH, "lidar": lidar})
    contacts, ends = run_beside(native, loop, 150, planned=0.3, seed=1)
    assert contacts > 50
    assert ends >= 4


OTHERWISE = {"clutter": {"number": 6}, "changed_walls": {"share": 0.4}}


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_rooms_that_differ_from_the_map_and_from_each_other_agree(mode):
    native, loop = both(4, mode, max_episode_steps=60, **OTHERWISE, **ROUGH)
    assert isinstance(native, RoomVectorEnv)
    contacts, ends = run_beside(native, loop, 150, planned=0.3, seed=1)
    assert contacts > 50
    assert ends >= 8


def test_rooms_of_cells_that_differ_from_the_map_agree():
    cells = np.zeros((60, 80), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[25:35, 25:55] = 100
    lap = {"waypoints": [(1.2, 1.2), (6.8, 1.2), (6.8, 4.8), (1.2, 4.8)], "step": 0.1}
    grid = GridMap(occupancy=cells, resolution=0.1)
    native, loop = both(3, floor_plan=grid, lap=lap, max_episode_steps=40, **OTHERWISE)
    contacts, ends = run_beside(native, loop, 100, planned=0.2, seed=2)
    assert contacts > 10
    assert ends >= 6


@pytest.mark.parametrize(("part", "words"), [("people", "people have"), ("glass", "glass have")])
def test_rooms_with_people_or_glass_run_one_by_one(part, words):
    with refused(words, 'vectorization_mode="sync"'):
        gym.make_vec(ROOM_ID, num_envs=2, **{part: {}})
    many = gym.make_vec(ROOM_ID, num_envs=2, vectorization_mode="sync", **{part: {}})
    assert many.reset(seed=0)[0].shape == (2, 1)


def test_frames_of_rooms_that_differ_are_those_of_single_rooms():
    native, loop = both(2, render_mode="rgb_array", **OTHERWISE)
    frames = []
    for envs in (native, loop):
        envs.reset(seed=4)
        frames.append(envs.render())
    for ours, theirs in zip(*frames, strict=True):
        assert (ours != theirs).mean() < 1e-3  # scans differ by rounding errors
    assert (frames[0][0] != frames[0][1]).any()


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
