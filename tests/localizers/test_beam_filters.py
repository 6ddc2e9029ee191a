"""Filters of beams: what they drop, enumerated; that only that is left out of the weights."""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest
from following import follow, same, varied
from refusals import refused
from ring import PRIOR, SENSOR
from test_checks import HERE

import localizers
from deqmcl_gym.maps import Lidar, PolygonMap
from localizers import GaussianPrior, GaussianUniform, RobotModel
from localizers.checks import report_of
from localizers.checks.subject import localizer_drive
from localizers.inference import beam_filters
from localizers.inference.beam_filters import DistanceFilter, EntropyFilter, judges, place_cells
from localizers.models.scan import LidarScan, Scan

HALL = PolygonMap(outer=[(0, 0), (300, 0), (300, 200), (0, 200)])
LIDAR = Lidar(beams=16, field_of_view=6.0, max_range=250.0)
SCAN = LidarScan(floor_plan=HALL, lidar=LIDAR, beam=GaussianUniform(sigma=10.0))
ROBOT = RobotModel(floor_plan=HALL, lidar=LIDAR, scan=SCAN.beam)
POSE = np.array([100.0, 80.0, 0.3])


def around(pose, n=40, spread=4.0, seed=0):
    """A cloud (3, n) float32 and its log-weights, of which one is 0."""
    rng = np.random.default_rng(seed)
    cloud = pose[:, None] + rng.normal(0, 1, (3, n)) * np.array([[spread], [spread], [0.02]])
    log_weights = rng.normal(0, 1, n)
    log_weights[3] = -np.inf
    return cloud.astype(np.float32), log_weights


def seen_from(pose, people=()):
    """What is seen from a pose, ``people`` standing at half of some beams' ranges."""
    ranges = np.minimum(HALL.ranges(pose[None], LIDAR.bearings)[0].astype(float), LIDAR.max_range)
    ranges[list(people)] *= 0.5
    return ranges


def of(ranges):
    return Scan.of(np.asarray(ranges, dtype=float), LIDAR.max_range)


def test_a_beam_is_shorter_than_the_map_says_with_the_probability_of_a_plain_sum():
    cloud, log_weights = around(POSE)
    cloud[0, 5] = -50.0  # outside: says nothing
    ranges = seen_from(POSE, people=(1, 2))
    ranges[7] = np.nan
    poses, weights = judges(cloud, log_weights)
    told = DistanceFilter(scan=SCAN).shorter(poses, weights, of(ranges))
    expected = HALL.ranges(cloud.T, LIDAR.bearings).astype(float)
    plain = []
    for beam in np.flatnonzero(~np.isnan(ranges)):
        total = chance = 0.0
        for i in range(cloud.shape[1]):
            if not math.isnan(expected[i, beam]):
                w = math.exp(log_weights[i])
                z = (min(expected[i, beam], LIDAR.max_range) - ranges[beam]) / 10.0
                total, chance = total + w, chance + w * 0.5 * math.erfc(-z / math.sqrt(2))
        plain.append(chance / total)
    # exact ranges are float32, of 300 px: 2e-5 px, at 0.04 per px
    np.testing.assert_allclose(told, plain, atol=1e-6)


def test_short_beams_are_dropped_long_ones_never_and_none_while_the_belief_is_at_two_places():
    cloud, log_weights = around(POSE)
    people = (1, 2, 9)
    chosen = DistanceFilter(scan=SCAN)
    kept = chosen.kept(cloud, log_weights, of(seen_from(POSE, people)))
    assert np.flatnonzero(np.isnan(kept.ranges)).tolist() == list(people)
    assert kept.beams == 13
    longer = of(np.full(16, LIDAR.max_range))
    assert chosen.kept(cloud, log_weights, longer) is longer
    cloud[0, ::2] += 160  # two places
    crowded = of(seen_from(POSE, people))
    assert chosen.kept(cloud, log_weights, crowded) is crowded
    blind = of(np.full(16, np.nan))
    assert chosen.kept(cloud, log_weights, blind) is blind


@dataclass(frozen=True)
class RingBeams:
    """Several readings at once of the ring's sensor, as a scan model."""

    def compared(self, states, scan):
        return scan.ranges, np.repeat(states, scan.ranges.size, axis=0)

    def weighed(self, measured, states):
        return np.log(SENSOR[states, measured.astype(int)[:, None]]).sum(axis=0)


def entropy(p) -> float:
    return -sum(x * math.log(x) for x in p if x > 0)


