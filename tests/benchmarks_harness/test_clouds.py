"""Moments and scores of clouds against plain forms; what is no cloud."""

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as generated
from scipy import stats

from benchmarks.setup.scenario import Thresholds
from benchmarks.trials import clouds, scores
from benchmarks.trials.clouds import belief_moments, belief_scores, cloud_of, joined
from deqmcl_gym.validation import InputError

PI = math.pi
TRUTH = np.array([110.0, 50.0, -3.1])
KINDS = generated.floating_dtypes() | generated.integer_dtypes()
NUMBERS = generated.arrays(KINDS, st.just((4, 3)))
SHAPES = generated.array_shapes(max_dims=2, max_side=4)
ANYTHING = generated.arrays(generated.scalar_dtypes(), SHAPES)
# 4 · ½ log(2πe), by hand
FOUR = 5.6757541328


def cloud(n, seed):
    """A correlated cloud about (100, 60, 3.0): headings on both sides of π."""
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=(n, 3)).T
    poses = np.column_stack([100 + 30 * a, 60 + 10 * a + 15 * b, 3.0 + 0.3 * c + 0.1 * b])
    poses[:, 2] = (poses[:, 2] + PI) % (2 * PI) - PI
    return poses, rng.dirichlet(np.ones(n))


def together(*beliefs, truth=TRUTH):
    return joined([cloud_of(0, 0, points) for points in beliefs], [truth] * len(beliefs))


def spread(poses, weights):
    (row,) = belief_moments(together((poses, weights)))
    return row[:4], row[4:]


def calibrated(poses, weights, truth=TRUTH, unit="px"):
    clouds = together((poses, weights), truth=truth)
    return belief_scores(clouds, unit)[0, 8:12]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_moments_of_a_cloud_are_those_of_numpy(dtype):
    poses, weights = cloud(200, 0)  # headings on both sides of π
    poses = poses.astype(dtype)
    x, y, heading = poses.T.astype(np.float64)
    points = np.column_stack([x, y, np.cos(heading), np.sin(heading)])
    mean = np.average(points, axis=0, weights=weights)
    variance = np.average((points - mean) ** 2, axis=0, weights=weights)
    ours = spread(poses, weights)
    # float64 sums of 200 terms: relative rounding below 200 * 2e-16, of terms up to 4e4
    assert ours[0] == pytest.approx(mean, rel=1e-12, abs=1e-12)
    assert ours[1] == pytest.approx(variance, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("n", [2, 3, 50, 400])
def test_the_energy_score_is_that_of_all_pairs_up_to_the_pairs_left_out(n):
    # 128 points in systematic order estimate E|X - X'| with an SD below 2 √(Var h₁ / 128), where
    # h₁(x) = E|x - X'| varies by about a third of its mean: 6 %; the mean of 40 clouds: 1 %.
    # The bound is five of these.
    ratios = []
    for seed in range(40):
        poses, weights = cloud(n, seed)
        xy = poses[:, :2]
        near = weights @ np.linalg.norm(xy - TRUTH[:2], axis=1)
        apart = np.linalg.norm(xy[:, None] - xy, axis=2)
        ours = near - calibrated(poses, weights)[0]
        ratios.append(ours / (0.5 * weights @ apart @ weights))
    assert np.mean(ratios) == pytest.approx(1, abs=0.05)


def test_rank_nees_and_log_score_are_those_of_numpys_linear_algebra():
    for seed in range(20):
        poses, weights = cloud(300, seed)
        mean = weights @ poses[:, :2]
        angle = math.atan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))
        turned = (poses[:, 2] - angle + PI) % (2 * PI) - PI
        off = np.column_stack([poses[:, :2] - mean, turned])
        p = (weights[:, None] * off).T @ off + np.diag(clouds.covariance_floor("px"))
        d = np.array([*(TRUTH[:2] - mean), (TRUTH[2] - angle + PI) % (2 * PI) - PI])
        inverse = np.linalg.inv(p[:2, :2])
        own = np.einsum("ni,ij,nj->n", off[:, :2], inverse, off[:, :2])
        _, rank, nees, log_score = calibrated(poses, weights)
        density = stats.multivariate_normal(np.zeros(3), p).logpdf(d)
        assert log_score == pytest.approx(-density, rel=1e-9)
        assert nees == pytest.approx(d @ np.linalg.inv(p) @ d, rel=1e-9)
        nearer = weights[own < d[:2] @ inverse @ d[:2]].sum()
        assert rank == pytest.approx(nearer, abs=1e-12)


