"""A localizer inside the env: its belief is observed."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from believing import Believes
from room_cases import ROOM_ID

import deqmcl_gym  # noqa: F401
from deqmcl_gym.envs.belief import BeliefObservation
from deqmcl_gym.envs.wrappers import BeamDropout, Kidnap, RecordLog
from deqmcl_gym.validation import InputError
from localizers import GaussianPrior, PointsBelief, RobotModel, make

PRIOR = GaussianPrior(mean=(175.0, 50.0, 0.0))


def with_belief(env, name="mcl", **params):
    room = env.unwrapped
    robot = RobotModel(floor_plan=room.floor_plan, lidar=room.lidar)
    return BeliefObservation(env, make(name, robot, **params), PRIOR)


def sharp(**kwargs):
    return gym.make(ROOM_ID, preset="sharp", horizon=20, **kwargs)


@pytest.mark.parametrize("observation", ["scan", "dict"])
def test_the_belief_is_that_of_the_localizer_run_by_hand(observation):
    env = with_belief(sharp(observation=observation), particles=50)
    room = sharp()
    robot = RobotModel(floor_plan=room.unwrapped.floor_plan, lidar=room.unwrapped.lidar)
    localizer = make("mcl", robot, particles=50)
    (seen, info), (scan, _) = env.reset(seed=3), room.reset(seed=3)
    assert set(seen) >= {"scan", "mean", "covariance", "entropy"}
    (rng,) = np.random.default_rng(np.random.SeedSequence(3)).spawn(1)
    belief = localizer.reset(PRIOR, info["planned_actions"], rng)
    for _ in range(10):
        poses, weights = belief.points()
        np.testing.assert_array_equal(seen["scan"], scan)
        mean = np.average(poses[:, :2], axis=0, weights=weights)
        np.testing.assert_allclose(seen["mean"][:2], mean, atol=1e-4)
        spread = np.cov(poses[:, :2].T, aweights=weights, ddof=0)
        np.testing.assert_allclose(seen["covariance"][:2, :2], spread, rtol=1e-5, atol=1e-3)
        assert env.observation_space.contains(seen)
        action = info["planned_actions"][0]
        scan = room.step(action)[0]
        seen, *_, info = env.step(action)
        belief = localizer.update(scan, action, info["planned_actions"])
    again = [env.reset()[0]["covariance"] for _ in range(2)]
    assert (again[0] != again[1]).any()  # each episode draws anew


def about_half_a_turn():
    return PointsBelief([(0, 0, 3.0), (2, 0, -3.0)], [1, 3])


def test_moments_entropy_and_the_single_cluster_of_a_belief_computed_by_hand():
    seen, _ = BeliefObservation(sharp(), Believes(about_half_a_turn()), PRIOR).reset(seed=0)
    a, b = 1 * np.exp(3.0j), 3 * np.exp(-3.0j)
    heading = np.angle(a + b)
    off = np.angle(np.exp(1j * (np.array([3.0, -3.0]) - heading)))
    cloud = np.array([(-1.5, 0.0, off[0]), (0.5, 0.0, off[1])])
    covariance = (cloud.T * [0.25, 0.75]) @ cloud
    np.testing.assert_allclose(seen["mean"], (1.5, 0.0, heading), rtol=1e-6)
    np.testing.assert_allclose(seen["covariance"], covariance, rtol=1e-5, atol=1e-7)
    floored = covariance + np.diag([0.01, 0.01, 1e-6])
    entropy = 0.5 * np.log(np.linalg.det(2 * np.pi * np.e * floored))
    assert seen["entropy"][0] == pytest.approx(entropy, rel=1e-5)
    assert "quality" not in seen
    assert (seen["best_share"], seen["second_share"]) == (1, 0)  # a single cluster
    np.testing.assert_array_equal(seen["second"], seen["best"])


def test_a_quality_is_shown_where_there_is_one():
    (belief := about_half_a_turn()).quality = 0.25
    env = BeliefObservation(sharp(), Believes(belief), PRIOR)
    assert env.reset(seed=0)[0]["quality"] == np.float32([0.25])
    assert env.observation_space["quality"] == gym.spaces.Box(0.0, 1.0, (1,))


def test_clusters_particles_and_occupancy_of_a_belief_computed_by_hand():
    apart = Believes(PointsBelief([(10, 10, 0.0), (12, 10, 0.0), (300, 160, 1.0)], [2, 1, 1]))
    env = BeliefObservation(sharp(), apart, PRIOR, particles=200, cell=100.0)
    seen, _ = env.reset(seed=0)
    np.testing.assert_allclose(seen["best"], (32 / 3, 10, 0), atol=1e-5)
    np.testing.assert_allclose(seen["second"], (300, 160, 1), rtol=1e-6)
    assert (seen["best_share"], seen["second_share"]) == (0.75, 0.25)
    image = np.zeros((3, 4))
    image[0, 0], image[1, 3] = 0.75, 0.25
    np.testing.assert_array_equal(seen["occupancy"], image)
    drawn = (seen["particles"][:, 0] == 300).mean()
    assert abs(drawn - 0.25) < 4 * (0.25 * 0.75 / 200) ** 0.5  # once in 16,000 seeds it is not
    assert env.observation_space.contains(seen)
    assert len(env.belief.points()[0]) == 3


def test_particles_are_drawn_from_weights_whatever_their_sum():
    """The harness takes sums within 1e-3 of 1: so do the envs."""
    seen, poses = [], np.array([(10.0, 10, 0), (300, 160, 1)])
    for total in (1.0, 1.0 + 1e-6):
        belief = PointsBelief(poses)
        belief.points = lambda offset=0, w=0.5 * total: (poses, np.array([w, w]))
        env = BeliefObservation(sharp(), Believes(belief), PRIOR, particles=20)
        seen.append(env.reset(seed=0)[0]["particles"])
    np.testing.assert_array_equal(*seen)


def test_envs_of_one_spec_have_localizers_of_their_own():
    first = with_belief(sharp(), particles=20)
    before = first.reset(seed=1)[0]["covariance"]
    second, third = gym.make(first.spec), gym.make(first.spec)
    second.reset(seed=1), third.reset(seed=2)
    action = np.float32([5, 0.1])
    moved = first.step(action)[0]  # as if the others were not there
    np.testing.assert_equal(second.step(action)[0], moved)
    assert (third.step(action)[0]["covariance"] != moved["covariance"]).any()
    assert (moved["covariance"] != before).any()


def test_other_wrappers_may_be_inside():
    env = with_belief(Kidnap(sharp(), step=2, pose=(60, 200, 1.0)), particles=20)
    env.reset(seed=0)
    env.step(np.float32([5, 0]))
    *_, info = env.step(np.float32([5, 0]))
    assert info["truth"][0] < 100


def test_wrong_places_are_refused():
    with pytest.raises(InputError, match="needs scans of 9 beams: put BeliefObservation inside"):
        with_belief(gym.wrappers.FrameStackObservation(sharp(), 3))
    with pytest.raises(InputError, match="localizer is 'mcl', but must have reset and update"):
        BeliefObservation(sharp(), "mcl", PRIOR)
    with pytest.raises(InputError, match="made for 9 beams, but the env's lidar has 7"):
        BeliefObservation(sharp(lidar={"beams": 7}), with_belief(sharp())._localizer, PRIOR)
    for wrap in (RecordLog, partial(BeamDropout, probability=0.1)):
        with pytest.raises(InputError, match='of observation="scan"'):
            wrap(sharp(observation="dict"))
