"""Moments and scores of clouds against plain forms; what is no cloud."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from benchmarks.trials.clouds import belief_moments, calibration, cloud_of, covariance_floor, joined
from deqmcl_gym.validation import InputError
from localizers.methods.ekf import gaussian_points

PI = math.pi
TRUTH = np.array([110.0, 50.0, -3.1])


def cloud(n, seed):
    """A correlated cloud about (100, 60, 3.0): headings on both sides of π."""
    rng = np.random.default_rng(seed)
    z = rng.normal(size=(n, 3))
    poses = np.column_stack(
        [100 + 30 * z[:, 0], 60 + 10 * z[:, 0] + 15 * z[:, 1], 3.0 + 0.3 * z[:, 2] + 0.1 * z[:, 1]]
    )
    poses[:, 2] = (poses[:, 2] + PI) % (2 * PI) - PI
    return poses, rng.dirichlet(np.ones(n))


def together(*beliefs, truth=TRUTH):
    return joined([cloud_of(0, 0, points) for points in beliefs], [truth] * len(beliefs))


def spread(poses, weights):
    """Mean and variance of one cloud."""
    (row,) = belief_moments(together((poses, weights)))
    return row[:4], row[4:]


def calibrated(poses, weights, truth=TRUTH, unit="px"):
    """Energy score, rank, NEES, log score of one cloud."""
    clouds = together((poses, weights), truth=truth)
    return calibration(clouds, belief_moments(clouds)[:, :4], unit)[0]


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


def test_one_point_has_its_distance_as_energy_score_and_nothing_that_needs_a_spread():
    one = np.array([[3.0, 4.0, PI / 2]]), np.ones(1)
    mean, variance = spread(*one)
    assert mean == pytest.approx([3, 4, 0, 1], abs=1e-15)
    energy, *others = calibrated(*one, truth=np.zeros(3))
    assert energy == 5.0
    assert np.isnan([*variance, *others]).all()


def plain_energy(poses, weights, truth):
    """Σ w |x - z| - ½ ΣΣ w w' |x - x'| over all pairs."""
    xy = poses[:, :2]
    apart = np.linalg.norm(xy[:, None] - xy[None], axis=2)
    return weights @ np.linalg.norm(xy - truth[:2], axis=1) - 0.5 * weights @ apart @ weights


@pytest.mark.parametrize("n", [2, 3, 50, 1000])
def test_the_energy_score_is_that_of_all_pairs_up_to_the_pairs_left_out(n):
    # 128 points in systematic order estimate E|X - X'| with an SD below 2 √(Var h₁ / 128), where
    # h₁(x) = E|x - X'| varies by about a third of its mean: 6 %; the mean of 40 clouds: 1 %.
    # The bound is five of these.
    ratios = []
    for seed in range(40):
        poses, weights = cloud(n, seed)
        near = weights @ np.linalg.norm(poses[:, :2] - TRUTH[:2], axis=1)
        ours = near - calibrated(poses, weights)[0]
        ratios.append(ours / (near - plain_energy(poses, weights, TRUTH)))
    assert np.mean(ratios) == pytest.approx(1, abs=0.05)


def test_the_energy_score_of_two_points_is_known_by_hand():
    poses = np.array([[0.0, 0, 0], [10.0, 0, 0]])
    energy, *_ = calibrated(poses, np.array([0.4, 0.6]), np.array([5.0, 12.0, 0.0]))
    # both are 13 away; the 51 + 77 copies have 51 · 77 of 128 · 127 / 2 pairs 10 apart
    assert energy == pytest.approx(13 - 0.5 * 10 * 51 * 77 / (64 * 127), rel=1e-12)


@pytest.mark.parametrize("root", [np.diag([3.0, 3, 1]), np.tril(np.ones((3, 3))) * [9, 1, 0.1]])
def test_the_energy_score_of_a_designed_set_of_points_is_that_of_all_pairs(root):
    poses = gaussian_points(np.array([1e4, 50.0, 1.0]), root @ root.T)
    weights, truth = np.full(512, 1 / 512), np.array([1e4 + 2, 51.0, 1.0])
    energy, *_ = calibrated(poses, weights, truth)
    assert energy == pytest.approx(plain_energy(poses, weights, truth), rel=1e-5)


def test_rank_nees_and_log_score_are_those_of_numpys_linear_algebra():
    for seed in range(20):
        poses, weights = cloud(300, seed)
        mean = weights @ poses[:, :2]
        angle = math.atan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))
        turned = (poses[:, 2] - angle + PI) % (2 * PI) - PI
        off = np.column_stack([poses[:, :2] - mean, turned])
        p = (weights[:, None] * off).T @ off + np.diag(covariance_floor("px"))
        d = np.array([*(TRUTH[:2] - mean), (TRUTH[2] - angle + PI) % (2 * PI) - PI])
        inverse = np.linalg.inv(p[:2, :2])
        own = np.einsum("ni,ij,nj->n", off[:, :2], inverse, off[:, :2])
        _, rank, nees, log_score = calibrated(poses, weights)
        density = stats.multivariate_normal(np.zeros(3), p).logpdf(d)
        assert log_score == pytest.approx(-density, rel=1e-9)
        assert nees == pytest.approx(d @ np.linalg.inv(p) @ d, rel=1e-9)
        nearer = weights[own < d[:2] @ inverse @ d[:2]].sum()
        assert rank == pytest.approx(nearer, abs=1e-12)


def test_a_truth_drawn_from_the_belief_has_uniform_rank_and_nees_3():
    # 2000 draws: each coverage has SD √(p (1 - p) / 2000) ≤ 0.0112; χ²₃ has SD √6, its mean of
    # 2000 0.055. Bounds five SD: a false alarm in 10⁶. The belief's own sampling error (1000
    # particles) adds at most 3 / 1000 to the mean of NEES.
    rng = np.random.default_rng(3)
    found = []
    for _ in range(2000):
        draws = rng.normal(0, (20, 5, 0.2), size=(1001, 3))
        found.append(calibrated(draws[1:], np.full(1000, 1e-3), draws[0]))
    _, rank, nees, _ = np.array(found).T
    for level in (0.5, 0.8, 0.95):
        assert np.mean(rank <= level) == pytest.approx(level, abs=0.056)
    assert np.mean(nees) == pytest.approx(3, abs=0.28)


def test_the_log_score_of_too_small_and_of_too_large_a_spread_is_worse_than_that_of_the_true_one():
    # a spread of k times that of the truth costs 3 log k + 3 / (2 k²) - 3 / 2 nats; over 400 draws
    # with an SD of √(3 / 2) |1 - 1 / k²| / 20: below 0.19 and 0.05. Five SD: a false alarm in 10⁶
    rng = np.random.default_rng(5)
    z = rng.normal(size=(401, 1000, 3))
    sd = np.array([20, 5, 0.2])
    truths, shares = z[0, :400] * sd, np.full(1000, 1e-3)
    each = zip(z[1:], truths, strict=True)
    found = np.array(
        [[calibrated(k * sd * own, shares, truth)[3] for k in (0.5, 1, 2)] for own, truth in each]
    )
    small, true, large = found.mean(axis=0)
    cost = {k: 3 * math.log(k) + 1.5 / k**2 - 1.5 for k in (0.5, 2)}
    assert small - true == pytest.approx(cost[0.5], abs=5 * 0.19)
    assert large - true == pytest.approx(cost[2], abs=5 * 0.05)


def test_coverage_needs_no_gaussian_shape():
    # a ring: the Gaussian 50 % ellipse, radius² 1.39 of variance ½, would hold none of it
    rng = np.random.default_rng(4)
    angle = rng.uniform(0, 2 * PI, 1001)
    radius = 10 + 0.1 * rng.normal(size=1001)
    poses = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(1001)])
    _, on_it, *_ = calibrated(poses[1:], np.full(1000, 1e-3), poses[0] * (10 / radius[0]))
    _, inside, *_ = calibrated(poses[1:], np.full(1000, 1e-3), poses[0] * 0.5)
    assert 0.2 < on_it < 0.8
    assert inside == 0.0


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
    assert np.array_equal(calibration(clouds, spreads[:, :4], "px")[1], calibrated(poses, weights))


POSES, WEIGHTS = cloud(4, 0)


@pytest.mark.parametrize(
    "points",
    [
        (POSES[:, :2], WEIGHTS),
        (POSES, WEIGHTS[:3]),
        (POSES, WEIGHTS[:, None]),
        (np.empty((0, 3)), np.empty(0)),
        (POSES[0], 1.0),
        (POSES, None),
        (POSES, WEIGHTS, 0),
        (POSES.astype(str), WEIGHTS),
        (POSES + 1j, WEIGHTS),
        (POSES, np.ones(4, bool)),
        (POSES, [[1.0], [0.0, 0.0]]),
        (np.ma.masked_greater(POSES, 100), WEIGHTS),
        POSES,
        {0: POSES, 1: WEIGHTS},
        5,
    ],
)
def test_points_that_are_not_numbers_of_that_shape_are_refused(points):
    said = r"^its belief of state 7 at offset -2 .*, but .*must be .*\.$"
    with pytest.raises(InputError, match=said):
        cloud_of(7, -2, points)


@pytest.mark.parametrize(
    "weights",
    [2 * WEIGHTS, np.ones(4), np.zeros(4), np.log(WEIGHTS), WEIGHTS * np.nan, [2, 0, 0, -1]],
)
def test_weights_that_are_negative_or_do_not_add_up_to_1_are_refused(weights):
    with pytest.raises(InputError, match="add up to 1"):
        belief_moments(together((POSES, WEIGHTS), (POSES, weights)))


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e16])
@pytest.mark.parametrize("column", range(3))
def test_a_pose_that_is_not_finite_or_huge_is_refused_also_at_weight_0(value, column):
    poses, weights = np.vstack([POSES, POSES[0]]), np.append(WEIGHTS, 0.0)
    poses[4, column] = value
    with pytest.raises(InputError, match="state 0 at offset 0 has poses that are not finite or"):
        belief_moments(together((POSES, WEIGHTS), (poses, weights)))


def test_weights_that_add_up_to_1_but_for_rounding_are_divided_by_their_sum():
    exact, rounded = spread(POSES, WEIGHTS), spread(POSES, 1.0009 * WEIGHTS)
    for ours, theirs in zip(rounded, exact, strict=True):
        assert ours == pytest.approx(theirs, rel=1e-12, abs=1e-12)


def test_what_a_localizer_does_with_its_arrays_afterwards_changes_no_cloud():
    poses, weights = POSES.copy(), WEIGHTS.copy()
    kept = cloud_of(0, 0, (poses, weights))
    poses[:], weights[:] = np.nan, np.nan
    assert np.array_equal(kept.poses.T, POSES)
    assert np.array_equal(kept.weights, WEIGHTS)


NUMBERS = st.floats(width=32) | st.sampled_from([0.0, 1.0, 0.5, 1e-300, 1e300])
DTYPES = st.sampled_from(["f2", "f4", "f8", "g", "i4", "u1", "i8", "?", "c8", "O", "U4"])
SHAPES = st.tuples(st.integers(0, 4), st.integers(1, 4)) | st.tuples(st.integers(0, 4))


@st.composite
def arrays_of_any_kind(draw, columns=None):
    """An array that may be poses or weights: of any type, layout and content."""
    n = draw(st.integers(1, 4))
    shape = draw(st.just((n, columns) if columns else (n,)) | SHAPES)
    size = math.prod(shape)
    values = draw(st.lists(NUMBERS, min_size=size, max_size=size))
    if columns is None and draw(st.booleans()) and size:
        values = [1 / size] * size
    with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
        found = np.array(values, object).reshape(shape)
        try:
            found = found.astype(draw(DTYPES))
        except (ValueError, OverflowError):  # NaN as an integer
            found = found.astype("f8")
    if draw(st.booleans()):
        found = np.asfortranarray(found)
    if draw(st.booleans()):
        found = np.repeat(found, 2, axis=0)[::2]  # not contiguous
    if draw(st.booleans()):
        found = np.ma.masked_array(found, found == 0.0)
    found.flags.writeable = draw(st.booleans())
    return found


def scored(poses, weights):
    """Moments, or why there are none."""
    try:
        (ours,) = belief_moments(together((poses, weights)))
    except InputError as refusal:
        return None, str(refusal)
    return ours, None


@settings(max_examples=500, deadline=None)
@given(arrays_of_any_kind(columns=3), arrays_of_any_kind())
def test_any_points_are_scored_as_numpy_would_or_refused_in_one_sentence(poses, weights):
    ours, refusal = scored(poses, weights)
    if refusal is not None:
        assert refusal.startswith("its belief of state 0 at offset 0 ")
        assert refusal.endswith(".")
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
