"""The planned lap: in the paper's room recomputed by hand, elsewhere by its properties."""

import math

import numpy as np
import pytest
import reference
from room_cases import FLOOR_PLANS, SEVERAL, TRIANGLE, calm, closing_error, poses_of
from scipy.spatial import ConvexHull

from deqmcl_gym.envs.room import RoomEnv

# The corridors are 100 px wide, so the mid-corridor path has the corners (50, 50), (300, 50),
# (300, 250), (50, 250). From its bottom centre (175, 50): 125 px, 200, 250, 200, 125, in steps of
# 5 px 25 + 40 + 50 + 40 + 25 = 180; between them 4 turns of 90° in 6 steps of 15° each: 24.
LEGS = (25, 40, 50, 40, 25)
DRIVE, TURN = [5.0, 0.0], [0.0, math.pi / 12]
BY_HAND = np.float32(np.vstack([part for n in LEGS for part in ([TURN] * 6, [DRIVE] * n)][1:]))


def test_the_paper_lap_is_the_204_actions_counted_by_hand_from_the_bottom_centre():
    assert len(BY_HAND) == 204
    np.testing.assert_array_equal(RoomEnv().plan, BY_HAND)
    assert RoomEnv().course.start == (175.0, 50.0, 0.0)
    np.testing.assert_array_equal(RoomEnv().reset(seed=0)[1]["truth"], (175.0, 50.0, 0.0))


@pytest.mark.parametrize("name", FLOOR_PLANS)
def test_the_lap_is_free_goes_once_counterclockwise_around_all_obstacles_and_back(name):
    env = calm(floor_plan=FLOOR_PLANS[name], ends_at_goal=False)
    corners = env.course.path.corners
    lap = np.hstack([corners, np.roll(corners, -1, axis=0)])
    clearance = reference.clearance(env.floor_plan.walls, lap[:, :2], lap[:, 2:])
    assert clearance.min() > env.world.robot.radius
    for inside in (corners.mean(axis=0, keepdims=True), *env.floor_plan.obstacles):
        assert (reference.winding(lap, np.array(inside)) == 1).all()
    x, y, heading = env.pose
    said = [env.step(action)[4] for action in env.plan]
    assert not any(info["collided"] for info in said)
    end = said[-1]["truth"]
    assert math.hypot(end[0] - x, end[1] - y) < closing_error(env.plan)
    # one counterclockwise turn in all; waypoints, and so headings, are exact, float32 turns are not
    rounded = len(env.plan) * 2.0**-26
    assert abs(env.plan[:, 1].sum(dtype=float) - 2 * math.pi) < rounded
    assert abs(math.remainder(end[2] - heading, 2 * math.pi)) < rounded


def test_the_lap_halves_the_way_from_each_obstacle_corner_to_the_outer_wall():
    # The triangle's corner (120, 90): unit edge vectors in and out, their difference bisects.
    env = RoomEnv(floor_plan=TRIANGLE)
    a, b, c = (np.array(corner, float) for corner in TRIANGLE["obstacles"][0])
    outwards = (a - b) / np.linalg.norm(a - b) + (a - c) / np.linalg.norm(a - c)
    # From (120, 90) down-left, the wall y = 0 or x = 0 comes first:
    reach = min(90 / -outwards[1], 120 / -outwards[0])
    middle = a + outwards * reach / 2
    distance = np.linalg.norm(env.course.path.corners - middle, axis=1).min()
    # corners are rounded to 0.01 px, after float32 ranges begun 0.002 px off the corner
    assert distance < 0.01


def test_an_empty_room_has_its_lap_half_way_from_the_middle_to_the_corners():
    corners = RoomEnv(floor_plan=FLOOR_PLANS["empty"]).course.path.corners
    expected = [(87.5, 75), (262.5, 75), (262.5, 225), (87.5, 225)]
    assert sorted(map(tuple, corners.tolist())) == sorted(expected)


def test_given_waypoints_are_driven_in_their_order():
    waypoints = [(40, 40), (310, 60), (300, 260), (60, 240)]
    env = calm(lap={"waypoints": waypoints}, ends_at_goal=False)
    np.testing.assert_array_equal(env.course.path.corners, waypoints)
    poses = poses_of(env, env.plan)
    ways = np.linalg.norm(poses[:, None, :2] - np.array(waypoints), axis=2)
    assert (ways.min(axis=0) < closing_error(env.plan)).all()
    assert (np.diff(ways.argmin(axis=0)[[1, 2, 3, 0]]) > 0).all()  # begun between 0 and 1


def test_steps_are_as_large_as_asked_and_the_last_one_is_the_rest():
    plan = RoomEnv(lap={"step": 8.0, "turn": 0.7}, robot={"max_turn": 0.8}).plan
    # 125 = 15 · 8 + 5; 90° = 2 · 0.7 + 0.1708
    np.testing.assert_array_equal(plan[:16, 0], [8.0] * 15 + [5.0])
    np.testing.assert_array_equal(plan[16:19, 1], np.float32([0.7, 0.7, math.pi / 2 - 1.4]))


def test_a_start_off_the_lap_drives_to_its_nearest_point_and_once_around_to_there():
    env = calm(start={"pose": (30, 150, 1.0)}, ends_at_goal=False)
    poses = poses_of(env, env.plan)
    tolerance = closing_error(env.plan)
    distance = np.hypot(poses[:, 0] - 50, poses[:, 1] - 150)  # (50, 150) is nearest
    arrived = int((distance < tolerance).argmax())
    # turn by -1 rad in 4 steps of 15° at most, drive 20 px in 4 steps
    assert arrived == 4 + 4 - 1
    assert distance[-1] < tolerance
    assert abs(env.plan[arrived + 1 :, 0].sum() - 900) < 1e-3  # float32 sum of 180 exact numbers


def test_several_obstacles_are_gone_around_by_their_hull():
    points = np.vstack([np.array(obstacle) for obstacle in SEVERAL["obstacles"]])
    lap = RoomEnv(floor_plan=SEVERAL).course.path.corners
    assert len(lap) == len(ConvexHull(points).vertices)
