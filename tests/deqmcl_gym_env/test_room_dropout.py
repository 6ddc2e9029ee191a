"""BeamDropout: lost beams read +inf, the others as they were."""

import math

import numpy as np
import pytest
from room_cases import drive

from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.envs.wrappers import BeamDropout

BEAMS = {"lidar": {"beams": 100, "sigma": 5.0}}


def episode(env, seed: int = 5) -> tuple[np.ndarray, list]:
    """All scans of the plan's first 200 steps, (201, 100), and all else that was said."""
    scan, info = env.reset(seed=seed)
    said = drive(env, env.unwrapped.plan[:200])
    scans = np.array([scan, *(step[0] for step in said)])
    return scans, [info, *(step[1:] for step in said)]


@pytest.mark.parametrize("probability", [0.02, 0.5, 0.9])
def test_beams_are_lost_with_the_probability_independently_of_neighbours_and_the_last_scan(
    probability,
):
    scans, _ = episode(BeamDropout(RoomEnv(ends_at_goal=False, **BEAMS), probability))
    lost = np.isposinf(scans)
    both = probability**2  # two of them are lost
    for seen, share in (
        (lost, probability),
        (lost[:, 1:] & lost[:, :-1], both),
        (lost[1:] & lost[:-1], both),
    ):
        # 5 standard errors of a binomial share, false alarms 6e-7 each; a pair shares beams with
        # two others: at most √2 times the error
        assert abs(seen.mean() - share) < 5 * math.sqrt(2 * share * (1 - share) / seen.size)


def test_beams_that_are_not_lost_and_all_else_are_those_of_the_bare_env():
    bare, bare_rest = episode(RoomEnv(preset="matched", ends_at_goal=False, **BEAMS))
    thinned, rest = episode(
        BeamDropout(RoomEnv(preset="matched", ends_at_goal=False, **BEAMS), 0.3)
    )
    kept = np.isfinite(thinned)
    np.testing.assert_array_equal(thinned[kept], bare[kept])
    np.testing.assert_equal(rest, bare_rest)


@pytest.mark.parametrize("probability", [0, 1])
def test_probability_0_loses_nothing_and_1_everything(probability):
    bare, _ = episode(RoomEnv(ends_at_goal=False, **BEAMS))
    scans, _ = episode(BeamDropout(RoomEnv(ends_at_goal=False, **BEAMS), probability))
    np.testing.assert_array_equal(scans, bare if probability == 0 else np.inf)


def test_two_dropouts_lose_beams_independently():
    one, _ = episode(BeamDropout(RoomEnv(ends_at_goal=False, **BEAMS), 0.5))
    two, _ = episode(BeamDropout(BeamDropout(RoomEnv(ends_at_goal=False, **BEAMS), 0.5), 0.5))
    first, either = np.isinf(one), np.isinf(two)
    assert either[first].all()  # the inner one loses what it would lose alone
    # The outer one loses half of the rest, 5 standard errors: false alarms 6e-7.
    left = either[~first]
    assert abs(left.mean() - 0.5) < 5 * 0.5 / math.sqrt(left.size)


def test_what_is_lost_follows_from_the_seed_and_the_episode():
    env = BeamDropout(RoomEnv(ends_at_goal=False, **BEAMS), 0.5)
    first, _ = episode(env, seed=5)
    second, _ = episode(env, seed=None)
    again, _ = episode(env, seed=5)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(np.isinf(first), np.isinf(second))
