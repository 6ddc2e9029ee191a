"""What a localizer may see, and what the methods of a trial share."""

import gymnasium as gym
import numpy as np
import pytest

from benchmarks.sweeps.suites import PAPER_METHODS, paper_suite
from benchmarks.trials.episode import moments, room_of, trial_moments
from benchmarks.trials.presets import ASSUMED
from deqmcl_gym.envs.wrappers import PlanChange
from localizers import CensoredGaussianUniform, make, names, parameters

LAG, PARTICLES, SEED = 4, 30, 11
OFFSETS = (0, -LAG, LAG)


class Liar(gym.Wrapper):
    """Says something else than the truth."""

    def __init__(self, env, lie):
        super().__init__(env)
        self._lie = np.array(lie)

    def reset(self, **options):
        ranges, info = self.env.reset(**options)
        return ranges, info | {"truth": self._lie}

    def step(self, action):
        *result, info = self.env.step(action)
        return *result, info | {"truth": self._lie}


def trials(localizers, scenario="paper", count=1):
    return paper_suite(
        scenario=scenario, localizers=localizers, trials=count, seed=5, lag=LAG, particles=PARTICLES
    )


def beliefs(env, name):
    """What is believed at each step and offset, as bytes; and the truth told."""
    room, assumed = env.unwrapped, ASSUMED["paper"]
    given = {"particles": PARTICLES, "lag": LAG}
    params = {k: v for k, v in given.items() if k in parameters(name)}
    localizer = make(name, assumed.robot_model(room), **params)
    rng = np.random.default_rng(3)
    believed, truth = [], []
    for moment in moments(env, localizer, assumed.prior(room), rng, seed=SEED):
        points = {k: moment.belief.points(k) for k in OFFSETS}
        believed.append(
            {k: None if p is None else (p[0].tobytes(), p[1].tobytes()) for k, p in points.items()}
        )
        truth.append(np.array(moment.truth))
    return believed, np.array(truth)


@pytest.mark.parametrize("name", names())
def test_garbage_in_place_of_the_truth_changes_no_belief(name):
    honest, truth = beliefs(room_of("paper"), name)
    for lie in ([1e6, -1e6, 99.0], [np.nan] * 3):
        deceived, told = beliefs(Liar(room_of("paper"), lie), name)
        assert np.array_equal(told, np.tile(lie, (len(truth), 1)), equal_nan=True)  # it got through
        assert deceived == honest
    assert len(honest) == len(room_of("paper").plan) + 1


def test_garbage_in_place_of_the_truth_changes_no_belief_where_the_plan_changes():
    def env():
        return PlanChange(room_of("paper"), 6, np.array([[3.0, 0.1]] * 12))

    honest, truth = beliefs(env(), "deq-mcl")
    assert len(truth) == 1 + 6 + 12
    assert beliefs(Liar(env(), [np.inf] * 3), "deq-mcl")[0] == honest
    assert honest[:19] != beliefs(room_of("paper"), "deq-mcl")[0][:19]  # the new plan did matter


@pytest.mark.parametrize("scenario", list(ASSUMED))
def test_all_methods_of_a_trial_see_the_same_world(scenario):
    worlds = {
        trial.localizer: [
            (moment.truth.tobytes(), moment.ranges.tobytes()) for moment in trial_moments(trial)
        ]
        for trial in trials(PAPER_METHODS, scenario)
    }
    assert all(world == worlds["mcl"] for world in worlds.values())


def test_different_trials_see_different_worlds_and_start_from_different_clouds():
    first, second = (next(iter(trial_moments(t))) for t in trials(["mcl"], count=2))
    assert (first.ranges != second.ranges).any()
    assert (first.belief.points(0)[0] != second.belief.points(0)[0]).all()


def start_of(name):
    (trial,) = trials([name])
    return next(iter(trial_moments(trial))).belief.points(0)


@pytest.mark.parametrize("name", ["mcl-smoother", "mcl-map", "mcl-map-smoother"])
def test_methods_without_a_future_start_from_the_same_cloud(name):
    for ours, theirs in zip(start_of(name), start_of("mcl"), strict=True):
        assert ours.tobytes() == theirs.tobytes()


def test_deq_mcl_starts_from_the_same_draws_resampled():
    draws = {row.tobytes() for row in start_of("mcl")[0]}
    poses, weights = start_of("deq-mcl")
    assert len(draws) == len(poses) == PARTICLES
    assert {row.tobytes() for row in poses} <= draws
    assert weights.sum() == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("scenario", list(ASSUMED))
def test_an_episode_runs_every_planned_step_once(scenario):
    (trial,) = trials(["dead-reckoning"], scenario)
    steps = [moment.step for moment in trial_moments(trial)]
    room = room_of(scenario)
    if room.world.driver is None:
        assert steps == list(range(len(room.plan) + 1))
    else:  # until the driver is round, which the noise decides
        assert steps == list(range(len(steps)))
        assert 0.9 * len(room.plan) < len(steps) < 1.2 * len(room.plan)


def test_all_methods_are_driven_the_same_way_in_the_guided_world_of_a_trial():
    ways = [
        np.array([moment.truth for moment in trial_moments(trial)])
        for trial in trials(["dead-reckoning", "mcl", "deq-mcl"], "guided")
    ]
    np.testing.assert_array_equal(ways[0], ways[1])
    np.testing.assert_array_equal(ways[0], ways[2])


def test_guided_worlds_differ_in_their_number_of_steps():
    counts = {len(list(trial_moments(t))) for t in trials(["dead-reckoning"], "guided", 6)}
    assert len(counts) > 1


@pytest.mark.parametrize("scenario", ["matched", "guided"])
def test_the_filters_are_told_exactly_the_world_where_calibration_is_judged(scenario):
    world, assumed = room_of(scenario).world, ASSUMED[scenario]
    start = world.start
    assert vars(assumed.motion) == vars(world.noise)
    assert isinstance(assumed.scan, CensoredGaussianUniform)
    assert assumed.scan.sigma == world.lidar.sigma
    assert assumed.start_sd_position == start.sd_position
    assert assumed.start_sd_heading == start.sd_heading


@pytest.mark.parametrize("scenario", list(ASSUMED))
def test_the_prior_is_centred_on_the_planned_start_not_on_the_truth(scenario):
    room = room_of(scenario)
    assert ASSUMED[scenario].prior(room).mean == room.course.start
    truths = {tuple(room.reset(seed=seed)[1]["truth"]) for seed in range(3)}
    assert ASSUMED[scenario].prior(room).mean == room.course.start
    assert len(truths) == (
        3 if scenario in ("matched", "guided") else 1
    )  # drawn from the prior, or the start
