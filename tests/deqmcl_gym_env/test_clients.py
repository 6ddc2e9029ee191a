"""What other people's libraries rely on holds in every id."""

import inspect
import math

import gymnasium as gym
import numpy as np
import pytest
from believing import Believes
from refusals import refused
from room_cases import SMALL

import deqmcl_gym  # noqa: F401  # registers the environments
import localizers
from deqmcl_gym import TASKS
from deqmcl_gym.envs.belief import BeliefObservation
from deqmcl_gym.logs import Log, Scanner
from deqmcl_gym.validation import InputError

LOG = "deqmcl_gym/Log-v0"
FEW = {"localizer": {"name": "mcl-map", "particles": 300}}
OFFICES = {"office": {**SMALL, "seeds": [10, 30]}}
KWARGS = {
    "deqmcl_gym/Localize-v0": FEW | {"floor_plan": OFFICES, "particles": 5, "cell": 1.0},
    "deqmcl_gym/Track-v0": FEW | {"particles": 5},
    "deqmcl_gym/Journey-v1": {"floor_plan": OFFICES, "route": {"min_length": 4.0}},
}
IDS = sorted(name for name in gym.registry if name.startswith("deqmcl_gym/"))
# keys that Gymnasium, Stable-Baselines3, TorchRL or Minari give a meaning of their own
THEIRS = {
    "action", "observation", "obs", "reward", "done", "terminated", "truncated", "next", "state",
    "pixels", "episode", "final_obs", "final_info", "terminal_observation",
}  # fmt: skip


def log():
    """A drive of four records, the first two without a reference."""
    times, way = np.arange(4.0), np.zeros((4, 3))
    way[:, 0] = 0.1 * times
    known = np.where(times[:, None] < 2, np.nan, way)
    scanner = Scanner(angles=(-0.5, 0.0, 0.5), max_range=5.0)
    return Log(scanner, times, way, np.ones((4, 3), np.float32), known)


def made(name, **kwargs):
    played = {"log": log(), "on_mismatch": "ignore"} if name == LOG else {}
    return gym.make(name, **KWARGS.get(name, {}), **played, **kwargs)


def driven(env, seed, steps=6):
    seen, info = env.reset(seed=seed)
    said = [(seen, info)]
    for _ in range(steps):
        action = np.zeros(env.action_space.shape, np.float32)
        action[:2] = (env.action_space.high[0] / 4, 0.1)
        seen, _, terminated, truncated, info = env.step(action)
        said.append((seen, info))
        if terminated or truncated:
            break
    return said


@pytest.mark.parametrize("name", IDS)
def test_info_is_a_tree_of_one_shape_whose_keys_mean_nothing_else(name):
    env = made(name)
    said = [told for seed in range(3) for told in driven(env, seed)]
    kinds = [{key: (type(v), v.dtype, v.shape) for key, v in info.items()} for _, info in said]
    assert all(kind == kinds[0] for kind in kinds)
    played = {"log": log(), "on_mismatch": "ignore"} if name == LOG else {}
    envs = gym.make_vec(name, 2, "sync", **KWARGS.get(name, {}), **played)
    told = envs.reset(seed=0)[1]
    for key, (kind, dtype, shape) in kinds[0].items():
        assert (told[key].dtype, told[key].shape) == (dtype, (2, *shape))
        assert not dtype.hasobject
        assert kind is not np.ndarray or shape  # Minari cannot read those of shape ()
    shown = said[0][0] if isinstance(said[0][0], dict) else {}
    assert not set(kinds[0]) & (THEIRS | set(shown))
    assert "is_success" in kinds[0]


@pytest.mark.parametrize("name", IDS)
def test_what_is_shown_is_within_finite_bounds_that_scaling_leaves_apart(name):
    env = made(name)
    spaces = env.observation_space
    parts = spaces.spaces if isinstance(spaces, gym.spaces.Dict) else {"scan": spaces}
    assert all(np.isfinite([part.low, part.high]).all() for part in parts.values())
    said = [seen for seed in range(3) for seen, _ in driven(env, seed)]
    assert all(seen in spaces for seen in said)
    for key in {"goal", "mean", "best", "particles"} & set(parts):
        low, high = parts[key].low, parts[key].high
        shares = np.array([(seen[key] - low) / (high - low) for seen in said])[..., :2]
        assert np.ptp(shares) > 0.05


@pytest.mark.parametrize("name", IDS)
def test_an_unknown_argument_is_a_type_error_in_one_sentence_and_strange_options_are_let_be(name):
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'") as caught:
        made(name, frameskip=1)
    assert isinstance(caught.value, InputError) == (name not in TASKS)
    if name not in TASKS:
        with refused("allowed values: "):
            made(name, frameskip=1)
    options = {"minari_autoseed": False}
    np.testing.assert_equal(made(name).reset(seed=1, options=options), made(name).reset(seed=1))
    assert options == {"minari_autoseed": False}


def test_native_rooms_let_strange_options_be_and_take_their_own():
    envs, others = (gym.make_vec("deqmcl_gym/Room-v0", num_envs=2) for _ in "ab")
    strange = {"minari_autoseed": True}
    np.testing.assert_equal(envs.reset(seed=1, options=strange), others.reset(seed=1))


