"""``amcl``: the KLD bound, augmented recovery, the likelihood field, and a kidnapped robot."""

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
import reference
from following import updated

import localizers
from deqmcl_gym.maps import Lidar, PolygonMap
from localizers.inference import adaptive_kernels
from localizers.inference.adaptive import KldSampling, Recovery
from localizers.models.likelihood_field import LikelihoodField
from localizers.models.scan import LidarScan

LOPSIDED = PolygonMap(
    outer=[(0, 0), (300, 0), (300, 200), (120, 200), (120, 170), (0, 170)],
    obstacles=[[(60, 60), (140, 60), (140, 120), (60, 120)]],
)


@pytest.mark.parametrize(
    ("degrees", "chi_square"),  # 99 % quantiles, from the tables
    [(1, 6.635), (5, 15.086), (9, 21.666), (30, 50.892), (100, 135.807)],
)
def test_the_kld_bound_is_a_chi_square_quantile_over_twice_the_error(degrees, chi_square):
    # Fox 2003, eq. (6): n = χ²_{k-1, 1-δ} / 2ε; (7) is the Wilson-Hilferty approximation of it,
    # which is right to 1 %.
    bound = adaptive_kernels.needed(degrees + 1, 0.05, NormalDist().inv_cdf(0.99))
    assert bound == pytest.approx(chi_square / 0.1, rel=0.01)


