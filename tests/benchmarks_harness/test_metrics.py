"""Each score against plain arithmetic."""

import math

import numpy as np
import pytest

from benchmarks.trials import metrics

PI = math.pi


def estimate(x, y, heading, length=1.0):
    """An estimate of (x, y, cos θ, sin θ), (1, 4); a mean of directions is shorter than 1."""
    return np.array([[x, y, length * math.cos(heading), length * math.sin(heading)]])


def test_the_state_error_is_the_norm_over_x_y_cosine_and_sine():
    # (3, 4) px off, and (1, 0) where the heading π/2 has (0, 1): 9 + 16 + 1 + 1 = 27
    error = metrics.state_error(np.array([[13.0, 24.0, 1.0, 0.0]]), np.array([[10, 20, PI / 2]]))
    assert error == pytest.approx([math.sqrt(27)], rel=1e-12)


def test_the_state_error_of_the_truth_itself_is_zero_whatever_full_turns_it_holds():
    truth = np.array([[10.0, 20.0, 3.0 - 2 * PI]])
    assert metrics.state_error(estimate(10, 20, 3.0), truth) == pytest.approx([0.0], abs=1e-14)


def test_the_state_error_has_one_value_per_state():
    truth = np.array([[0.0, 0, 0], [0, 0, 0], [1, 1, 0]])
    means = np.array([[3.0, 4, 1, 0], [0, 0, 0, 0], [1, 1, 1, 0]])
    assert metrics.state_error(means, truth).tolist() == [5.0, 1.0, 0.0]


def test_the_position_error_is_the_distance_in_px_and_knows_no_heading():
    truth = np.array([[10.0, 20.0, 2.0]])
    assert metrics.position_error(estimate(13, 24, -1.0), truth).tolist() == [5.0]


@pytest.mark.parametrize(
    ("estimated", "true", "apart"),
    [
        (0.3, 0.1, 0.2),
        (0.1, 0.3, 0.2),
        (PI - 0.1, -PI + 0.1, 0.2),  # 174° and -174° are 12° apart, not 348°
        (-PI + 0.1, PI - 0.1, 0.2),
        (0.2, 0.1 + 6 * PI, 0.1),
        (0.2, 0.1 - 6 * PI, 0.1),
        (PI / 2, -PI / 2, PI),
    ],
)
def test_the_heading_error_is_the_shorter_way_round(estimated, true, apart):
    error = metrics.heading_error(estimate(0, 0, estimated), np.array([[5.0, 5.0, true]]))
    assert error == pytest.approx([apart], abs=1e-12)  # a few roundings of numbers below 20


def test_the_heading_error_is_that_of_the_direction_however_short_the_mean_is():
    error = metrics.heading_error(estimate(0, 0, 1.0, length=0.01), np.array([[0, 0, 0.75]]))
    assert error == pytest.approx([0.25], abs=1e-12)


def test_the_moments_of_a_cloud_are_those_of_plain_loops():
    rng = np.random.default_rng(0)
    poses = rng.normal(0, (50, 50, 2), size=(200, 3)).astype(np.float32)
    weights = rng.dirichlet(np.ones(200))
    mean, variance = [0.0] * 4, [0.0] * 4
    cloud = [
        (float(x), float(y), math.cos(float(a)), math.sin(float(a))) for x, y, a in poses.tolist()
    ]
    for w, point in zip(weights.tolist(), cloud, strict=True):
        for i in range(4):
            mean[i] += w * point[i]
    for w, point in zip(weights.tolist(), cloud, strict=True):
        for i in range(4):
            variance[i] += w * (point[i] - mean[i]) ** 2
    ours = metrics.cloud_moments(poses, weights)
    # float64 sums of 200 terms: relative rounding below 200 * 2e-16, of terms up to 4e4
    assert ours[0] == pytest.approx(mean, rel=1e-12, abs=1e-12)
    assert ours[1] == pytest.approx(variance, rel=1e-12, abs=1e-12)


def test_float32_poses_lose_nothing_in_the_moments():
    # naive float32 would give a variance of a unit in the last place of 10⁶: off by percents
    poses = np.array([[1000.0, 0, 0], [1000.25, 0, 0]], dtype=np.float32)
    mean, variance = metrics.cloud_moments(poses, np.array([0.5, 0.5]))
    assert mean[0] == 1000.125
    assert variance[0] == 0.125**2


def test_headings_of_179_and_minus_179_degrees_average_to_180():
    poses = np.array([[0, 0, math.radians(179)], [0, 0, math.radians(-179)]])
    mean, _ = metrics.cloud_moments(poses, np.array([0.5, 0.5]))
    assert metrics.heading_error(mean[None], np.array([[0, 0, PI]])) == pytest.approx(
        [0], abs=1e-12
    )


def test_one_point_has_a_mean_and_no_variance():
    mean, variance = metrics.cloud_moments(np.array([[1.0, 2.0, PI / 2]]), np.ones(1))
    assert mean == pytest.approx([1, 2, 0, 1], abs=1e-15)
    assert np.isnan(variance).all()


def test_many_points_in_one_place_have_variance_zero_not_none():
    _, variance = metrics.cloud_moments(np.full((3, 3), 1.0), np.full(3, 1 / 3))
    assert variance == pytest.approx([0] * 4, abs=1e-30)


def test_entropy_is_that_of_four_independent_gaussians():
    # ½ log(2πe v) of v = 100, 4, 0.25, 0.01, by hand: 4 · ½ log(2πe) + ½ log(100 · 4 · 0.25 · 0.01)
    # = 4 · 1.4189385332 + ½ log 1
    assert metrics.entropy(np.array([[100, 4, 0.25, 0.01]])) == pytest.approx(
        [5.6757541328], abs=1e-9
    )


def test_entropy_does_not_fall_below_that_of_the_floors():
    # ½ log(10⁻² · 10⁻² · 10⁻⁶ · 10⁻⁶) = -8 log 10 = -18.4206807440
    lowest = 5.6757541328 - 18.4206807440
    for variances in ([0, 0, 0, 0], [1e-2, 1e-2, 1e-6, 1e-6], [1e-3, 0, 1e-7, 1e-30]):
        assert metrics.entropy(np.array([variances])) == pytest.approx([lowest], abs=1e-9)


@pytest.mark.parametrize(("component", "floor"), [(0, 1e-2), (1, 1e-2), (2, 1e-6), (3, 1e-6)])
def test_entropy_grows_by_a_half_log_2_where_a_variance_above_its_floor_doubles(component, floor):
    variances = np.ones((2, 4))
    variances[:, component] = floor, 2 * floor
    low, high = metrics.entropy(variances)
    assert high - low == pytest.approx(0.5 * math.log(2), abs=1e-12)


def test_entropy_of_an_unknown_variance_is_unknown():
    assert np.isnan(metrics.entropy(np.array([[1.0, 1.0, np.nan, 1.0]]))).all()


def test_rms_and_mean_are_by_hand_and_those_of_nothing_are_unknown():
    assert metrics.rms(np.array([3.0, 4.0])) == pytest.approx(math.sqrt(12.5), rel=1e-15)
    assert metrics.mean(np.array([3.0, 4.0])) == 3.5
    assert math.isnan(metrics.rms(np.empty(0)))
    assert math.isnan(metrics.mean(np.empty(0)))
