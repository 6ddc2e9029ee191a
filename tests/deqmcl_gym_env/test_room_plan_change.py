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


@pytest.mark.parametrize("count", [0, 3, 300])
@pytest.mark.parametrize("horizon", [5, None])
def test_the_new_plan_is_shown_after_its_step_and_not_before_and_the_episode_ends_with_it(
    count, horizon
):
    new = np.tile(NEW, (100, 1))[:count]
    env = changed(3, new, horizon=horizon)
    old, rows = env.unwrapped.plan.copy(), horizon or 204
    for _ in range(2):  # reset brings the old plan back
        _, info = env.reset(seed=0)
        said = drive(env, np.zeros((3 + count, 2)))
        for step, told in enumerate([info, *(step[4] for step in said)]):
            left = (old[step:] if step < 3 else new[step - 3 :])[:rows]
            assert told["planned_count"] == len(left)
            expected = np.vstack([left, np.zeros((rows - len(left), 2), np.float32)])
            np.testing.assert_array_equal(told["planned_actions"], expected)
        assert not any(step[2] for step in said)
        assert [step[3] for step in said] == [False] * (2 + count) + [True]


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
    ("actions", "text"),
    [
        ([[1.0, 0.0, 0.0]], "actions"), ([[np.nan, 0.0]], "actions"), ([("1", "0")], "actions"),
        ("drive", "actions"), (None, "actions"), (np.empty((0, 3)), "actions"),
        ([(1.0, 0.0), (10.5, 0.0)], "must be two numbers"),
    ],
)  # fmt: skip
def test_what_is_no_plan_is_refused_at_once_and_nothing_has_happened(actions, text):
    with pytest.raises(InputError, match=text):
        changed(3, actions)
    env = RoomEnv(ends_at_goal=False)
    env.reset(seed=0)
    plan = env.plan
    with pytest.raises(InputError):
        env.replace_plan(actions)
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
