"""A journey without the plan in view, whose goal is seen from the robot or from its belief."""

import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from refusals import refused

import deqmcl_gym  # noqa: F401
import localizers
from deqmcl_gym.envs.belief import BeliefObservation

ID = "deqmcl_gym/Journey-v1"
BLIND = {"plan": False, "goal": "relative"}


def seen_from(pose, goal):
    """Distance and bearing of a goal."""
    dx, dy = goal[0] - pose[0], goal[1] - pose[1]
    bearing = math.atan2(dy, dx) - pose[2]
    return [math.hypot(dx, dy), math.atan2(math.sin(bearing), math.cos(bearing))]


def test_the_goal_is_seen_from_the_true_pose_and_no_plan_is_seen():
    env = gym.make(ID, **BLIND)
    seen, info = env.reset(seed=3)
    goal = env.unwrapped.course.goal
    for _ in range(20):
        assert sorted(seen) == ["clock", "goal", "progress", "scan"]
        np.testing.assert_allclose(seen["goal"], seen_from(info["truth"], goal), atol=1e-5)
        assert env.observation_space.contains(seen)
        seen, *_, info = env.step(info["planned_actions"][0])


def test_many_rooms_see_the_same_as_single_ones():
    envs = gym.make_vec(ID, num_envs=3, **BLIND)
    seen, _ = envs.reset(seed=5)
    for room in range(3):
        own, _ = gym.make(ID, **BLIND).reset(seed=5 + room)
        for name, value in own.items():
            np.testing.assert_allclose(seen[name][room], value, atol=1e-5)


def test_the_goal_may_be_seen_from_the_belief():
    env = gym.make(ID, plan=False, floor_plan={"office": {"seed": 1}})
    room = env.unwrapped
    robot = localizers.RobotModel(floor_plan=room.floor_plan, lidar=room.lidar)
    anywhere = localizers.UniformPrior(floor_plan=room.floor_plan)
    view = BeliefObservation(
        env, localizers.make("mcl", robot, particles=50), anywhere, goal="relative"
    )
    seen, info = view.reset(seed=0)
    for _ in range(5):
        wanted = seen_from(seen["mean"], room.course.goal)
        np.testing.assert_allclose(seen["goal"], wanted, atol=1e-4)
        assert view.observation_space.contains(seen)
        seen, *_, info = view.step(info["planned_actions"][0])


def test_the_checker_of_gymnasium_finds_nothing():
    check_env(gym.make(ID, **BLIND).unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        (ID, {"goal": "left"}, "unknown goal 'left'"),
        (ID, {"plan": "no"}, "plan is 'no'"),
        ("deqmcl_gym/Room-v0", {"plan": False}, 'part of observation="dict" only'),
        ("deqmcl_gym/Room-v0", {"goal": "relative"}, "take Journey-v1"),
    ],
)
def test_what_cannot_be_seen_is_refused(name, options, words):
    with refused(words):
        gym.make(name, **options)
