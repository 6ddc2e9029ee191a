"""Energy score, rank of the truth and NEES, against plain forms."""

import math

import numpy as np
import pytest

from benchmarks.trials import metrics


def cloud(n, seed, weighted=True):
    """A correlated cloud about (100, 60, 3.0): headings on both sides of π."""
    rng = np.random.default_rng(seed)
    z = rng.normal(size=(n, 3))
    poses = np.column_stack(
        [100 + 30 * z[:, 0], 60 + 10 * z[:, 0] + 15 * z[:, 1], 3.0 + 0.3 * z[:, 2] + 0.1 * z[:, 1]]
    )
    poses[:, 2] = (poses[:, 2] + math.pi) % (2 * math.pi) - math.pi
    return poses, rng.dirichlet(np.ones(n)) if weighted else np.full(n, 1 / n)


def plain_energy(poses, weights, truth):
    """Σ w |x - z| - ½ ΣΣ w w' |x - x'| over all pairs."""
    xy = poses[:, :2]
    apart = np.linalg.norm(xy[:, None] - xy[None], axis=2)
    return weights @ np.linalg.norm(xy - truth[:2], axis=1) - 0.5 * weights @ apart @ weights


TRUTH = np.array([110.0, 50.0, -3.1])


@pytest.mark.parametrize("n", [2, 3, 50, 1000])
def test_the_energy_score_is_that_of_all_pairs_up_to_the_pairs_left_out(n):
    # 128 points in systematic order estimate E|X - X'| with an SD below 2 √(Var h₁ / 128), where
    # h₁(x) = E|x - X'| varies by about a third of its mean: 6 %; the mean of 40 clouds: 1 %.
    # The bound is five of these.
    ratios = []
    for seed in range(40):
        poses, weights = cloud(n, seed)
        near = weights @ np.linalg.norm(poses[:, :2] - TRUTH[:2], axis=1)
        ours = near - metrics.cloud_scores(poses, weights, TRUTH).energy
        ratios.append(ours / (near - plain_energy(poses, weights, TRUTH)))
    assert np.mean(ratios) == pytest.approx(1, abs=0.05)


def test_the_energy_score_of_two_points_is_known_by_hand():
    poses = np.array([[0.0, 0, 0], [10.0, 0, 0]])
    ours = metrics.cloud_scores(poses, np.full(2, 0.5), np.array([5.0, 12.0, 0.0])).energy
    # both are 13 away; the 64 + 64 copies have 64 · 64 of 128 · 127 / 2 pairs 10 apart
    assert ours == pytest.approx(13 - 0.5 * 10 * 64 * 64 / (64 * 127), rel=1e-12)


def test_one_point_has_its_distance_as_energy_score_and_no_calibration():
    scores = metrics.cloud_scores(np.array([[3.0, 4.0, 1.0]]), np.ones(1), np.zeros(3))
    assert scores.energy == 5.0
    assert math.isnan(scores.rank)
    assert math.isnan(scores.nees)


def test_rank_and_nees_are_those_of_numpys_linear_algebra():
    for seed in range(20):
        poses, weights = cloud(300, seed)
        mean = weights @ poses[:, :2]
        angle = math.atan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))
        turned = (poses[:, 2] - angle + math.pi) % (2 * math.pi) - math.pi
        off = np.column_stack([poses[:, :2] - mean, turned])
        p = (weights[:, None] * off).T @ off + np.diag(metrics.COVARIANCE_FLOOR)
        gap = (TRUTH[2] - angle + math.pi) % (2 * math.pi) - math.pi
        d = np.array([*(TRUTH[:2] - mean), gap])
        inverse = np.linalg.inv(p[:2, :2])
        own = np.einsum("ni,ij,nj->n", off[:, :2], inverse, off[:, :2])
        scores = metrics.cloud_scores(poses, weights, TRUTH)
        assert scores.nees == pytest.approx(d @ np.linalg.inv(p) @ d, rel=1e-9)
        nearer = weights[own < d[:2] @ inverse @ d[:2]].sum()
        assert scores.rank == pytest.approx(nearer, abs=1e-12)


def test_a_truth_drawn_from_the_belief_has_uniform_rank_and_nees_3():
    # 2000 draws: each coverage has SD √(p (1 - p) / 2000) ≤ 0.0112; χ²₃ has SD √6, its mean of
    # 2000 0.055. Bounds five SD: a false alarm in 10⁶. The belief's own sampling error (1000
    # particles) adds at most 3 / 1000 to the mean of NEES.
    rng = np.random.default_rng(3)
    ranks, nees = [], []
    for _ in range(2000):
        draws = rng.normal(0, (20, 5, 0.2), size=(1001, 3))
        scores = metrics.cloud_scores(draws[1:], np.full(1000, 1e-3), draws[0])
        ranks.append(scores.rank)
        nees.append(scores.nees)
    for level in (0.5, 0.8, 0.95):
        assert np.mean(np.array(ranks) <= level) == pytest.approx(level, abs=0.056)
    assert np.mean(nees) == pytest.approx(3, abs=0.28)


def test_coverage_needs_no_gaussian_shape():
    # a ring: the Gaussian 50 % ellipse, radius² 1.39 of variance ½, would hold none of it
    rng = np.random.default_rng(4)
    angle = rng.uniform(0, 2 * math.pi, 1001)
    radius = 10 + 0.1 * rng.normal(size=1001)
    poses = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(1001)])
    ranks = [
        metrics.cloud_scores(poses[1:], np.full(1000, 1e-3), poses[0] * [scale, scale, 1]).rank
        for scale in (10 / radius[0], 0.5)
    ]
    assert 0.2 < ranks[0] < 0.8
    assert ranks[1] == 0.0


def test_a_collapsed_cloud_is_scored_by_the_floors_alone():
    poses, truth = np.zeros((5, 3)), np.array([0.3, 0.4, 0.0])
    scores = metrics.cloud_scores(poses, np.full(5, 0.2), truth)
    assert scores.nees == pytest.approx(0.25 / 1e-2, rel=1e-9)
    assert scores.rank == 1.0
    assert scores.energy == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_poses_in_any_layout_give_the_same_scores(dtype):
    poses, weights = cloud(100, 0)
    poses = poses.astype(dtype)
    columns = np.ascontiguousarray(poses.T).T
    for one, other in zip(
        metrics.cloud_scores(poses, weights, TRUTH),
        metrics.cloud_scores(columns, weights, TRUTH),
        strict=True,
    ):
        assert np.array_equal(one, other)