@pytest.mark.parametrize("name", IDS)
def test_every_render_mode_of_gymnasium_is_had(name):
    env = made(name, render_mode="rgb_array_list")
    env.reset(seed=0)
    assert [picture.dtype for picture in env.render()] == [np.uint8]
    with pytest.warns(UserWarning, match="HumanRendering wrapper is being applied"):
        shown = made(name, render_mode="human")
    assert shown.render_mode == "human"


@pytest.mark.parametrize("name", IDS)
def test_before_reset_debuggers_see_an_env_and_users_are_told_to_reset(name):
    env = made(name, render_mode="rgb_array").unwrapped
    seen = {key for key, _ in inspect.getmembers(env)}
    late = {"pose", "belief", "goal", "record", "elapsed_steps"} & set(dir(type(env)))
    assert late
    assert not seen & late
    for key in late:
        with pytest.raises(RuntimeError, match=r"call reset\(\) first"):
            getattr(env, key)
    with pytest.raises(RuntimeError, match=r"call reset\(\)"):
        env.render()
    with pytest.raises(RuntimeError, match=r"call reset\(\)"):
        env.step(np.zeros(env.action_space.shape, np.float32))
    env.reset(seed=0)
    assert late <= {key for key, _ in inspect.getmembers(env)}


def test_what_an_env_does_not_have_as_it_was_made_is_no_attribute_of_it():
    env = made(LOG).unwrapped
    assert not hasattr(env, "floor_plan")
    with refused("the env was made without a map"):
        _ = env.floor_plan
    rooms = gym.make_vec("deqmcl_gym/Journey-v1", num_envs=2, **KWARGS["deqmcl_gym/Journey-v1"])
    assert not any(hasattr(rooms, key) for key in ("plan", "course", "courses"))


def test_a_limit_of_steps_stands_in_the_spec_and_truncates_there():
    for name, limit in (("Sharp-v0", 408), ("Localize-v0", 300), ("Track-v0", 200)):
        assert made(f"deqmcl_gym/{name}").spec.max_episode_steps == limit
    for most in (3, 500):
        env = made("deqmcl_gym/Track-v0", max_steps=most)
        again = gym.make(env.spec)
        assert env.spec.max_episode_steps == again.spec.max_episode_steps == most
        assert env.spec.to_json() == again.spec.to_json()
    assert len(driven(made("deqmcl_gym/Track-v0", max_steps=3), seed=0)) <= 4


def test_rooms_and_logs_tell_success_at_the_end_only_alone_and_together():
    route = KWARGS["deqmcl_gym/Journey-v1"] | {"noise": {"drive": 0, "turn": 0, "drift": 0}}
    env = gym.make("deqmcl_gym/Journey-v1", **route)
    envs = gym.make_vec("deqmcl_gym/Journey-v1", num_envs=1, autoreset_mode="SameStep", **route)
    _, info = env.reset(seed=2)
    envs.reset(seed=2)
    terminated = False
    while not terminated:
        assert not info["is_success"]
        action = info["planned_actions"][0]
        _, _, terminated, _, info = env.step(action)
        *_, told = envs.step(action[None])
        assert not told["is_success"][0]
    assert info["is_success"]
    assert told["final_info"]["is_success"].tolist() == [True]
    assert [bool(info["is_success"]) for _, info in driven(made(LOG), 0)] == [False] * 3 + [True]


def test_a_belief_off_the_map_reads_the_bound_and_filters_turns_are_wrapped():
    far = Believes(localizers.PointsBelief([(-9e4, 170, 7.0), (9e4, 170, 7.0)]))
    env = BeliefObservation(gym.make("deqmcl_gym/Sharp-v0"), far, None, particles=8)
    seen, _ = env.reset(seed=0)
    assert seen in env.observation_space
    np.testing.assert_allclose(seen["particles"][:, 2], 7.0 - 2 * math.pi, atol=1e-6)
    mean = env.observation_space["mean"]
    assert set(seen["particles"][:, 0]) == {mean.low[0], mean.high[0]}


def test_all_offices_of_a_kind_are_seen_on_one_scale():
    one, other, many = (
        gym.make("deqmcl_gym/Localize-v0", **FEW, floor_plan={"office": {**SMALL, **seed}})
        for seed in ({"seed": 1}, {"seed": 2}, {"seeds": [3, 9]})
    )
    assert one.observation_space == other.observation_space == many.observation_space


@pytest.mark.parametrize(("name", "count"), [("Localize-v0", "three"), ("Track-v0", "four")])
def test_a_refused_action_is_told_how_many_numbers_are_needed(name, count):
    env = made(f"deqmcl_gym/{name}")
    env.reset(seed=0)
    for bad in (np.zeros(2), np.full(env.action_space.shape, 9.0), "drive"):
        with refused(f"must be {count} numbers: a distance from 0 to", "declare from 0 to 1"):
            env.step(bad)
    assert env.unwrapped.steps == 0
