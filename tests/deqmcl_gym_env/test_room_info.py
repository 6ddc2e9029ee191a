"""What info says is what the documents say."""

import copy
import inspect
import math
import re
from pathlib import Path

import numpy as np
import pytest
from room_cases import STILL

import deqmcl_gym
from deqmcl_gym.envs.room import RoomEnv, RoomInfo
from deqmcl_gym.envs.vector import RoomVectorEnv
from deqmcl_gym.world.config import WORLDS

ARRAYS = {
    "planned_actions": np.float32, "command": np.float32, "truth": np.float64,
}  # fmt: skip


@pytest.mark.parametrize("horizon", [None, 1, 1000])
def test_info_has_its_types_and_shapes_and_the_plan_shows_the_next_actions_and_then_zeros(horizon):
    env = RoomEnv(horizon=horizon, ends_at_goal=False)
    plan, rows = env.plan, horizon or len(env.plan)
    shapes = {"planned_actions": (rows, 2), "command": (2,), "truth": (3,)}
    _, info = env.reset(seed=0)
    infos = [info]
    for action in plan:
        infos.append(env.step(action)[4])
        np.testing.assert_array_equal(infos[-1]["truth"], env.pose)
    for step, info in enumerate(infos):
        assert set(info) == RoomInfo.__required_keys__
        assert type(info["planned_count"]) is np.int64
        assert type(info["collided"]) is type(info["is_success"]) is np.float64
        for key, dtype in ARRAYS.items():
            assert (info[key].dtype, info[key].shape) == (dtype, shapes[key])
            assert np.isfinite(info[key]).all()
        count = min(rows, len(plan) - step)
        assert info["planned_count"] == count
        np.testing.assert_array_equal(info["planned_actions"][:count], plan[step : step + count])
        assert not info["planned_actions"][count:].any()


def test_action_is_the_command_before_noise_and_contact():
    env = RoomEnv(start={"pose": (335, 50, 0.0)}, noise={"drive": 0.5, "turn": 0.5})
    _, info = env.reset(seed=0)
    np.testing.assert_array_equal(info["command"], np.zeros(2, np.float32))
    assert not info["collided"]
    for command in ([9.7, 0.1], [9.7, 0.0], [0.3, 0.2]):  # into the wall x = 350
        before = env.pose
        info = env.step(np.array(command))[4]  # float64 is cast
        np.testing.assert_array_equal(info["command"], np.float32(command))
        way = np.hypot(info["truth"][0] - before[0], info["truth"][1] - before[1])
        assert way != pytest.approx(command[0], abs=1e-3)  # noise or contact: not what was done


@pytest.mark.parametrize("heading", [math.pi, 4.0, -2 * math.pi])
def test_the_heading_of_truth_is_wrapped_from_the_start(heading):
    start = {"pose": (175, 50, heading), "sd_heading": 1.0}
    env = RoomEnv(start=start, noise=STILL, ends_at_goal=False)
    truths = [env.reset(seed=seed)[1]["truth"] for seed in range(50)]
    assert all(-math.pi <= truth[2] < math.pi for truth in truths)
    still = env.step(np.zeros(2, np.float32))[4]["truth"]
    np.testing.assert_allclose(still, truths[-1], rtol=0, atol=1e-15)  # wrapping may round
    away = [math.remainder(truth[2] - heading, 2 * math.pi) for truth in truths]
    assert abs(sum(away)) < 5 * math.sqrt(50)  # around the pose asked for: 5 standard errors


def test_what_is_done_to_returned_arrays_matters_to_nobody():
    spoiled, other = (RoomEnv(horizon=20, render_mode="rgb_array") for _ in range(2))
    plan = np.array(spoiled.plan)
    spoiled.plan[...] = 7
    said, kept = spoiled.reset(seed=2), [other.reset(seed=2)]
    then = copy.deepcopy(kept)
    for action in plan[:60]:
        for array in (said[0], *(said[-1][key] for key in ARRAYS)):
            array[...] = 7
        given = action.copy()
        said = spoiled.step(given)
        given[...] = 7
        kept.append(other.step(action))
        then.append(copy.deepcopy(kept[-1]))
        np.testing.assert_equal(said, kept[-1])
        np.testing.assert_array_equal(spoiled.render(), other.render())
    np.testing.assert_equal(kept, then)


PAGE = (Path(deqmcl_gym.__file__).parents[1] / "docs" / "environment.md").read_text("utf-8")


def test_only_the_preset_guided_has_a_driver():
    for name in WORLDS:
        assert (RoomEnv(preset=name).world.driver is not None) == (name == "guided")


def test_every_key_of_info_is_documented():
    for key in RoomInfo.__annotations__:
        assert f"| `{key}` | " in PAGE


def test_every_further_argument_of_the_vector_env_is_documented():
    further = set(inspect.signature(RoomVectorEnv).parameters) - {"room", "render_mode"}
    assert all(re.search(rf"^\| `{name}` \| ", PAGE, re.MULTILINE) for name in further)
