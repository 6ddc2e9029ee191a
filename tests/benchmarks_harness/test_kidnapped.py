"""A robot kidnapped in the world: its belief's quality falls, and random poses find it again."""

from functools import partial

import numpy as np

import localizers
from benchmarks.setup.names import scenario
from benchmarks.trials.episode import moments
from deqmcl_gym.envs.wrappers import Kidnap

STEP, CARRIED_TO = 40, (300.0, 260.0, 2.5)


class TurnAbout:
    """Turns on the spot, whatever is planned."""

    def plan_at_reset(self, info):
        return None

    def act(self, belief, info):
        return np.array([0.0, 0.1], np.float32), None


def episode(seed=0, **params) -> tuple[np.ndarray, np.ndarray]:
    """Position errors and qualities of ``mcl-map`` in ``sharp``, on a robot that turns on the spot.

    The room looks the same after half a turn: the error is that to the nearer of the two poses.
    """
    sharp = scenario("sharp")
    room = sharp.room()
    localizer = localizers.make("mcl-map", sharp.robot_model(room), particles=2000, **params)
    env = Kidnap(room, STEP, CARRIED_TO)
    errors, qualities = [], []
    rng = np.random.default_rng(seed)
    prior = partial(sharp.prior_in, room)
    for moment in moments(env, TurnAbout(), localizer, prior, rng, seed=1):
        x, y, _ = localizers.mean_pose(*moment.belief.points())
        twin = np.array([350.0, 300.0]) - moment.truth[:2]
        errors.append(min(np.hypot(*(p - [x, y])) for p in (moment.truth[:2], twin)))
        qualities.append(localizers.quality_of(moment.belief))
        if moment.t == STEP + 60:
            break
    return np.array(errors), np.array(qualities)


def test_recovery_ends_a_kidnap():
    # In a room of right angles a fan of 90° fits some wrong poses too, so not every filter settles
    # on a right one in 60 steps: of seeds 0 to 11, on which this was written, two of three did.
    found = 0
    for seed in range(100, 108):
        errors, quality = episode(seed, recovery_alpha_slow=0.001, recovery_alpha_fast=0.1)
        assert errors[:STEP].max() < 10
        assert quality[5:STEP].min() > 0.9
        found += (np.median(errors[-20:]) < 10) & (np.median(quality[-20:]) > 0.9)
    assert found >= 3  # of 8 at 2/3 each: fewer in 2 %


def test_without_random_poses_the_robot_stays_lost_as_its_quality_tells_at_once_and_later():
    errors, quality = episode()
    assert quality[STEP : STEP + 3].min() < 0.1  # nine beams of 5 px
    lost = errors > 50
    assert lost[STEP:].all()
    assert not lost[:STEP].any()
    # now and then the wrong pose explains the scans: a fan of 90° in a room of right angles
    assert (quality[lost][:, None] < quality[~lost]).mean() > 0.9
