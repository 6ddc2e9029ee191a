"""``dead-reckoning`` and ``ekf``: the book's matrices, the moments of a beam, the gate."""

import math

import numpy as np
import pytest
from following import density, robot_of, updated

import localizers
from deqmcl_gym.maps import Lidar, PolygonMap
from localizers.methods import classical as kernels
from localizers.methods.classical import gaussian_points

COVARIANCE = np.array([[90.0, 20.0, 0.6], [20.0, 60.0, -0.4], [0.6, -0.4, 0.03]])


def test_it_adds_the_commands_up_and_rolls_the_plan_out(robot, prior):
    square = np.array([(10.0, math.pi / 2)] * 4)
    localizer = localizers.make("dead-reckoning", robot)
    belief = localizer.reset(prior, square, np.random.default_rng(0))
    x, y, heading = prior.mean
    corners = [(x, y), (x, y + 10), (x - 10, y + 10), (x - 10, y), (x, y)]
    for t in range(5):
        for offset in range(-6, 7):
            points = belief.points(offset)
            if not 0 <= t + offset <= 4:
                assert points is None
                continue
            assert points[1].tolist() == [1.0]
            assert points[0][0, :2] == pytest.approx(corners[t + offset], abs=1e-12)
            assert points[0][0, 2] == pytest.approx(heading + (t + offset) * math.pi / 2)
        if t < 4:
            belief = localizer.update([math.nan], square[t], square[t + 1 :])


def test_it_follows_what_was_carried_out_not_what_was_planned(robot, prior):
    localizer = localizers.make("dead-reckoning", robot)
    localizer.reset(prior, [(10.0, 0.0), (10.0, 0.0)], np.random.default_rng(0))
    belief = localizer.update([100.0], [3.0, 0.0], [(7.0, 0.0)])
    x, y, _ = prior.mean
    assert belief.points()[0][0, :2].tolist() == [x + 3, y]
    assert belief.points(1)[0][0, :2].tolist() == [x + 10, y]


@pytest.mark.parametrize("bearing", [0.0, 0.9, -math.pi / 2])
def test_the_prediction_is_f_p_f_plus_v_q_v(bearing):
    mean, covariance = np.array([10.0, 20.0, 0.7]), COVARIANCE.copy()
    kernels.predict(mean, covariance, 12.0, bearing, 0.4, 1.5, 0.2)
    heading = 0.7 + 0.4
    s, c = math.sin(heading + bearing), math.cos(heading + bearing)
    f = np.array([[1, 0, -12 * s], [0, 1, 12 * c], [0, 0, 1]])
    v = np.array([[c, -12 * s], [s, 12 * c], [0, 1]])
    expected = f @ COVARIANCE @ f.T + v @ np.diag([1.5**2, 0.2**2]) @ v.T
    assert mean == pytest.approx([10 + 12 * c, 20 + 12 * s, heading], rel=1e-12)
    assert covariance == pytest.approx(expected, rel=1e-12)


def test_beams_one_by_one_are_the_kalman_update_with_all_at_once():
    rng = np.random.default_rng(0)
    slopes, innovations = rng.normal(size=(5, 3)) * [1, 1, 80], rng.normal(size=5) * 10
    variances = rng.uniform(10, 200, 5)
    mean, covariance = np.array([10.0, 20.0, 0.7]), COVARIANCE.copy()
    assert kernels.correct(mean, covariance, innovations, slopes, variances, math.inf) == 0
    spread = slopes @ COVARIANCE @ slopes.T + np.diag(variances)
    gain = COVARIANCE @ slopes.T @ np.linalg.inv(spread)
    assert mean == pytest.approx([10, 20, 0.7] + gain @ innovations, rel=1e-9)
    assert covariance == pytest.approx((np.eye(3) - gain @ slopes) @ COVARIANCE, rel=1e-7)


def test_the_points_fill_ellipsoids_as_a_gaussian_does():
    poses = gaussian_points(np.zeros(3), COVARIANCE)
    squares = np.einsum("ij,jk,ik->i", poses, np.linalg.inv(COVARIANCE), poses)
    # quantiles of chi² with 3 degrees of freedom. 256 independent pairs would give a share to
    # ± 0.031 (one standard deviation at ½); evenly spread ones are better.
    for level, quantile in ((0.25, 1.213), (0.5, 2.366), (0.8, 4.642), (0.95, 7.815)):
        assert (squares < quantile).mean() == pytest.approx(level, abs=0.03)