@pytest.mark.parametrize("prior", [PRIOR, [0.05, 0.9, 0.05, 0, 0], [0, 0, 1, 0, 0], [0.2] * 5])
def test_on_a_ring_the_entropy_filter_drops_what_raises_the_enumerated_entropy(prior):
    """Particles are two to a state, so that a place is not a particle."""
    states = np.repeat(np.arange(5), 2)[None]
    with np.errstate(divide="ignore"):
        log_weights = np.log(np.repeat(np.asarray(prior) / 2, 2))
    filtering = EntropyFilter(scan=RingBeams(), places=lambda cloud: cloud[0])
    scan = Scan.of(np.array([0.0, 1.0, 2.0]), 5.0)
    raised = []
    for reading in range(3):
        after = np.asarray(prior) * SENSOR[:, reading]
        raised.append(entropy(after / after.sum()) > entropy(prior) + 1e-9)
    left = filtering.kept(states, log_weights, scan)
    assert np.isnan(left.ranges).tolist() == raised


def test_a_beam_that_no_pose_explains_is_dropped_by_the_entropy_filter():
    """Without a uniform share a range 100 standard deviations off has no likelihood."""
    certain = replace(SCAN, beam=localizers.CensoredGaussianUniform(sigma=1.0, uniform=0.0))
    ranges = seen_from(POSE, people=(4,))
    cloud, log_weights = around(POSE, spread=0.05)
    kept = EntropyFilter(scan=certain, places=partial(place_cells, 5.0)).kept(
        cloud, log_weights, of(ranges)
    )
    assert np.isnan(kept.ranges[4])


def test_cells_are_squares_and_sectors_wherever_headings_are_wrapped():
    poses = np.array([[1, 1, 0.1], [4, 4, 0.14], [6, 1, 0.1], [1, 1, 0.1 + 2 * np.pi], [1, 1, 0.3]])
    places = place_cells(5.0, poses.T)
    assert places[0] == places[1] == places[3]
    assert len({places[0], places[2], places[4]}) == 3


def test_many_particles_are_represented_by_evenly_spaced_ones_and_few_by_all():
    states = np.arange(3 * 2000.0).reshape(3, 2000)
    for n, apart in ((2000, 4.0), (beam_filters.JUDGES, 1.0)):
        some, weights = judges(states[:, :n], np.where(np.arange(n) % 4, 0.0, -np.inf))
        assert np.unique(np.diff(some[0])).tolist() == [apart]
        assert weights.sum() == pytest.approx(1)  # also where those taken all weigh 0


@dataclass(frozen=True)
class Blindfold:
    dropped: tuple[int, ...]

    def kept(self, states, log_weights, scan):
        return scan.without(True, np.isin(np.arange(scan.ranges.size), self.dropped))


def test_a_filter_that_drops_a_beam_is_the_filter_without_it_and_counts_it_bit_by_bit():
    plain = localizers.make("mcl-map", ROBOT, particles=60)
    actions = np.array([(8.0, 0.05)] * 6)
    prior = GaussianPrior(mean=tuple(POSE), sd_position=10.0, sd_heading=0.1)
    scans = np.array([seen_from(POSE + np.array([8.0 * k, 0, 0])) for k in range(1, 7)])
    lost = scans.copy()
    lost[:, [3, 8]] = np.nan
    for dropped, theirs in (((3, 8), lost), ((), scans)):
        ours = follow(varied(plain, beams=Blindfold(dropped)), prior, (actions, scans))
        assert same(ours, follow(plain, prior, (actions, theirs)))
        assert ours[-1].events.dropped_beams == 6 * len(dropped)
        assert ours[-1].events.skipped_beams == 0
        assert ours[-1].quality is not None


@pytest.mark.parametrize("name", ["distance", "entropy"])
def test_every_law_is_kept_with_a_filter_of_beams(name):
    drive = localizer_drive("deq-mcl", beam_filter=name, particles=50, lag=3)
    report = report_of(drive, HERE)
    assert {verdict.status for verdict in report.verdicts} == {"ok"}, report


def test_a_beam_model_without_sigma_and_a_hedge_have_no_filter():
    class Flat:
        def log_likelihood(self, ranges, expected, max_range):
            return np.zeros(len(expected))

        def least_density(self, max_range):
            return 1.0

    with refused("the beam model is of type Flat, without sigma"):
        beam_filters.beam_filter("distance", replace(ROBOT, scan=Flat()))
    with refused("beam_filter"):
        localizers.make("mcl-plan-hedged", ROBOT, beam_filter="distance")
