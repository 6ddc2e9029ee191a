"""The driver: plans anew at every step, from the true pose, until its lap is done."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from room_cases import STILL, infos_of, wrapped

from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.envs.wrappers import PlanChange
from deqmcl_gym.logs.motion import dead_reckoned
from deqmcl_gym.validation import InputError

NEVER_DRAWN = {"sd_position": 0.0, "sd_heading": 0.0}
# A command is a float32 of at most 0.5 rad: half an ulp is 2^-26. The driver's next command follows
# from poses that differ by float64 rounding only.
ROUNDED = 2.0**-25


def guided(**kwargs) -> RoomEnv:
    return RoomEnv(preset="guided", **kwargs)


def planned(info: dict) -> np.ndarray:
    return info["planned_actions"][: info["planned_count"]]


def by_the_book(env: RoomEnv, pose) -> tuple[float, float]:
    """The driver's next action from its description: search the loop in steps of 0.01 px."""
    corners = np.array([*env.course.path.corners, env.course.path.corners[0]])
    shares = np.linspace(0, 1, 30_001)[:-1, None]
    loop = np.vstack([a + shares * (b - a) for a, b in itertools.pairwise(corners)])
    ways = np.linalg.norm(np.diff(loop, axis=0, append=loop[:1]), axis=1)
    nearest = np.linalg.norm(loop - pose[:2], axis=1).argmin()
    beyond = np.cumsum(np.roll(ways, -nearest))
    ahead = np.roll(loop, -nearest - 1, axis=0)[np.searchsorted(beyond, 25.0)]
    error = float(wrapped(np.arctan2(*(ahead - pose[:2])[::-1]) - pose[2]))
    turn = min(max(error, -math.pi / 12), math.pi / 12)
    return (0.0 if abs(error) > 0.5 else 5.0), turn


@pytest.mark.parametrize("seed", [1, 2])
def test_the_first_planned_action_heads_for_the_point_25_px_on_from_the_true_pose(seed):
    env = guided()
    for info in infos_of(env, seed)[:-1:7]:
        distance, turn = by_the_book(env, info["truth"])
        # 0.01 px to either side of a point 25 px off, seen from at most 8 px nearer: 1.2e-3 rad
        np.testing.assert_allclose(info["planned_actions"][0], (distance, turn), atol=1.2e-3)


def test_far_from_the_loop_and_against_it_it_heads_there_too():
    for pose in [(60, 280, 1.0), (175, 85, math.pi - 0.1), (330, 20, -2.0), (20, 20, 0.0)]:
        env = guided(start={"pose": pose} | NEVER_DRAWN)
        action = env.reset(seed=0)[1]["planned_actions"][0]
        np.testing.assert_allclose(action, by_the_book(env, np.array(pose)), atol=2e-3)


def test_without_noise_the_way_driven_is_the_plan_and_the_plan_after_a_step_is_its_rest():
    infos = infos_of(guided(noise=STILL), seed=3)
    way = dead_reckoned(planned(infos[0]), infos[0]["truth"])[1:]
    assert len(way) == len(infos) - 1
    seen = np.array([info["truth"] for info in infos[1:]])
    # float64 sums of numbers below 400, and commands as the plan's up to rounding, 900 px on
    np.testing.assert_allclose(seen[:, :2], way[:, :2], rtol=0, atol=900 * len(way) * ROUNDED)
    np.testing.assert_allclose(wrapped(seen[:, 2] - way[:, 2]), 0, atol=len(way) * ROUNDED)
    for before, after in itertools.pairwise(infos):
        np.testing.assert_allclose(planned(after), planned(before)[1:], rtol=0, atol=ROUNDED)


@pytest.mark.parametrize("horizon", [1, 1000])
def test_the_horizon_cuts_or_pads_the_same_plan(horizon):
    for short, whole in zip(infos_of(guided(horizon=horizon)), infos_of(guided()), strict=True):
        count = min(horizon, whole["planned_count"])
        assert short["planned_actions"].shape == (horizon, 2)
        assert short["planned_count"] == count
        np.testing.assert_array_equal(planned(short), planned(whole)[:count])
        assert not short["planned_actions"][count:].any()


def test_the_plan_of_the_env_is_the_lap_without_noise_from_the_expected_start():
    env = guided()
    calm = guided(noise=STILL, start=NEVER_DRAWN)
    np.testing.assert_array_equal(env.plan, planned(calm.reset(seed=0)[1]))
    env.reset(seed=1)
    assert len(infos_of(calm)) == len(env.plan) + 1


@pytest.mark.parametrize("start", [{}, {"pose": (60, 280, 1.0)} | NEVER_DRAWN])
@pytest.mark.parametrize("ends_at_goal", [True, False])
def test_the_episode_ends_once_round_along_the_path_with_no_action_left(ends_at_goal, start):
    env = guided(ends_at_goal=ends_at_goal, start=start)
    path = env.course.path
    for seed in range(20):
        *underway, last = infos_of(env, seed)
        arcs = [path.arc(tuple(info["truth"][:2])) for info in (*underway, last)]
        ways = [path.advance(one, two) for one, two in itertools.pairwise(arcs)]
        assert last["planned_count"] == 0
        assert all(info["planned_count"] for info in underway)
        # once round but for the radius, 8 px, and not a step later: at most 10 px (5 σ)
        assert path.length - 8 <= sum(ways) < path.length + 2
        assert sum(ways[:-1]) < path.length - 8


def test_a_driver_that_gets_nowhere_gives_up_after_twice_the_steps_of_the_lap():
    env = guided()
    info = env.reset(seed=0)[1]
    counts, ended = [info["planned_count"]], False
    while not ended:
        *_, done, ended, info = env.step(np.zeros(2, np.float32))
        assert not done
        counts.append(info["planned_count"])
    assert len(counts) == 2 * len(env.course.actions) + 1
    assert counts == [min(counts[0], 408 - step) for step in range(409)]


def test_the_plan_of_a_driver_is_not_replaced():
    words = r"a driver makes the plan .* cannot be replaced: choose a world"
    with pytest.raises(InputError, match=words):
        PlanChange(guided(), step=3, actions=[(1.0, 0.0)])
    env, other = guided(), guided()
    for one in (env, other):
        one.reset(seed=0)
    with pytest.raises(InputError, match="cannot be replaced"):
        env.replace_plan([(1.0, 0.0)])
    action = np.float32([5.0, 0.1])
    np.testing.assert_equal(env.step(action), other.step(action))


def test_any_world_can_have_a_driver_and_lose_it_and_its_keys_change_alone():
    world = guided().world
    assert guided(driver="none").world == dataclasses.replace(world, driver=None)
    np.testing.assert_array_equal(guided(driver="none").plan, RoomEnv().plan)
    assert guided(driver=None).world == world
    assert RoomEnv(driver={}).world.driver == world.driver
    driver = guided(driver={"look_ahead": 40}).world.driver
    assert (driver.look_ahead, driver.on_the_spot) == (40, 0.5)
    assert infos_of(RoomEnv(driver=driver))[-1]["planned_count"] == 0
