"""Reward is progress along the lap and a bonus at its end; giving up is no end of the task."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from room_cases import FLOOR_PLANS, calm, closing_error, drive, wrapped

from deqmcl_gym.envs.room import RoomEnv

FULL = 900.0  # px: the paper's lap, 2 · (250 + 200)
DONE = FULL - 8 + 100  # the robot's rim at the line; the bonus
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


def test_an_episode_is_done_when_the_robot_touches_the_start_line_after_a_full_turn():
    env, said = calm(), []
    while not (said and said[-1][2]):
        said.append(env.step(env.plan[len(said)]))
    # 5 px a step: one step before the end 5 px are missing, less than the radius 8; two before, 10.
    assert len(said) == 203
    assert not any(step[3] for step in said)
    assert abs(rewards_of(said).sum() - DONE) < EXACT


@pytest.mark.parametrize("ends_at_goal", [True, False])
def test_a_plan_used_up_cuts_the_episode_off_and_does_not_end_the_task(ends_at_goal):
    env = calm(ends_at_goal=ends_at_goal)
    said = drive(env, np.zeros((204, 2)) if ends_at_goal else env.plan)
    assert not any(step[2] for step in said)
    assert [step[3] for step in said] == [False] * 203 + [True]


def beside_the_lap(env, offset, speed, lap=1) -> Iterator[tuple[float, float]]:
    """Drive the lap ``offset`` px outside of it, in steps of ``speed``, as one who knows the pose.

    ``lap`` -1 is the other way round.
    """
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


def stops(env, after) -> Iterator[tuple[float, float]]:
    yield from itertools.islice(beside_the_lap(env, 0, 10), after)
    yield from itertools.repeat((0.0, 0.0))


def circles(env, after) -> Iterator[tuple[float, float]]:
    yield from itertools.islice(beside_the_lap(env, 0, 10), after)
    yield from itertools.repeat((5.0, math.pi / 12))


def returned(policy) -> tuple[float, bool, bool, int]:
    """What a policy earns; whether it did the task, and touched a wall; its steps."""
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
    **{f"stops after {steps}": lambda env, n=steps: stops(env, n) for steps in (0, 40, 100, 105)},
    **{f"circles after {steps}": lambda env, n=steps: circles(env, n) for steps in (0, 40, 105)},
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


@settings(deadline=None, max_examples=30)
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


def lap_in_large_steps(side: int) -> list[tuple[float, float]]:
    """The paper's lap in 10 px drives, with turns of ±90°, after one turn into its direction."""
    actions = [] if side > 0 else [(0, math.pi)]
    for i, leg in enumerate((125, 200, 250, 200, 125)):
        actions += [(0, side * math.pi / 2)] * (i > 0) + [(10, 0)] * (leg // 10)
        actions += [(5, 0)] * (leg % 10 == 5)
    return actions


@pytest.mark.parametrize(("side", "progress"), [(1, DONE), (-1, -FULL)])
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
