"""The quality of a belief: the two-state hidden Markov model, and what it is for."""

import itertools
import math
from functools import partial

import numpy as np
import pytest
from following import follow, robot_of, small, started

import localizers
from deqmcl_gym.maps import Lidar, PolygonMap
from localizers.inference.loss_detector import FOUND_AGAIN, LOST, MEMORY, LossDetector
from localizers.inference.particles import log_evidence
from localizers.models.prior import even_poses
from localizers.models.scan import Scan

# The weights of amcl's field differ by a factor of 3 at most.
OWN = {"grid": {"cell": 10.0, "headings": 36}, "amcl": {"laser_model_type": "robot"}}
LOCALIZING = [name for name in localizers.names() if name != "dead-reckoning"]
LONG = np.random.default_rng(0).uniform(-4, 0, 2 * MEMORY).tolist()  # evidence


class Table:
    """A scan model whose scan is the index of a row of log-likelihoods at the poses anywhere."""

    rows = np.array([[-1.0, -2.0], [-4.0, -0.5], [-math.inf, -3.0], [-math.inf, -math.inf]])

    def log_likelihood(self, states, scan):
        return self.rows[int(scan.ranges[0])]


DETECTOR = LossDetector(partial(Table().log_likelihood, np.zeros((3, 2), np.float32)))


def scan_of(number: float) -> Scan:
    return Scan.of(np.array([float(number)]), 400.0)


def quality(evidence: list[float], ask_always: bool = False) -> float:
    detector = DETECTOR
    for i, log_right in enumerate(evidence):
        detector = detector.scanned(scan_of(i % 3), log_right)
        if ask_always:
            assert 0 <= detector.quality <= 1
    return detector.quality


def test_the_quality_is_that_of_all_paths_through_the_two_states():
    evidence = [-1.0, -6.0, -0.2, -9.0, -1.5]
    lost = [math.log(np.exp(row).mean()) for row in Table.rows[:3]]
    change = {(1, 1): 1 - LOST, (1, 0): LOST, (0, 0): 1 - FOUND_AGAIN, (0, 1): FOUND_AGAIN}
    ending = {0: 0.0, 1: 0.0}
    for path in itertools.product((0, 1), repeat=6):  # 1: not lost
        p = 1 - LOST if path[0] else LOST
        for i, (before, after) in enumerate(itertools.pairwise(path)):
            p *= change[before, after] * math.exp(evidence[i] if after else lost[i % 3])
        ending[path[-1]] += p
    assert quality(evidence) == pytest.approx(ending[1] / (ending[0] + ending[1]), rel=1e-12)


def test_asking_changes_nothing():
    assert quality(LONG) == quality(LONG, ask_always=True)


def test_of_scans_beyond_the_memory_only_time_remains():
    forgotten = [math.nan] * MEMORY + LONG[MEMORY:]
    assert quality(LONG) == pytest.approx(quality(forgotten), rel=1e-12)


def test_impossible_and_unknown_evidence_leaves_a_number():
    assert quality([-math.inf]) == 0.0
    assert quality([math.nan]) == pytest.approx((1 - LOST) ** 2 + LOST * FOUND_AGAIN)
    assert DETECTOR.scanned(scan_of(3), -math.inf).quality == pytest.approx(0.9802)
    assert DETECTOR.scanned(scan_of(3), -50.0).quality == 1.0


@pytest.mark.parametrize("n", [1, 255, 256, 257, 5000])
def test_the_evidence_is_that_of_evenly_spaced_particles(n):
    rng = np.random.default_rng(n)
    weights, likelihoods = rng.normal(size=n), rng.normal(size=n)
    weights[rng.random(n) < 0.1] = -math.inf
    taken = slice(None, None, max(1, math.ceil(n / 256)))
    w, both = np.exp(weights[taken]), np.exp((weights + likelihoods)[taken])
    if w.sum() > 0:
        seen = log_evidence(weights, likelihoods, 256)
        assert seen == pytest.approx(math.log(both.sum() / w.sum()), rel=1e-9)


def test_even_poses_cover_free_space_and_turns_evenly(room):
    poses = even_poses(room, 4000)
    assert room.free(poses.T).all()
    assert np.array_equal(poses, even_poses(room, 4000))
    # shares of a quarter of the turns and of the area: more even than those of random poses (0.034)
    assert (poses[2] < -np.pi / 2).mean() == pytest.approx(0.25, abs=0.01)
    assert ((poses[0] < 175) & (poses[1] < 150)).mean() == pytest.approx(0.25, abs=0.01)


def kidnapped(name: str) -> list[float]:
    """Qualities while a robot drives along a corridor and, from step 15 on, turns elsewhere.

    It turns by enough for a filter that does not look while it stands.
    """
    block = [(60, 60), (140, 60), (140, 150), (60, 150)]
    plan = PolygonMap(outer=[(0, 0), (300, 0), (300, 200), (0, 200)], obstacles=[block])
    lidar = Lidar(beams=9, field_of_view=4.0, max_range=400.0)
    robot = robot_of(plan, lidar, (0.1, 0.1, 0.002), sigma=10.0)
    ahead = [[40.0 + 5 * t, 30.0, 0.0] for t in range(15)]
    elsewhere = [[200.0, 120.0, 2.0 + 0.3 * t] for t in range(10)]
    truth = np.array(ahead + elsewhere)
    noise = np.random.default_rng(1).normal(0, 10, (25, 9))
    scans = np.clip(plan.ranges(truth, robot.lidar.bearings) + noise, 0, 400)[1:]
    actions = np.array([[5.0, 0.0]] * 14 + [[0.0, 0.3]] * 10)
    prior = localizers.GaussianPrior(mean=(40, 30, 0.0), sd_position=5.0, sd_heading=0.05)
    localizer = localizers.make(name, robot, **small(name, 300) | OWN.get(name, {}))
    return [belief.quality for belief in follow(localizer, prior, (actions, scans))]


@pytest.mark.parametrize("name", LOCALIZING)
def test_the_quality_is_high_on_the_way_and_low_after_a_kidnap(name):
    found = kidnapped(name)
    assert all(0 <= q <= 1 for q in found)
    # nine beams of 10 px against a room of 300: one scan tells right from lost by many nats
    assert min(found[3:15]) > 0.9
    assert max(found[15:17]) < 0.5


def test_without_scans_the_quality_goes_to_one_half(robot, prior):
    localizer = started("mcl", robot, prior, particles=30)
    for _ in range(600):
        belief = localizer.update([math.nan], [0.0, 0.0], [])
    assert belief.quality == pytest.approx(0.5, abs=1e-4)  # 0.49 · 0.98^600


def test_dead_reckoning_gives_no_quality(robot, prior):
    belief = localizers.make("dead-reckoning", robot).reset(prior, [], np.random.default_rng(0))
    assert localizers.quality_of(belief) is None
