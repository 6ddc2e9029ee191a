"""Reward is progress along the lap; episodes end at the goal or with the plan."""

import math

import numpy as np
import pytest
from room_cases import FLOOR_PLANS, calm, closing_error, drive

from deqmcl_gym.envs.room import RoomEnv

FULL = 900.0  # px: the paper's lap, 2 · (250 + 200)
EXACT = 1e-9  # px: sums of some hundred float64 numbers below 1000


def rewards_of(said: list[tuple]) -> np.ndarray:
    return np.array([step[1] for step in said])


@pytest.mark.parametrize("name", FLOOR_PLANS)
def test_without_noise_the_rewards_of_a_lap_add_up_to_its_length(name):
    env = calm(floor_plan=FLOOR_PLANS[name], ends_at_goal=False)
    corners = env.course.path.corners
    length = np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1).sum()
    assert name != "paper" or length == FULL
    total = rewards_of(drive(env, env.plan)).sum()
    assert abs(total - length) < closing_error(env.plan)


@pytest.mark.parametrize("name", FLOOR_PLANS)
def test_the_arc_of_a_point_is_that_of_the_nearest_of_many_points_on_the_path(name):
    path = RoomEnv(floor_plan=FLOOR_PLANS[name]).course.path
    spacing = 0.1
    arcs = np.arange(0, path.length, spacing)
    dense = np.array([path.at(arc)[:2] for arc in arcs])
    for point in np.random.default_rng(2).uniform(0, 400, (200, 2)):
        distances = np.hypot(*(dense - point).T)
        arc = path.arc(tuple(point.tolist()))
        # Nearer than every sample, and within half a spacing of one that is as near.
        assert math.dist(path.at(arc)[:2], point) <= distances.min() + EXACT
        i = int(np.abs((arcs - arc + path.length / 2) % path.length - path.length / 2).argmin())
        assert distances[i] - distances.min() < spacing


@pytest.mark.parametrize("rounding", [0.0, 1e-15, -1e-12])
def test_a_robot_that_has_not_moved_earns_nothing_wherever_else_the_path_is_nearer(rounding):
    path = RoomEnv().course.path
    for x, y, share in np.random.default_rng(3).uniform(0, 1, (50, 3)) * (350, 300, 1):
        arc = share * path.length
        assert path.follow((x, y), (x + rounding, y), arc) == (arc, 0.0)


def test_with_noise_rewards_telescope_to_the_way_between_the_projections_of_start_and_end():
    env = RoomEnv(ends_at_goal=False)
    env.reset(seed=6)
    said = drive(env, env.plan[:20])  # along the bottom side, where the arc length is x
    assert not any(step[4]["collided"] for step in said)
    assert abs(rewards_of(said).sum() - (env.pose[0] - 175)) < EXACT


def test_a_drive_along_the_lap_earns_its_distance_a_turn_nothing_and_back_is_negative():
    env = calm(robot={"max_turn": math.pi}, ends_at_goal=False)
    forth, turn, back = rewards_of(drive(env, [(5, 0), (0, math.pi), (5, 0)]))
    assert abs(forth - 5) < EXACT
    assert abs(turn) < EXACT
    # π in float32 is off by 9e-8 rad: the way back is 5 cos(9e-8) = 5 px to 2e-14
    assert abs(back + 5) < EXACT


def test_a_collision_costs_ten():
    env = calm(start={"pose": (175, 30, -math.pi / 2)}, ends_at_goal=False)
    said = drive(env, [(10, 0), (10, 0), (10, 0), (10, 0)])
    # Towards the wall y = 0, across the lap: no progress; the rim touches after 22 px.
    assert [step[4]["collided"] for step in said] == [False, False, True, True]
    np.testing.assert_allclose(rewards_of(said), [0, 0, -10, -10], rtol=0, atol=EXACT)


def test_an_episode_ends_within_a_radius_of_the_start_after_a_full_turn():
    env, said = calm(), []
    while not (said and said[-1][2]):
        said.append(env.step(env.plan[len(said)]))
    # 5 px a step: one step before the end 5 px are missing, less than the radius 8; two before, 10.
    assert len(said) == 203
    assert not any(step[3] for step in said)
    assert abs(rewards_of(said).sum() - (FULL - 5)) < closing_error(env.plan)


@pytest.mark.parametrize("ends_at_goal", [True, False])
def test_an_episode_ends_with_the_plan_wherever_the_robot_is(ends_at_goal):
    env = calm(ends_at_goal=ends_at_goal)
    actions = np.zeros((204, 2)) if ends_at_goal else env.plan
    assert [step[2] for step in drive(env, actions)] == [False] * 203 + [True]


def lap_in_large_steps(side: int) -> list[tuple[float, float]]:
    """The paper's lap in 10 px drives, with turns of ±90°, after one turn into its direction."""
    actions = [] if side > 0 else [(0, math.pi)]
    for i, leg in enumerate((125, 200, 250, 200, 125)):
        actions += [(0, side * math.pi / 2)] * (i > 0) + [(10, 0)] * (leg // 10)
        actions += [(5, 0)] * (leg % 10 == 5)
    return actions


@pytest.mark.parametrize(("side", "progress"), [(1, FULL - 5), (-1, -FULL)])
def test_a_clockwise_lap_does_not_count(side, progress):
    env = calm(robot={"max_turn": math.pi})
    *underway, last = lap_in_large_steps(side)
    said = drive(env, underway)  # 5 px before the start, less than the radius
    assert [step[2] for step in said] == [False] * (len(underway) - 1) + [side > 0]
    # Turns by float32 right angles: 5 errors of 1e-7 rad over 900 px are below 1e-3 px.
    assert math.dist(env.pose[:2], (175, 50)) < 5 + 1e-3
    if side < 0:
        said += drive(env, [last])
        assert not said[-1][2]
    assert abs(rewards_of(said).sum() - progress) < 1e-3


def test_half_a_lap_and_back_does_not_count():
    env = calm(robot={"max_turn": math.pi})
    forth = lap_in_large_steps(1)[:40]
    back = [(0, math.pi), *((distance, -turn) for distance, turn in forth[::-1])]
    said = drive(env, [*forth, *back])
    assert math.dist(env.pose[:2], (175, 50)) < 1e-3
    assert not any(step[2] for step in said)
    assert abs(rewards_of(said).sum()) < 1e-3


def test_the_reward_ignores_a_jump():
    env = calm(ends_at_goal=False)
    env.place((175, 250, math.pi))  # half a lap on
    assert abs(drive(env, [(5, 0)])[0][1] - 5) < EXACT
