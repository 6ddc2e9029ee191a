"""The planned lap, and the reward: progress along it, and a bonus at its end."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from room_cases import FLOOR_PLANS, calm, closing_error, drive, poses_of, wrapped

from deqmcl_gym.envs import RoomEnv

# The corridors are 100 px wide, so the mid-corridor path has the corners (50, 50), (300, 50),
# (300, 250), (50, 250). From its bottom centre (175, 50): 125 px, 200, 250, 200, 125, in steps of
# 5 px 25 + 40 + 50 + 40 + 25 = 180; between them 4 turns of 90° in 6 steps of 15° each: 24.
LEGS = (25, 40, 50, 40, 25)
FULL = 900.0  # px: 2 · (250 + 200)
DRIVE, TURN = [5.0, 0.0], [0.0, math.pi / 12]
BY_HAND = np.float32(np.vstack([part for n in LEGS for part in ([TURN] * 6, [DRIVE] * n)][1:]))
DONE = FULL - 8 + 100  # the robot's rim at the line; the bonus
EXACT = 1e-9  # px: sums of some hundred float64 numbers below 1000


def test_the_paper_lap_is_the_204_actions_counted_by_hand_from_the_bottom_centre():
    assert len(BY_HAND) == 204
    np.testing.assert_array_equal(RoomEnv().plan, BY_HAND)
    assert RoomEnv().course.start == (175.0, 50.0, 0.0)
    np.testing.assert_array_equal(RoomEnv().reset(seed=0)[1]["truth"], (175.0, 50.0, 0.0))


@pytest.mark.parametrize("name", FLOOR_PLANS)
def test_the_lap_is_free_goes_once_counterclockwise_around_all_obstacles_and_earns_its_length(name):
    env = calm(floor_plan=FLOOR_PLANS[name], ends_at_goal=False)
    corners = env.course.path.corners
    lap = np.hstack([corners, np.roll(corners, -1, axis=0)])
    clearance = reference.clearance(env.floor_plan.walls, lap[:, :2], lap[:, 2:])
    assert clearance.min() > env.world.robot.radius
    for inside in (corners.mean(axis=0, keepdims=True), *env.floor_plan.obstacles):
        assert (reference.winding(lap, np.array(inside)) == 1).all()
    x, y, heading = env.pose
    said = drive(env, env.plan)
    assert not any(step[4]["collided"] for step in said)
    length = np.hypot(*(lap[:, 2:] - lap[:, :2]).T).sum()
    assert name != "paper" or length == FULL
    assert abs(sum(step[1] for step in said) - length) < closing_error(env.plan)
    end = said[-1][4]["truth"]
    assert math.hypot(end[0] - x, end[1] - y) < closing_error(env.plan)
    # one counterclockwise turn in all; waypoints, and so headings, are exact, float32 turns are not
    rounded = len(env.plan) * 2.0**-26
    assert abs(env.plan[:, 1].sum(dtype=float) - 2 * math.pi) < rounded
    assert abs(math.remainder(end[2] - heading, 2 * math.pi)) < rounded


def test_an_empty_room_has_its_lap_half_way_from_the_middle_to_the_corners():
    corners = RoomEnv(floor_plan=FLOOR_PLANS["empty"]).course.path.corners
    expected = [(87.5, 75), (262.5, 75), (262.5, 225), (87.5, 225)]
    assert sorted(map(tuple, corners.tolist())) == sorted(expected)


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


@pytest.mark.parametrize("rounding", [0.0, 1e-15, -1e-12])
def test_a_robot_that_has_not_moved_earns_nothing_wherever_else_the_path_is_nearer(rounding):
    path = RoomEnv().course.path
    for x, y, share in np.random.default_rng(3).uniform(0, 1, (50, 3)) * (350, 300, 1):
        arc = share * path.length
        assert path.follow((x, y), (x + rounding, y), arc) == (arc, 0.0)


def test_an_episode_is_done_when_the_robot_touches_the_start_line_after_a_full_turn():
    env, said = calm(), []
    while not (said and said[-1][2]):
        said.append(env.step(env.plan[len(said)]))
    # 5 px a step: one step before the end 5 px are missing, less than the radius 8; two before, 10.
    assert len(said) == 203
    assert not any(step[3] for step in said)
    assert abs(sum(step[1] for step in said) - DONE) < EXACT


@pytest.mark.parametrize("ends_at_goal", [True, False])
def test_a_plan_used_up_cuts_the_episode_off_and_does_not_end_the_task(ends_at_goal):
    env = calm(ends_at_goal=ends_at_goal)
    said = drive(env, np.zeros((204, 2)) if ends_at_goal else env.plan)
    assert not any(step[2] for step in said)
    assert [step[3] for step in said] == [False] * 203 + [True]


def beside_the_lap(env, offset, speed, lap=1) -> Iterator[tuple[float, float]]:
    """Drive ``offset`` px outside of the lap by the true pose; ``lap`` -1: the other way round."""
    (x0, y0), (x1, y1) = (50 - offset, 50 - offset), (300 + offset, 250 + offset)
    corners = [(x1, y0), (x1, y1), (x0, y1), (x0, y0)][::lap]
    corners = corners if lap > 0 else corners[-1:] + corners[:-1]
    while True:
        for corner in corners:
            while (way := math.dist(corner, env.pose[:2])) > 2:
                x, y, heading = env.pose
                turn = wrapped(math.atan2(corner[1] - y, corner[0] - x) - heading)
                most = math.pi / 12
                yield min(speed, way) if abs(turn) < most else 0.0, min(max(turn, -most), most)


def lap_then(env, after, action) -> Iterator[tuple[float, float]]:
    yield from itertools.islice(beside_the_lap(env, 0, 10), after)
    yield from itertools.repeat(action)


def returned(policy) -> tuple[float, bool, bool, int]:
    env = calm()
    total, touched = 0.0, False
    for steps, action in enumerate(policy(env), 1):
        _, reward, done, cut, info = env.step(np.asarray(action, np.float32))
        total, touched = total + reward, touched or info["collided"]
        if done or cut:
            return total, done, touched, steps
    raise AssertionError("the plan is never used up")


POLICIES = {
    **{f"{offset} px outside": lambda env, by=offset: beside_the_lap(env, by, 10)
       for offset in (-20, -9, -4, 4, 9, 20, 30)},
    **{f"slow, {offset} px outside": lambda env, by=offset: beside_the_lap(env, by, 5)
       for offset in (9, 20)},
    **{f"stops after {steps}": lambda env, n=steps: lap_then(env, n, (0.0, 0.0))
       for steps in (0, 40, 100, 105)},
    **{f"circles after {steps}": lambda env, n=steps: lap_then(env, n, (5.0, math.pi / 12))
       for steps in (0, 40, 105)},
    "into the wall": lambda env: itertools.chain([(0.0, -0.7)] * 2, itertools.repeat((10.0, 0.0))),
    "the other way round": lambda env: beside_the_lap(env, 0, 10, lap=-1),
}  # fmt: skip


@pytest.mark.parametrize("policy", POLICIES)
def test_no_way_of_driving_earns_more_than_the_lap_as_planned(policy):
    as_planned, done, touched, _ = returned(lambda env: env.plan)
    assert (done, touched) == (True, False)
    total, done, touched, steps = returned(POLICIES[policy])
    if done and not touched:  # as good a lap
        assert abs(total - as_planned) < EXACT
        assert steps < 204
    else:
        assert total <= as_planned - 10
    passes = {f"{offset} px outside" for offset in (-20, -9, -4, 4, 9, 20, 30)}
    assert done == (policy in passes)  # the line counts wherever it is crossed


@settings(max_examples=30)
@given(
    st.lists(st.tuples(st.floats(0, 10, width=32), st.floats(-0.75, 0.75, width=32)), min_size=1),
    st.booleans(),
)
def test_whatever_is_done_earns_its_progress_up_to_the_goal(turns, ends_at_goal):
    """The potential is min(progress, goal), so nothing can be gained on the way."""
    env = calm(ends_at_goal=ends_at_goal, lap={"waypoints": [(60, 60), (100, 60), (80, 90)]})
    earned = contacts = 0.0
    for action in itertools.islice(itertools.cycle(turns), len(env.plan)):
        _, reward, done, cut, info = env.step(np.float32(action))
        earned, contacts = earned + reward, contacts + info["collided"]
        goal = env.course.path.length - 8 if ends_at_goal else math.inf
        progress = env._begun.progress
        potential = min(progress, goal) + 100 * (progress >= goal) - 10 * contacts
        assert abs(earned - potential) < EXACT
        assert done == (progress >= goal)
        if done or cut:
            break


def test_the_reward_ignores_a_jump():
    env = calm(ends_at_goal=False)
    env.place((175, 250, math.pi))  # half a lap on
    assert abs(drive(env, [(5, 0)])[0][1] - 5) < EXACT