@pytest.mark.parametrize(("unit", "pixel"), [("px", 1.0), ("m", 0.02)])
def test_a_collapsed_cloud_is_scored_by_the_floors_alone_which_go_with_the_unit(unit, pixel):
    poses, truth = np.zeros((5, 3)), np.array([0.3 * pixel, 0.4 * pixel, 0.0])
    energy, rank, nees, _ = calibrated(poses, np.full(5, 0.2), truth, unit)
    assert nees == pytest.approx(0.25 / 1e-2, rel=1e-9)
    assert rank == 1.0
    assert energy == pytest.approx(0.5 * pixel, rel=1e-12)
    assert spread(poses, np.full(5, 0.2))[1] == pytest.approx([0] * 4, abs=1e-30)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_cloud_gives_the_same_in_any_layout_and_company(dtype):
    poses, weights = cloud(100, 0)
    poses = poses.astype(dtype)
    columns = np.ascontiguousarray(poses.T).T
    clouds = together(cloud(7, 1), (columns, weights), (poses[:1], np.ones(1)))
    spreads = belief_moments(clouds)
    assert np.array_equal(spreads[1], np.concatenate(spread(poses, weights)))
    assert np.array_equal(belief_scores(clouds, "px")[1, 8:12], calibrated(poses, weights))


POSES, WEIGHTS = cloud(4, 0)


@pytest.mark.parametrize(
    "points",
    [
        (POSES[:, :2], WEIGHTS),
        (POSES, None),
        (POSES, WEIGHTS, 0),
        (POSES.astype(str), WEIGHTS),
        (POSES, [[1.0], [0.0, 0.0]]),
        (np.ma.masked_greater(POSES, 100), WEIGHTS),
        5,
    ],
)
def test_points_that_are_not_numbers_of_that_shape_are_refused(points):
    said = r"^its belief of state 7 at offset -2 .*, but .*must be .*\.$"
    with pytest.raises(InputError, match=said):
        cloud_of(7, -2, points)


@pytest.mark.parametrize("weights", [2 * WEIGHTS, WEIGHTS * np.nan, [2, 0, 0, -1]])
def test_weights_that_are_negative_or_do_not_add_up_to_1_are_refused(weights):
    with pytest.raises(InputError, match="add up to 1"):
        belief_moments(together((POSES, WEIGHTS), (POSES, weights)))


@pytest.mark.parametrize(("column", "value"), [(0, math.nan), (1, math.inf), (2, 1e16)])
def test_a_pose_that_is_not_finite_or_huge_is_refused_also_at_weight_0(column, value):
    poses, weights = np.vstack([POSES, POSES[0]]), np.append(WEIGHTS, 0.0)
    poses[4, column] = value
    with pytest.raises(InputError, match="state 0 at offset 0 has poses that are not finite or"):
        belief_moments(together((POSES, WEIGHTS), (poses, weights)))


