"""PlanChange, and all wrappers together."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from room_cases import drive
from room_trace import ROOM_ID

from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.envs.wrappers import BeamDropout, Kidnap, PlanChange
from deqmcl_gym.validation import InputError

NEW = np.float32([(1, 0.1), (2, -0.1), (3, 0.0)])


def changed(step: int, actions, **kwargs) -> PlanChange:
    return PlanChange(RoomEnv(ends_at_goal=False, **kwargs), step=step, actions=actions)


def test_the_new_plan_is_shown_after_its_step_and_not_before():
    env = changed(3, NEW, horizon=5)
    old = env.unwrapped.plan
    _, info = env.reset(seed=0)
    infos = [info, *(said[4] for said in drive(env, old[:6]))]
    for step in (0, 1, 2):
        np.testing.assert_array_equal(infos[step]["planned_actions"], old[step : step + 5])
    for step in (3, 4, 5, 6):
        left = NEW[step - 3 :]
        assert infos[step]["planned_count"] == len(left)
        expected = np.vstack([left, np.zeros((5 - len(left), 2), np.float32)])
        np.testing.assert_array_equal(infos[step]["planned_actions"], expected)


def test_the_episode_ends_with_the_new_plan():
    env = changed(3, NEW)
    env.reset(seed=0)
    assert [said[2] for said in drive(env, np.zeros((6, 2)))] == [False] * 5 + [True]
    with pytest.raises(RuntimeError, match="has ended"):
        env.step(np.zeros(2, np.float32))


def test_an_empty_plan_ends_the_episode_after_its_step():
    env = changed(3, [])
    env.reset(seed=0)
    said = drive(env, np.zeros((3, 2)))
    assert [step[2] for step in said] == [False, False, True]
    assert said[-1][4]["planned_count"] == 0
    assert not said[-1][4]["planned_actions"].any()


def test_a_longer_plan_is_shown_as_far_as_the_horizon_and_executed_whole():
    new = np.tile(np.float32([0, 0.1]), (300, 1))
    env = changed(1, new)
    _, info = env.reset(seed=0)
    said = drive(env, np.zeros((301, 2)))
    shapes = {step[4]["planned_actions"].shape for step in said} | {info["planned_actions"].shape}
    assert shapes == {(204, 2)}
    counts = [step[4]["planned_count"] for step in said]
    assert counts == [min(204, 300 - k) for k in range(301)]
    assert [step[2] for step in said] == [False] * 300 + [True]


def test_reset_brings_the_original_plan_back():
    env = changed(1, NEW)
    old = env.unwrapped.plan.copy()
    for _ in range(2):
        _, info = env.reset(seed=0)
        np.testing.assert_array_equal(info["planned_actions"], old)
        assert drive(env, [(0, 0)])[0][4]["planned_count"] == 3


def test_the_world_moves_and_senses_as_without_the_change():
    bare, other = RoomEnv(ends_at_goal=False), changed(5, np.tile(NEW, (20, 1)))
    actions = bare.plan[:30]
    for env in (bare, other):
        env.reset(seed=4)
    for one, two in zip(drive(bare, actions), drive(other, actions), strict=True):
        assert one[1:4] == two[1:4]
        np.testing.assert_array_equal(one[0], two[0])
        np.testing.assert_array_equal(one[4]["truth"], two[4]["truth"])


@pytest.mark.parametrize(
    "actions",
    [[1.0, 2.0], [[1.0, 0.0, 0.0]], [[np.nan, 0.0]], "drive", [[]], np.empty((0, 3)), None],
)  # fmt: skip
def test_what_is_no_plan_is_refused_at_once(actions):
    with pytest.raises(InputError, match=r"the plan|actions"):
        changed(3, actions)


@pytest.mark.parametrize("action", [(-1.0, 0.0), (10.5, 0.0), (1.0, 0.8), (1e300, -0.8)])
def test_planned_actions_outside_the_space_are_refused_when_the_wrapper_is_made(action):
    with pytest.raises(InputError, match="must be two numbers"):
        changed(2, [(1.0, 0.0), action])


@pytest.mark.parametrize("actions", [[(1.0, 0.0), (-1.0, 0.0)], [[1.0]], [("1", "0")]])
def test_a_bad_plan_is_refused_and_nothing_has_happened(actions):
    env = RoomEnv(ends_at_goal=False)
    env.reset(seed=0)
    env.step(np.zeros(2, np.float32))
    plan = env.plan
    with pytest.raises(InputError):
        env.replace_plan(actions)
    assert env.elapsed_steps == 1
    np.testing.assert_array_equal(env.plan, plan)


EXPECTED = [
    r".*we recommend using a symmetric and normalized space.*",
    r".*is different from the unwrapped version.*",  # wrapped on purpose here
    r".*A Box observation space maximum value is infinity.*",  # +inf is a lost beam
]
WRAPPED = {
    "kidnap": lambda env: Kidnap(env, step=2),
    "dropout": lambda env: BeamDropout(env, probability=0.5),
    "plan-change": lambda env: PlanChange(env, step=2, actions=[(1, 0.1)] * 10),
    "all": lambda env: PlanChange(BeamDropout(Kidnap(env, step=2), 0.5), 3, [(1, 0.1)] * 10),
}


@pytest.mark.parametrize("name", WRAPPED)
def test_the_env_checker_accepts_wrapped_envs(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for text in EXPECTED:
            warnings.filterwarnings("ignore", message=text)
        check_env(WRAPPED[name](gym.make(ROOM_ID, lidar={"beams": 5})))


def test_stacked_wrappers_all_act():
    env = WRAPPED["all"](gym.make(ROOM_ID, lidar={"beams": 50}))
    bare = gym.make(ROOM_ID, lidar={"beams": 50})
    assert 5 < np.isinf(env.reset(seed=1)[0]).sum() < 45  # P < 1e-8 outside, p = 0.5
    bare.reset(seed=1)
    still = np.zeros(2, np.float32)
    jumps, counts = [], []
    for _ in range(3):
        info, other = env.step(still)[4], bare.step(still)[4]
        jumps.append(bool((info["truth"] != other["truth"]).any()))
        counts.append(info["planned_count"])
    assert jumps == [False, True, True]
    assert counts == [203, 202, 10]


def test_the_spec_of_a_wrapped_env_makes_it_again():
    env = Kidnap(WRAPPED["all"](gym.make(ROOM_ID)), step=4, pose=(60, 200, 1.0))
    copy = gym.make(EnvSpec.from_json(env.spec.to_json()))
    for one in (env, copy):
        one.reset(seed=2)
    still = np.zeros((8, 2))
    np.testing.assert_equal(drive(env, still), drive(copy, still))