@pytest.mark.parametrize(
    "model",
    [
        localizers.CensoredGaussianUniform(sigma=100.0, uniform=0.0),
        localizers.BeamModel(hit=1.0, short=0.0, max=0.0, rand=0.0, sigma=60.0),
    ],
    ids=["censored", "beam"],
)
@pytest.mark.parametrize("expected", [5.0, 120.0, 395.0])
def test_the_moments_of_a_beam_that_hits_are_those_of_its_density(model, expected):
    inside = (np.arange(4000) + 0.5) / 10  # midpoints of cells of 0.1 px
    masses = density(model, inside, np.full((1, 4000), expected), 400.0)[0] * 0.1
    ends = np.zeros(2)
    if isinstance(model, localizers.CensoredGaussianUniform):
        ends = density(model, [0.0, 400.0], np.full((1, 2), expected), 400.0)[0]
    values, shares = np.r_[0.0, inside, 400.0], np.r_[ends[0], masses, ends[1]]
    mean = (values * shares).sum()
    seen_mean, seen_variance = model.hit_moments(np.array([[expected]]), 400.0)
    assert shares.sum() == pytest.approx(1.0, abs=1e-6)
    assert seen_mean[0, 0] == pytest.approx(mean, rel=1e-5)
    assert seen_variance[0, 0] == pytest.approx((values**2 * shares).sum() - mean**2, rel=1e-4)


@pytest.fixture
def corridor() -> localizers.RobotModel:
    plan = PolygonMap(outer=[(0, 0), (300, 0), (300, 100), (0, 100)])
    lidar = Lidar(beams=3, field_of_view=math.pi, max_range=400.0)
    return robot_of(plan, lidar, (0.05, 0.05, 0.0), sigma=4.0)


def test_a_scan_tells_what_it_should_of_a_straight_corridor(corridor):
    # Left and right beams give y to 4 / √2 px, the one ahead x to 4 px; the heading stays known to
    # about 0.01 rad. At (100, 50, 0): 50 to the right, 200 ahead, 50 to the left.
    prior = localizers.GaussianPrior(mean=(90, 45, 0.0), sd_position=20.0, sd_heading=0.01)
    belief = updated("ekf", corridor, prior, [50.0, 200.0, 50.0])
    assert belief.mean[:2] == pytest.approx([100, 50], abs=0.6)  # the prior's share: (4 / 20)² · 10
    assert belief.covariance[0, 0] == pytest.approx(1 / (1 / 16 + 1 / 400), rel=0.05)
    assert belief.covariance[1, 1] == pytest.approx(1 / (2 / 16 + 1 / 400), rel=0.05)


def test_a_beam_beyond_the_gate_is_left_out_and_counted(corridor):
    prior = localizers.GaussianPrior(mean=(100, 50, 0.0), sd_position=2.0, sd_heading=0.01)
    scans = ([50.0, ahead, 50.0] for ahead in (90.0, math.nan))
    gated, lost = (updated("ekf", corridor, prior, scan) for scan in scans)
    assert gated.events.gated_beams == 1
    assert gated.mean == pytest.approx(lost.mean)
    assert gated.covariance == pytest.approx(lost.covariance)
    assert lost.events.skipped_beams == 1
    ungated = updated("ekf", corridor, prior, [50.0, 90.0, 50.0], gate=1)
    assert ungated.events.gated_beams == 0


@pytest.mark.parametrize("gate", [0.99, 1])
def test_beams_that_cannot_read_anything_but_max_range_tell_nothing(gate):
    # every wall is 60 standard deviations or more beyond what the lidar reports
    hall = localizers.RobotModel(
        floor_plan=PolygonMap(outer=[(0, 0), (2000, 0), (2000, 2000), (0, 2000)]),
        lidar=Lidar(beams=4, field_of_view=6.0, max_range=400.0),
        scan=localizers.CensoredGaussianUniform(sigma=10.0),
    )
    prior = localizers.GaussianPrior(mean=(1000, 1000, 0.0), sd_position=5.0)
    how = {"gate": gate, "action": [20, 0]}
    seen, blind = (updated("ekf", hall, prior, [o] * 4, **how) for o in (400.0, math.nan))
    assert seen.events.gated_beams == 0
    assert seen.mean.tolist() == blind.mean.tolist()
    assert seen.covariance.tolist() == blind.covariance.tolist()


def test_outside_the_walls_it_goes_on_by_its_commands(corridor):
    prior = localizers.GaussianPrior(mean=(290, 50, 0.0), sd_position=2.0, sd_heading=0.01)
    belief = updated("ekf", corridor, prior, [50.0, 20.0, 50.0], action=[30.0, 0.0])
    assert belief.mean == pytest.approx([320, 50, 0])
    assert belief.events.unpredicted_beams == 3
