"""Localize-v0 and Track-v0: what is paid, what ends, and what a policy cannot get around."""

import math
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from believing import Believes
from room_cases import QUICK, SMALL

import deqmcl_gym  # noqa: F401
from benchmarks import evaluate
from deqmcl_gym.envs.acting import LocalizeEnv, Site, TrackEnv
from deqmcl_gym.maps import Office
from deqmcl_gym.world import PAPER_ROOM, Lidar, World
from localizers import GaussianPrior, PointsBelief, UniformPrior

MANY = QUICK | {"floor_plan": {"office": {**SMALL, "seeds": [10, 30]}}}
WORLD = World(floor_plan=PAPER_ROOM, lidar=Lidar(beams=4))
STAY, DECLARE = np.float32([0, 0, 0]), np.float32([0, 0, 1])
THERE = (175.0, 50.0, 0.0)


def test_an_office_is_drawn_in_the_range_by_the_seed_of_the_reset_and_all_is_made_for_it():
    env = gym.make("deqmcl_gym/Localize-v0", **MANY).unwrapped
    drawn = []
    for seed in (3, 3, None, None, 8):
        seen, info = env.reset(seed=seed)
        plan = Office(seed=info["building"], **SMALL).grid
        drawn.append(int(info["building"]))
        assert env.building == info["building"]
        assert env.world.floor_plan is env.floor_plan is env._localizer.robot.floor_plan is plan
        assert plan.free([info["truth"][:2]], env.radius)[0]
        poses, _ = env.belief.points()
        assert plan.free(poses[:, :2], env.radius).all()
        assert env.observation_space.contains(seen)
    assert drawn[0] == drawn[1]
    assert len(set(drawn)) > 2
    assert all(10 <= seed < 30 for seed in drawn)


class At:
    def sample(self, n, rng):
        return np.tile(THERE, (n, 1))


def localize(*said, shares=None, **task):
    believer = Believes(*(PointsBelief(poses, shares) for poses in said))
    site = Site(WORLD, believer, At())
    env = LocalizeEnv(site, hold=3, max_steps=20, **task)
    env.reset(seed=0)
    return env


def off(x=0.0, degrees=0.0):
    return [(THERE[0] + x, THERE[1], math.radians(degrees))]


RIGHT, WRONG = off(49, 29), off(51)


@pytest.mark.parametrize(
    ("said", "steps", "success"),
    [
        ([RIGHT], 2, True),  # the belief at reset counts
        ([RIGHT], 1, False),  # not long enough
        ([WRONG], 10, False),
        ([off(0, 31)], 10, False),
        ([RIGHT, RIGHT, WRONG, RIGHT], 4, False),  # not in a row
        ([RIGHT, RIGHT, WRONG, RIGHT], 5, True),
    ],
)
def test_a_declaration_is_right_if_the_best_cluster_was_right_for_long_enough(said, steps, success):
    env = localize(*said)
    paid = [env.step(STAY)[1] for _ in range(steps)]
    _, reward, terminated, truncated, info = env.step(DECLARE)
    assert paid == [-1.0] * steps
    assert (terminated, truncated, info["is_success"]) == (True, False, success)
    assert reward == (-1.0 if success else -41.0)


def test_a_vague_belief_is_not_enough_and_confidence_counts_the_sure_steps_in_a_row():
    here, there = off()[0], (100.0, 250.0, 1.0)
    vague = localize([here, there], shares=[89, 11])
    sure = localize([here, there], shares=[91, 9])
    assert [vague.step(STAY)[0]["confident"][0] for _ in range(3)] == [0, 0, 0]
    assert [sure.step(STAY)[0]["confident"][0] for _ in range(3)] == pytest.approx([2 / 3, 1, 1])
    assert not vague.step(DECLARE)[-1]["is_success"]
    assert sure.step(DECLARE)[-1]["is_success"]