def test_draws_by_weight_fall_on_the_first_particle_whose_cumulative_weight_is_above():
    rng = np.random.default_rng(0)
    for n in (1, 2, 50, 1000):
        weights = rng.random(n) ** 9 * (rng.random(n) < 0.5)
        weights[n // 2] = 1.0
        cumulative = np.cumsum(weights)
        pointers = np.concatenate([rng.random(5000) * cumulative[-1], cumulative, [0.0]])
        seen = np.empty(pointers.size, np.intp)
        adaptive_kernels.drawn(cumulative, pointers, seen)
        expected = np.searchsorted(cumulative, pointers, side="right")
        assert seen.tolist() == np.minimum(expected, n - 1).tolist()


@pytest.mark.parametrize("spread", [1.0, 30.0, 300.0])
def test_drawing_stops_as_the_books_loop_does(spread):
    kld = KldSampling(least=50, most=900, error=0.1, quantile=1.0, bin_size=(20.0, 20.0, 0.5))
    states = np.random.default_rng(0).normal(0, [[spread], [spread], [spread / 100]], (3, 900))
    states = states.astype(np.float32)
    occupied: set[tuple[int, ...]] = set()
    for drawn, pose in enumerate(states.T.astype(float), start=1):  # table 8.4
        occupied.add(tuple(int(v // size) for v, size in zip(pose, kld.bin_size, strict=True)))
        k = len(occupied)
        a = 2 / (9 * (k - 1)) if k > 1 else 0
        bound = (k - 1) / 0.2 * (1 - a + math.sqrt(a)) ** 3 if k > 1 else 0
        if drawn >= bound and drawn >= 50:
            break
    assert kld.enough(states) == drawn


def test_random_poses_come_by_the_ratio_of_the_two_averages():
    recovery = Recovery(alpha_slow=0.1, alpha_fast=0.5)
    for likelihood in (0.2, 0.4, 0.6):
        recovery = recovery.after(math.log(likelihood), 1)
        assert recovery.share == 0.0
    assert recovery.slow == pytest.approx(0.4)  # of few scans the mean
    assert recovery.fast == pytest.approx(0.3 + 0.5 * (0.6 - 0.3))
    before, recovery = recovery, recovery.after(2 * math.log(0.1), 2)  # two beams, each of 0.1
    slow = before.slow + (0.1 - before.slow) / 4
    fast = before.fast + (0.1 - before.fast) / 2
    assert recovery.share == pytest.approx(1 - fast / slow)
    assert recovery.after(math.log(0.9), 1).after(math.log(0.9), 1).share == 0.0
    assert recovery.after(0.0, 0) == recovery  # a blind scan
    assert recovery.after(-math.inf, 1).share == pytest.approx(1 - fast * 0.5 / (slow * 0.8))
    for _ in range(200):
        recovery = recovery.after(math.log(0.3), 1)
    last = recovery.after(math.log(0.7), 1)
    assert last.slow - recovery.slow == pytest.approx(0.1 * 0.4)


@pytest.mark.parametrize("cell", [1.0, 4.0])
def test_the_field_is_the_distance_to_the_nearest_wall(cell):
    field = LikelihoodField(floor_plan=LOPSIDED, lidar=Lidar(), sigma=5.0, cell=cell)
    rows, columns = field.distances.shape
    ys, xs = np.mgrid[:rows, :columns] * cell
    points = np.column_stack([xs.ravel(), ys.ravel()])
    exact = reference.clearance(LOPSIDED.walls, points, points).reshape(rows, columns)
    np.testing.assert_allclose(field.distances, exact, rtol=0, atol=1e-3)  # float32 of 700 px


@pytest.mark.parametrize("cell", [1.0, 4.0])
def test_the_distance_from_a_beams_end_to_the_wall_is_right_to_a_cell_beyond_the_map_too(cell):
    room = PolygonMap(outer=[(0, 0), (60, 0), (60, 40), (0, 40)])
    lidar, sigma = Lidar(beams=1, field_of_view=1e-9, max_range=100.0), 30.0
    field = LikelihoodField(floor_plan=room, lidar=lidar, sigma=sigma, cell=cell, hit=1.0)
    rng = np.random.default_rng(0)
    for length in (5.0, 50.0, 99.0):
        poses = rng.uniform((1, 1, -3), (59, 39, 3), (200, 3)).astype(np.float32)
        bearing = poses[:, 2].astype(float)
        ends = poses[:, :2] + length * np.column_stack([np.cos(bearing), np.sin(bearing)])
        log_peak = -math.log(sigma * math.sqrt(2 * math.pi))
        told = field.log_likelihood(np.ascontiguousarray(poses.T), np.array([length]))
        seen = sigma * np.sqrt(2 * np.maximum(log_peak - told, 0.0))
        exact = reference.clearance(room.walls, ends, ends)
        assert np.abs(seen - exact).max() < cell
        assert length < 50 or np.abs(ends[:, 1] - 20).max() > 25  # far beyond the map


def test_a_scan_at_its_own_pose_is_likelier_than_elsewhere_and_odd_beams_say_nothing():
    lidar = Lidar(beams=9, field_of_view=4.0, max_range=400.0)
    field = LikelihoodField(floor_plan=LOPSIDED, lidar=lidar, sigma=5.0, cell=1.0)
    poses = np.array([[200.0, 100.0, 1.0], [200.0, 130.0, 1.0], [400.0, 100.0, 1.0]])
    scan = LOPSIDED.ranges(poses[:1], lidar.bearings)[0].astype(float)
    states = np.ascontiguousarray(poses.T, dtype=np.float32)
    here, there, outside = field.log_likelihood(states, scan)
    peak = 0.5 / (5 * math.sqrt(2 * math.pi))
    # all ends lie on walls: d is at most a cell's diagonal in the table
    assert here == pytest.approx(9 * math.log(peak + 0.5 / 400), abs=9 * 0.5 * 2 / 25)
    assert there < here - 5
    assert outside == 9 * -30.0
    odd = scan.copy()
    odd[[0, 3, 5]] = [math.nan, -1.0, 400.0]
    few = field.log_likelihood(states, odd)[0]
    assert few == pytest.approx(here * 6 / 9, rel=0.05)
    nothing = field.log_likelihood(states, np.full(9, 400.0))
    assert nothing.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("left_out", "meant", "other"),
    [
        ("laser_likelihood_max_dist", 100.0, 30.0),
        ("sigma_hit", 10.0, 20.0),
        ("field_cell", 1.0, 5.0),
        ("lambda_short", 1 / 400, 1 / 100),
    ],
)
def test_a_length_that_is_left_out_is_as_documented(left_out, meant, other):
    # at 3, 10 and 12 σ from a wall, in one scan or another: 70 px is as far as one gets here
    lidar = Lidar(beams=9, field_of_view=3.0, max_range=400.0)
    scan_model = localizers.GaussianUniform(sigma=10.0)
    robot = localizers.RobotModel(floor_plan=LOPSIDED, lidar=lidar, scan=scan_model)
    prior = localizers.GaussianPrior(mean=(200, 100, 0.0), sd_position=30.0)
    model = "beam" if left_out == "lambda_short" else "likelihood_field"

    def weights(**params):
        common = {"laser_model_type": model, "z_hit": 1.0, "z_rand": 1e-9}
        scan = np.linspace(10.0, 250.0, 9)
        return updated("amcl", robot, prior, scan, **common, **params).points()[1]

    assert np.array_equal(weights(), weights(**{left_out: meant}))
    assert not np.array_equal(weights(), weights(**{left_out: other}))


def test_the_number_of_particles_follows_the_spread(robot):
    def count(sd: float) -> int:
        localizer = localizers.make("amcl", robot, min_particles=20, max_particles=5000)
        prior = localizers.GaussianPrior(mean=(175, 50, 0.0), sd_position=sd, sd_heading=sd / 100)
        localizer.reset(prior, [], np.random.default_rng(0))
        for _ in range(2):
            belief = localizer.update([math.nan], [0.0, 0.0], [])
        return len(belief.points()[1])

    narrow, middle, wide = count(1.0), count(15.0), count(100.0)
    assert 20 <= narrow < middle < wide <= 5000


@pytest.mark.parametrize(("interval", "selective"), [(1, False), (3, False), (1, True)])
def test_it_resamples_when_it_should(robot, prior, drive, interval, selective):
    params = {"resample_interval": interval, "selective_resampling": selective}
    localizer = localizers.make("amcl", robot, laser_model_type="robot", **params)
    model = LidarScan(floor_plan=robot.floor_plan, lidar=robot.lidar, beam=robot.scan)
    before = localizer.reset(prior, [], np.random.default_rng(0))
    actions, scans = drive
    for t, (action, scan) in enumerate(zip(actions, scans, strict=True)):
        due = t > 0 and t % interval == 0
        if selective:
            due = due and before.effective_sample_size < len(before.log_weights) / 2
        after = localizer.update(scan, action, [])
        latest = model.log_likelihood(after.present, scan)
        only_the_latest = np.array_equal(latest, after.log_weights)
        assert only_the_latest == (due or t == 0)
        before = after


def test_a_beam_that_the_field_skips_makes_no_scan_likelier(robot, prior):
    # a beam at max_range says nothing in it, as one that is lost
    two = replace(robot, lidar=Lidar(beams=2, field_of_view=1.0, max_range=400.0))
    averages = []
    for silent in (400.0, math.nan):
        localizer = localizers.make("amcl", two, recovery_alpha_slow=0.1, recovery_alpha_fast=0.5)
        localizer.reset(prior, [], np.random.default_rng(0))
        localizer.update([50.0, silent], [0.0, 0.0], [])
        averages.append(localizer._running.recovery.fast)
    assert averages[0] == averages[1] > 0


def lost_and_found(name: str, alpha_slow: float, alpha_fast: float) -> tuple[np.ndarray, int]:
    """Position errors of a robot that stands, is carried off at step 10, and turns about there."""
    lidar = Lidar(beams=15, field_of_view=5.0, max_range=400.0)
    robot = localizers.RobotModel(
        floor_plan=LOPSIDED,
        lidar=lidar,
        motion=localizers.OdometryMotion(drive=0.1, turn=0.1, drift=0.002),
        scan=localizers.GaussianUniform(sigma=10.0),
    )
    truth = np.array(
        [[40.0, 30.0, 0.1 * t] for t in range(11)]
        + [[230.0, 150.0, 1.0 + 0.1 * t] for t in range(60)]
    )
    rng = np.random.default_rng(3)
    scans = LOPSIDED.ranges(truth, lidar.bearings) + rng.normal(0, 10, (len(truth), 15))
    localizer = localizers.make(
        name, robot, recovery_alpha_slow=alpha_slow, recovery_alpha_fast=alpha_fast
    )
    prior = localizers.GaussianPrior(mean=tuple(truth[0]), sd_position=5.0, sd_heading=0.05)
    localizer.reset(prior, [], np.random.default_rng(0))
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


def test_at_most_max_beams_are_used_evenly_spread():
    lidar = Lidar(beams=9, field_of_view=3.0, max_range=400.0)
    robot = localizers.RobotModel(
        floor_plan=LOPSIDED, lidar=lidar, scan=localizers.GaussianUniform(sigma=10.0)
    )
    prior = localizers.GaussianPrior(mean=(200, 100, 0.0))
    scan = np.full(9, 50.0)
    other = scan.copy()
    other[[1, 2, 3, 5, 6, 7]] = 90.0

    def weights(ranges, **params):
        return updated("amcl", robot, prior, ranges, **params).points()[1]

    assert np.array_equal(weights(scan, max_beams=3), weights(other, max_beams=3))
    assert not np.array_equal(weights(scan), weights(other))
