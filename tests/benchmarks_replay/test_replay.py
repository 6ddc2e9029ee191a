"""A localizer on a log: what it is given, and that a recorded lap is that lap again."""

import gymnasium as gym
import numpy as np
import pytest

import deqmcl_gym  # noqa: F401  # registers the envs
from benchmarks.setup.names import make_agent, scenario
from benchmarks.trials.episode import moments
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.envs.wrappers import RecordLog
from deqmcl_gym.logs import Log
from localizers import PointsBelief, make


def played(env, localizer, prior, rng):
    """Yield the moments of a localizer on a whole log."""
    return moments(env, make_agent("open-loop", None), localizer, lambda: prior, rng, seed=0)


class Spy:
    """Keeps all that it is given."""

    def __init__(self):
        self.given = []

    def reset(self, prior, plan, rng):
        self.given.append((plan,))
        return PointsBelief(np.zeros((1, 3)))

    def update(self, ranges, action, plan):
        self.given.append((ranges, action, plan))
        return PointsBelief(np.zeros((1, 3)))


@pytest.fixture(scope="module")
def lap():
    """A room, and the log of its lap."""
    env = RecordLog(gym.make("deqmcl_gym/Room-v0", preset="sharp", ends_at_goal=False))
    _, info = env.reset(seed=11)
    while info["planned_count"]:
        *_, info = env.step(info["planned_actions"][0])
    return env.unwrapped, env.log


@pytest.mark.parametrize("name", ["deq-mcl", "dead-reckoning"])
def test_a_replayed_lap_is_the_lap_but_for_the_rounding_of_its_odometry(lap, name):
    trial = Trial(scenario="sharp", localizer=name, params=(), lag=20, seed=5, trial=0)
    setup = scenario("sharp")
    room = setup.room()
    live = list(Stage.of(trial).moments())
    log = Log.of_episode(
        [moment.ranges for moment in live],
        [moment.action for moment in live[1:]],
        [moment.truth for moment in live],
        room.lidar,
        unit="px",
    )
    env = LogEnv(log=log, map=room.floor_plan, horizon=len(log))
    localizer = make(name, setup.robot_model(room))
    again = list(played(env, localizer, setup.prior_in(room), trial.filter_rng()))
    assert len(again) == len(live)
    for one, other in zip(live, again, strict=True):
        for mine, theirs in zip(one.belief.points(), other.belief.points(), strict=True):
            # an increment between two poses is off by 1e-13 px, below float32 of the particles
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9)


def test_a_localizer_is_given_arrays_that_do_not_depend_on_the_reference(lap):
    _, log = lap
    seen = []
    for reference in (log.reference, log.reference + 100.0, None):
        spy = Spy()
        other = Log(log.scanner, log.times, log.odometry, log.ranges, reference, log.unit)
        list(played(LogEnv(log=other), spy, None, np.random.default_rng(0)))
        seen.append(spy.given)
    np.testing.assert_equal(seen[1], seen[0])
    np.testing.assert_equal(seen[2], seen[0])