def test_a_wrong_declaration_costs_more_than_anything_without_one():
    """Against a wall, every step costs 2."""
    env, paid, truncated = localize(WRONG), [], False
    for _ in range(2):
        env.step(np.float32([0, -math.pi / 4, 0]))
    while not truncated:
        _, reward, terminated, truncated, _ = env.step(np.float32([10, 0, 0]))
        paid.append(reward)
        assert not terminated
    assert paid[-10:] == [-2.0] * 10
    assert len(paid) == 18
    env.reset(seed=1)
    assert env.step(DECLARE)[1] < -2.0 * env.max_steps


def test_a_declaration_does_not_move_the_robot_and_ends_the_episode():
    env = localize(RIGHT)
    before = env.pose
    env.step(np.float32([10, 0.5, 1]))
    assert env.pose == before
    with pytest.raises(RuntimeError, match="call reset"):
        env.step(STAY)


def track(goal_off, **task):
    class Ends:
        def sample(self, n, rng):
            return np.array([THERE, off(goal_off)[0]])

    site = Site(WORLD, Believes(PointsBelief(off())), Ends())
    env = TrackEnv(site, GaussianPrior, least=0.0, max_steps=20, **task)
    env.reset(seed=0)
    return env


@pytest.mark.parametrize(("goal_off", "reward"), [(39, 100.0), (41, -100.0)])
def test_an_arrival_is_paid_when_it_is_declared_and_true(goal_off, reward):
    said = track(goal_off).step(np.float32([0, 0, 0, 1]))
    assert (said[1], said[2], said[4]["is_success"]) == (reward, True, reward > 0)


def test_scans_cost_and_without_one_the_localizer_gets_none():
    env = track(100)
    given = []
    update = env._localizer.update
    env._localizer.update = lambda ranges, *rest: given.append(ranges) or update(ranges, *rest)
    seen, reward, *_ = env.step(np.float32([0, 0, 1, 0]))
    assert (reward, seen["sensed"][0]) == (-1.0, 1.0)
    np.testing.assert_array_equal(given[0], seen["scan"])
    seen, reward, *_ = env.step(np.float32([0, 0, 0, 0]))
    assert (reward, seen["sensed"][0], seen["scan"].any()) == (0.0, 0.0, False)
    assert np.isnan(given[1]).all()


def test_a_contact_ends_the_drive_to_a_goal():
    env, terminated = track(100), False
    for _ in range(2):
        env.step(np.float32([0, -math.pi / 4, 0, 0]))
    while not terminated:
        _, reward, terminated, truncated, info = env.step(np.float32([10, 0, 0, 0]))
        assert reward == -100.0 * info["collided"]
    assert info["collided"]
    assert not truncated


def test_the_prior_of_a_drive_is_where_the_start_is_drawn_from():
    """Squared errors of 300 starts over their variances: χ² with 900 degrees of freedom."""
    given = []

    class Recorded(Believes):
        def reset(self, prior, plan, rng):
            given.append(prior)
            return super().reset(prior, plan, rng)

    around = partial(GaussianPrior, sd_position=5.0, sd_heading=0.1)
    anywhere = UniformPrior(floor_plan=PAPER_ROOM, radius=12.0)
    env = TrackEnv(Site(WORLD, Recorded(PointsBelief(off())), anywhere), around, least=150.0)
    errors = []
    for seed in range(300):
        _, info = env.reset(seed=seed)
        assert math.dist(info["truth"][:2], env.goal) >= 150.0
        x, y, turn = info["truth"] - given[-1].mean
        turn = (turn + math.pi) % (2 * math.pi) - math.pi
        errors += [x / 5, y / 5, turn / 0.1]
    assert abs(np.square(errors).sum() - 900) < 4 * math.sqrt(2 * 900)  # fails once in 16,000


def score(task, policy, **made):
    played = evaluate(task, policy, episodes=6, reference=None, **made)
    return played.row["return"]


def test_in_a_small_office_who_looks_for_information_beats_who_stands_still():
    assert score("Localize-v0", "still", **QUICK) < score("Localize-v0", "greedy", **QUICK)


def test_who_drives_and_looks_when_it_is_vague_beats_all_who_do_not_drive_or_look():
    best = score("Track-v0", "to-goal-if-vague")
    assert best > score("Track-v0", "to-goal-blind")
    assert best > max(score("Track-v0", name) for name in ("still", "spin", "random"))