@settings(max_examples=500, deadline=None)
@given(NUMBERS | NUMBERS.map(np.asfortranarray) | ANYTHING, st.just(np.full(4, 0.25)) | ANYTHING)
def test_any_points_are_scored_as_numpy_would_or_refused_in_one_sentence(poses, weights):
    try:
        (ours,) = belief_moments(together((poses, weights)))
    except InputError as refusal:
        ours, said = None, str(refusal)
    if ours is None:
        assert re.fullmatch(r"its belief of state 0 at offset 0 .*\.", said)
        return
    x, y, heading = np.array(poses, np.float64).T
    shares = np.array(weights, np.float64)
    assert shares.min() >= 0
    assert abs(shares.sum() - 1) <= 1e-3
    points = np.column_stack([x, y, np.cos(heading), np.sin(heading)])
    mean = np.average(points, axis=0, weights=shares)
    scale = np.abs(points).max(axis=0)
    # float64: sums of up to 4 terms; our sines of 1e9 rad are good to 1e-6
    assert (np.abs(ours[:4] - mean) <= 1e-12 * scale + [0, 0, 1e-6, 1e-6]).all()
    assert np.isfinite(ours).all() or len(shares) == 1


def estimates(means, truth) -> scores.Estimates:
    states = np.arange(len(means))
    about = {"common": states >= 0, "thresholds": Thresholds(), "unit": "px"}
    return scores.Estimates(states=states, truth=truth, table=means, **about)


def estimate(x, y, heading, length=1.0):
    """An estimate of (x, y, cos θ, sin θ), (1, 4); a mean of directions is shorter than 1."""
    return np.array([[x, y, length * math.cos(heading), length * math.sin(heading)]])


def test_the_state_error_is_the_norm_over_x_y_cosine_and_sine_of_each_state():
    # (3, 4) px off, and (1, 0) where the heading π/2 has (0, 1): 9 + 16 + 1 + 1 = 27
    means = np.array([[13.0, 24, 1, 0], [0, 0, 0, 0]])
    truth = np.array([[10, 20, PI / 2 - 2 * PI], [0, 0, 0]])
    assert scores.state_error(means, truth) == pytest.approx([math.sqrt(27), 1], rel=1e-12)


@pytest.mark.parametrize("size", [1e-15, 1.0, 1e15])
def test_lengths_of_any_size_scale(size):
    means = size * np.array([[3.0, 4.0, 0.0, 0.0], [0.0, -5.0, 0.0, 0.0]])
    assert estimates(means, np.zeros((2, 3))).distance == pytest.approx([5 * size] * 2)
    assert scores.rms(size * np.array([1.0, 7.0])) == pytest.approx(5 * size)


@pytest.mark.parametrize(
    ("estimated", "true", "apart"),
    [
        (0.3, 0.1, 0.2),
        (PI - 0.1, -PI + 0.1, 0.2),  # 174° and -174° are 12° apart, not 348°
        (0.2, 0.1 + 6 * PI, 0.1),
        (PI / 2, -PI / 2, PI),
    ],
)
@pytest.mark.parametrize("length", [1.0, 0.01])
def test_the_heading_error_is_the_shorter_way_round_for_any_mean(estimated, true, apart, length):
    means = estimate(0, 0, estimated, length)
    error = estimates(means, np.array([[5.0, 5.0, true]])).angle
    assert error == pytest.approx([apart], abs=1e-12)  # a few roundings of numbers below 20


def test_entropy_does_not_fall_below_that_of_the_floors():
    # ½ log(10⁻² · 10⁻² · 10⁻⁶ · 10⁻⁶) = -8 log 10 = -18.4206807440
    for variances in ([0, 0, 0, 0], [1e-2, 1e-2, 1e-6, 1e-6], [1e-3, 0, 1e-7, 1e-30]):
        lowest = scores.entropy(np.array([variances]), "px")
        assert lowest == pytest.approx([FOUR - 18.4206807440], abs=1e-9)


def test_the_floors_of_a_room_in_metres_are_as_large_as_in_pixels():
    # a pixel is 2 cm: each of two lengths adds log 0.02
    in_pixels, in_metres = (scores.entropy(np.zeros((1, 4)), unit) for unit in ("px", "m"))
    assert in_metres - in_pixels == pytest.approx([2 * math.log(0.02)], abs=1e-12)
