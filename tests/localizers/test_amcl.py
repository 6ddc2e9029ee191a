"""``amcl``: KLD-sampling, recovery, when it updates and resamples, and a kidnapped robot."""

import math
from dataclasses import replace

import numpy as np
import pytest
from following import robot_of, started, updated

import localizers
from deqmcl_gym.maps import GridMap, Lidar, PolygonMap
from localizers.inference.loss_detector import Averages
from localizers.inference.particles import KldSampling
from localizers.methods.amcl import OMNI, averages_after, has_moved
from localizers.models.nav2_motion import moved
from localizers.models.scan import LidarScan, Scan

LOPSIDED = PolygonMap(
    outer=[(0, 0), (300, 0), (300, 200), (120, 200), (120, 170), (0, 170)],
    obstacles=[[(60, 60), (140, 60), (140, 120), (60, 120)]],
)
# every step is an update, by the robot model's own motion and scan
ALWAYS = {"update_min_d": 0.0, "update_min_a": 0.0}
ROBOTS_OWN = {"laser_model_type": "robot", "robot_model_type": "robot", **ALWAYS}


@pytest.mark.parametrize("spread", [0.0, 1.0, 30.0, 300.0])
def test_drawing_stops_as_navs_loop_does(spread):
    kld = KldSampling(least=50, most=900, error=0.1, quantile=1.0, bin_size=(20.0, 20.0, 0.5))
    states = np.random.default_rng(0).normal(5, [[spread], [spread], [spread / 100]], (3, 900))
    states = states.astype(np.float32)
    occupied: set[tuple[int, ...]] = set()
    for drawn, pose in enumerate(states.T.astype(float), start=1):  # pf.c
        occupied.add(tuple(int(v // size) for v, size in zip(pose, kld.bin_size, strict=True)))
        k, limit = len(occupied), 900
        if k > 1:
            a = 2 / (9 * (k - 1))
            limit = math.ceil((k - 1) / 0.2 * (1 - a + math.sqrt(a)) ** 3)
            limit = min(max(limit, 50), 900)
        if drawn > limit:
            break
    assert kld.enough(states) == drawn
    assert (drawn == 900) == (spread in (0.0, 300.0))


def test_the_averages_are_of_the_mean_weight_and_random_poses_come_by_their_ratio():
    averages = Averages(alpha_slow=0.1, alpha_fast=0.5)
    averages = averages_after(averages, math.log(3.0), 100)
    assert (averages.slow, averages.fast) == pytest.approx((0.03, 0.03))  # the first sets both
    averages = averages_after(averages, math.log(1.0), 50)  # of fewer particles each has more
    assert averages.slow == pytest.approx(0.03 + 0.1 * (0.02 - 0.03))
    assert averages.fast == pytest.approx(0.03 + 0.5 * (0.02 - 0.03))
    assert averages.share == pytest.approx(1 - 0.025 / 0.029)
    assert averages_after(averages, math.log(10.0), 50).share == 0.0
    assert averages_after(averages, -math.inf, 50) == averages  # every weight 0


def test_after_random_poses_the_averages_start_anew(robot, prior):
    params = {"recovery_alpha_slow": 0.001, "recovery_alpha_fast": 0.9, **ROBOTS_OWN}
    localizer = started("amcl", robot, prior, **params)
    drawn, seen = 0, []
    for scan in (300.0, 300.0, 20.0, 300.0):
        belief = localizer.update([scan], [0.1, 0.0], [])
        seen.append(belief.events.random_poses - drawn)
        drawn = belief.events.random_poses
        assert (localizer._running.averages.slow == 0.0) == (seen[-1] > 0)
    assert seen[0] == 0
    assert seen[2] > 0  # the third scan is hardly explained
    assert seen[3] == 0  # and the fourth is a first one


@pytest.mark.parametrize(
    ("since", "heading", "opens"),
    [
        ((0.25, 0.0, 0.0), 0.0, False),  # more than, not as much
        ((0.26, 0.0, 0.0), 0.0, True),
        ((0.0, 0.26, 0.0), 0.0, True),
        ((0.3, 0.0, 0.0), math.pi / 4, False),  # 0.21 along either axis of the odometry
        ((0.0, 0.0, -0.21), 0.0, True),
    ],
)
def test_an_update_needs_more_than_a_minimum_along_an_odometry_axis(since, heading, opens):
    assert has_moved(np.array(since), heading, 0.25, 0.2) == opens
    assert not has_moved(np.zeros(3), heading, 0.0, 0.0)  # one who stands, even without minima


def test_between_updates_the_cloud_moves_along_the_odometry_without_noise(robot, prior):
    localizer = started("amcl", robot, prior, update_min_d=0.5, update_min_a=0.5)  # 25 px
    first = localizer.update([150.0], [1.0, 0.1], [])  # always used
    assert localizer._running.updates == 1
    one = localizer.update([150.0], [10.0, 0.2], [])
    two = localizer.update([20.0], [10.0, -0.1], [])
    assert localizer._running.updates == 1
    step = moved(first.present, np.array([10.0, 0.0, 0.2]))
    np.testing.assert_allclose(one.present, step, atol=1e-4)
    step = moved(step, np.array([10.0, 0.0, -0.1]))
    np.testing.assert_allclose(two.present, step, atol=1e-4)
    assert np.array_equal(first.weights, two.weights)
    localizer.update([150.0], [10.0, 0.0], [])  # 30 px in all
    assert localizer._running.updates == 2
    assert localizer._running.since.tolist() == [0.0, 0.0, 0.0]


def test_what_is_sampled_at_an_update_is_all_the_odometry_since_the_last(robot):
    still = dict.fromkeys(["alpha1", "alpha2", "alpha3", "alpha4"], 0.0)
    prior = localizers.GaussianPrior(mean=(50, 40, 0.0), sd_position=0.0, sd_heading=0.0)
    localizer = started("amcl", robot, prior, update_min_d=0.5, **still)
    for action in ([0.0, 0.0], [20.0, 0.1], [20.0, 0.1]):
        belief = localizer.update([150.0], action, [])
    x = 50 + 20 * math.cos(0.1) + 20 * math.cos(0.2)
    y = 40 + 20 * math.sin(0.1) + 20 * math.sin(0.2)
    np.testing.assert_allclose(belief.present.T, [[x, y, 0.2]] * 2000, atol=1e-4)


@pytest.mark.parametrize(("interval", "selective"), [(1, False), (3, False), (1, True)])
def test_it_resamples_after_an_update_when_it_should(robot, prior, drive, interval, selective):
    params = {"resample_interval": interval, "selective_resampling": selective}
    localizer = localizers.make("amcl", robot, **params, **ROBOTS_OWN)
    model = LidarScan(floor_plan=robot.floor_plan, lidar=robot.lidar, beam=robot.scan)
    before = localizer.reset(prior, [], np.random.default_rng(0))
    resampled = []
    for t, (action, scan) in enumerate(zip(*drive, strict=True), start=1):
        after = localizer.update(scan, action, [])
        latest = model.log_likelihood(after.present, Scan.of(scan, 400.0))
        kept = len(latest) == len(before.log_weights)
        if kept and np.array_equal(before.log_weights + latest, after.log_weights):
            resampled.append(False)  # still that cloud, weighed once more
            size = after.effective_sample_size / after.log_weights.size
            assert t % interval or (selective and size > 0.5)
        else:
            resampled.append(True)
            assert (after.log_weights == 0).all()
            assert t % interval == 0
        before = after
    assert any(resampled)
    assert all(resampled) == (interval == 1 and not selective)


def hall(walls: int = 60) -> localizers.RobotModel:
    """A hall of cells whose end wall has a mark, and a robot whose own models are very wide."""
    cells = np.pad(np.zeros((78, 118), np.int8), 1, constant_values=100)
    cells[30:50, walls] = 100
    lidar = Lidar(beams=20, field_of_view=0.4, max_range=10.0)
    return robot_of(GridMap(occupancy=cells, resolution=0.05), lidar, (0.0, 0.0, 0.0), sigma=5.0)


def test_beams_are_skipped_while_the_cloud_is_small_by_the_product_model_if_asked():
    robot = hall()
    scan = robot.floor_plan.ranges([[1.5, 2.0, 0.0]], robot.lidar.bearings)[0].astype(float)
    scan[:8] = 0.3  # people

    def evidence(sd, first=(), **params):
        params = {"laser_model_type": "likelihood_field_prob", "max_beams": 20, **params}
        prior = localizers.GaussianPrior(mean=(1.5, 2.0, 0.0), sd_position=sd, sd_heading=0.0)
        localizer = started("amcl", robot, prior, **params, **ALWAYS)
        for seen in (*first, scan):
            belief = localizer.update(seen, [1e-3, 0.0], [])
        return belief.scan_log_evidence

    everything = evidence(0.05, [scan])
    assert evidence(0.05, do_beamskip=True) == evidence(0.05)  # not before the first resampling
    assert evidence(0.05, [scan], do_beamskip=True) > everything + 8  # 8 beams fewer, each of < 1
    assert evidence(0.05, [scan], do_beamskip=True, beam_skip_error_threshold=0.4) == everything
    blind = [np.full(20, np.nan)]
    assert evidence(0.4, blind, do_beamskip=True) == evidence(0.4, blind)  # spread wider than 0.5 m


@pytest.mark.parametrize("kind", ["likelihood_field", "likelihood_field_prob", "beam"])
def test_navs_models_assume_nothing_that_the_robot_model_does(kind):
    robot = hall()
    sharp = localizers.GaussianUniform(sigma=0.01, power=0.1)
    other = replace(robot, motion=localizers.OdometryMotion(drive=3.0), scan=sharp)
    prior = localizers.GaussianPrior(mean=(1.5, 2.0, 0.0), sd_position=0.2)
    seen = {"scan": np.full(20, 1.5), "action": (0.3, 0.1), "laser_model_type": kind}
    beliefs = [updated("amcl", one, prior, **seen).points() for one in (robot, other)]
    assert all(map(np.array_equal, *beliefs))


def test_the_robots_own_motion_and_scan_are_used_if_asked(robot, prior):
    omni, own = {"robot_model_type": OMNI}, {"robot_model_type": "robot"}
    named = [{}, omni, omni | {"alpha5": 0.3}, {"laser_model_type": "robot"}, own, ROBOTS_OWN]
    beliefs = [updated("amcl", robot, prior, [150.0], (30, 0.3), **p).present for p in named]
    for k, one in enumerate(beliefs):
        for other in beliefs[k + 1 :]:
            assert not np.array_equal(one, other)


def lost_and_found(name: str, alpha_slow: float, alpha_fast: float) -> tuple[np.ndarray, int]:
    """Position errors of a robot that stands, is carried off at step 10, and turns about there."""
    lidar = Lidar(beams=15, field_of_view=5.0, max_range=400.0)
    robot = robot_of(LOPSIDED, lidar, (0.1, 0.1, 0.002), sigma=10.0)
    before = [[40.0, 30.0, 0.1 * t] for t in range(11)]
    truth = np.array(before + [[230.0, 150.0, 1.0 + 0.1 * t] for t in range(60)])
    rng = np.random.default_rng(3)
    scans = LOPSIDED.ranges(truth, lidar.bearings) + rng.normal(0, 10, (len(truth), 15))
    # Nav2's averages start anew after a draw of random poses: it must hit at once and needs many,
    # and its own motion model, which shifts a robot that turns
    own = {"laser_model_type": "robot", "max_particles": 20_000, **ALWAYS} if name == "amcl" else {}
    rates = {"recovery_alpha_slow": alpha_slow, "recovery_alpha_fast": alpha_fast}
    prior = localizers.GaussianPrior(mean=tuple(truth[0]), sd_position=5.0, sd_heading=0.05)
    localizer = started(name, robot, prior, **rates, **own)
    errors = []
    for pose, scan in zip(truth[1:], np.clip(scans[1:], 0, 400), strict=True):
        belief = localizer.update(scan, [0.0, 0.1], [])
        x, y, _ = localizers.mean_pose(*belief.points())
        errors.append(math.hypot(x - pose[0], y - pose[1]))
    return np.array(errors), belief.events.random_poses


@pytest.mark.parametrize("name", ["amcl", "mcl-map", "mcl-plan"])
def test_a_kidnapped_robot_is_found_again_by_random_poses_and_not_without(name):
    errors, drawn = lost_and_found(name, 0.001, 0.1)
    assert errors[:10].max() < 15
    assert errors[10] > 150  # carried off by 220 px
    assert errors[-10:].max() < 15
    assert drawn > 0
    errors, drawn = lost_and_found(name, 0.0, 0.0)
    assert errors[-10:].min() > 50
    assert drawn == 0


def test_every_so_many_th_beam_is_used():
    lidar = Lidar(beams=9, field_of_view=3.0, max_range=400.0)
    robot = localizers.RobotModel(floor_plan=LOPSIDED, lidar=lidar)
    prior = localizers.GaussianPrior(mean=(200, 100, 0.0))
    other = np.where(np.arange(9) % 4 == 0, 50.0, 90.0)
    for used, is_same in (({"max_beams": 3}, True), ({}, False)):
        seen = (np.full(9, 50.0), other)
        clouds = [updated("amcl", robot, prior, scan, **used).present for scan in seen]
        assert np.array_equal(*clouds) == is_same
