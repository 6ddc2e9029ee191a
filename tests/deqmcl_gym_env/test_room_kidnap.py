"""Kidnap: one jump before one step, everything else as it was."""

import math

import numpy as np
import pytest
import reference
from room_cases import SEVERAL, calm, poses_of, wrapped

from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.envs.wrappers import Kidnap

ELSEWHERE = (60.0, 200.0, 1.0)


def kidnapped(step: int, pose=None, **kwargs) -> Kidnap:
    return Kidnap(RoomEnv(ends_at_goal=False, **kwargs), step=step, pose=pose)


@pytest.mark.parametrize("step", [1, 4, 204])
def test_the_robot_takes_the_given_step_of_each_episode_from_the_given_pose(step):
    env = Kidnap(calm(ends_at_goal=False), step=step, pose=ELSEWHERE)
    x, y, heading = ELSEWHERE
    for _ in range(2):
        env.reset()
        poses = poses_of(env, [*np.zeros((step - 1, 2)), (5, 0)])
        np.testing.assert_array_equal(poses[:-1], [(175, 50, 0)] * (step - 1) or np.empty((0, 3)))
        expected = (x + 5 * math.cos(heading), y + 5 * math.sin(heading), heading)
        np.testing.assert_allclose(poses[-1], expected, rtol=0, atol=1e-10)  # float64 below 1000


@pytest.mark.parametrize("pose", [ELSEWHERE, None])
def test_noise_and_everything_told_but_the_truth_stay_those_of_the_unkidnapped_robot(pose):
    # With seed 3 the random pose has room ahead for the 15 steps, too: "collided" agrees.
    slow = {"lap": {"step": 1.0}}
    usual, taken = RoomEnv(ends_at_goal=False, **slow), kidnapped(10, pose, **slow)
    mine, theirs = ([env.reset(seed=3)[1]] for env in (usual, taken))
    for action in usual.plan[:25]:
        mine.append(usual.step(action)[4])
        theirs.append(taken.step(action)[4])
    for key in ("planned_actions", "planned_count", "action", "collided"):
        np.testing.assert_array_equal(*([info[key] for info in told] for told in (mine, theirs)))
    truths, elsewhere = (np.array([info["truth"] for info in told]) for told in (mine, theirs))
    np.testing.assert_array_equal(truths[:10], elsewhere[:10])
    # From there on both turn and drive with the same errors, each in its own direction;
    # float64 numbers below 400 are exact to 6e-14.
    turns = [wrapped(np.diff(poses[10:, 2])) for poses in (truths, elsewhere)]
    ways = [
        np.linalg.norm(np.diff(poses[10:, :2], axis=0), axis=1) for poses in (truths, elsewhere)
    ]
    np.testing.assert_allclose(*turns, rtol=0, atol=1e-12)
    np.testing.assert_allclose(*ways, rtol=0, atol=1e-12)


def random_poses(seed: int, count: int, **kwargs) -> np.ndarray:
    env = kidnapped(1, **kwargs)
    poses = []
    for episode in range(count):
        env.reset(seed=seed if episode == 0 else None)
        poses.append(env.step(np.zeros(2, np.float32))[4]["truth"])
    return np.array(poses)


def test_a_random_pose_follows_from_the_seed_and_differs_between_episodes():
    first = random_poses(1, 3)
    np.testing.assert_array_equal(random_poses(1, 3), first)
    assert len(np.unique(np.vstack([first, random_poses(2, 3)]), axis=0)) == 6


def test_random_poses_are_free_and_all_over_the_floor():
    poses = random_poses(1, 300, floor_plan=SEVERAL)
    walls = RoomEnv(floor_plan=SEVERAL).floor_plan.walls
    assert reference.clearance(walls, poses, poses).min() > 8.0 - 1e-4  # decided in float32
    assert (reference.winding(walls, poses) == 1).all()
    # Each quarter of the box has over 10 % of the free space, each quarter turn 25 % of the
    # headings: P(fewer than 8 of 300) is below 1e-6.
    quarters = (poses[:, 0] > 250) + 2 * (poses[:, 1] > 200)
    assert np.bincount(quarters, minlength=4).min() >= 8
    assert np.bincount(((poses[:, 2] + math.pi) // (math.pi / 2)).astype(int)).min() >= 8


def kidnapped_twice(seed: int, below) -> list[np.ndarray]:
    env = Kidnap(below(RoomEnv(ends_at_goal=False)), step=3)
    env.reset(seed=seed)
    return list(poses_of(env, np.zeros((3, 2))))


def test_two_random_kidnaps_draw_poses_of_their_own_and_fixed_ones_none():
    _, once = kidnapped_twice(1, lambda env: env)[1:]
    _, first, second = kidnapped_twice(1, lambda env: Kidnap(env, step=2))
    np.testing.assert_array_equal(first, once)  # the inner one draws what it would draw alone
    assert abs(second - first).max() > 1
    _, fixed, random = kidnapped_twice(1, lambda env: Kidnap(env, step=2, pose=ELSEWHERE))
    np.testing.assert_allclose(fixed, ELSEWHERE, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(random, once)
