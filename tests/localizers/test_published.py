"""A calibration finds what offsets were drawn by, and what it publishes covers them."""

import math

import numpy as np
import pytest
from believing import Believes
from refusals import refused

from deqmcl_gym.numerics import arrays
from localizers import Calibration, PointsBelief, Tracker

N = 2000
SIGMAS = 5  # a right code fails once in a million


def beliefs(rng, n):
    """Covariances of many sizes and shapes, (n, 3, 3), of headings far within a turn."""
    roots = rng.normal(0, 0.1, (n, 3, 3)) * [[[1.0], [1.0], [0.3]]]
    sizes = rng.uniform(0.3, 1.0, (n, 1, 1)) ** 2
    return sizes * (roots @ roots.transpose(0, 2, 1) + np.diag([0.01, 0.01, 0.001]))


def drawn(rng, covariances):
    roots = np.linalg.cholesky(covariances)
    return (roots @ rng.normal(size=(len(covariances), 3, 1)))[:, :, 0]


def test_what_offsets_were_drawn_by_is_found():
    """Half of the beliefs are points, which show the floor; the others the scale.

    The SD of k normal deviates is right to 1/√(2k): N of x and y, N/2 of θ; the scale, a variance,
    is of 3N/2 to √(2/k). Half a per cent more for three digits and the search.
    """
    rng = np.random.default_rng(1)
    right = Calibration(scale=4.0, position=0.003, heading=0.001)
    wide = beliefs(rng, N // 2)
    believed = np.concatenate([np.zeros_like(wide), wide])
    found = Calibration.fitted(drawn(rng, right.published(believed)), believed)
    for name, deviates, power in (("position", N, 1), ("heading", N / 2, 1), ("scale", 1.5 * N, 2)):
        off = SIGMAS * power / math.sqrt(2 * deviates) + 0.005
        assert getattr(found, name) == pytest.approx(getattr(right, name), rel=off)
    assert Calibration.fitted(drawn(rng, right.published(believed)), believed) != found


@pytest.mark.parametrize("factor", [0.04, 9.0])
def test_beliefs_too_sure_or_not_sure_enough_cover_fresh_offsets_as_they_say(factor):
    """A share p of m fresh offsets has variance p (1 - p) / m.

    And the log of the scale that of its fit, 2 / 3n, which moves the share by -(1 - p) log (1 - p).
    """
    rng = np.random.default_rng(2)
    true = beliefs(rng, 2 * N)
    off = drawn(rng, true)
    found = Calibration.fitted(off[:N], factor * true[:N])
    fits = np.empty((N, 3))
    arrays.fits(off[N:], found.published(factor * true[N:]), fits)
    for p in (0.5, 0.8, 0.95):
        moved = (1 - p) * math.log(1 - p)
        sd = math.sqrt(p * (1 - p) / N + moved**2 * 2 / (3 * N))
        share = (fits[:, 0] <= -2 * math.log(1 - p)).mean()
        assert abs(share - p) < SIGMAS * sd + 0.005
    arrays.fits(off[N:], factor * true[N:], fits)
    assert abs((fits[:, 0] <= 6).mean() - 0.95) > 0.04  # not before


def test_the_identity_publishes_what_is_believed():
    given = beliefs(np.random.default_rng(3), 8).reshape(2, 4, 3, 3)
    np.testing.assert_array_equal(Calibration().published(given), given)
    unknown = np.full((3, 3), np.nan)
    assert np.isnan(Calibration().published(unknown)).all()


def test_beliefs_without_a_spread_are_published_as_the_floor():
    calibration = Calibration(scale=0.5, position=0.2, heading=0.1)
    floor = np.diag([0.04, 0.04, 0.01])
    for point in (np.zeros((3, 3)), np.full((3, 3), np.nan)):
        np.testing.assert_allclose(calibration.published(point), floor)
    rng = np.random.default_rng(4)
    off = rng.normal(size=(N, 3)) * [0.2, 0.2, 0.1]
    off[0] = np.nan  # is left out
    off[1, 2] += 2 * math.pi  # is the same
    found = Calibration.fitted(off, np.full((N, 3, 3), np.nan))
    assert found.scale == 1.0
    assert found.position == pytest.approx(0.2, rel=SIGMAS / math.sqrt(4 * N) + 0.005)
    assert found.heading == pytest.approx(0.1, rel=SIGMAS / math.sqrt(2 * N) + 0.005)


@pytest.mark.parametrize(("points", "variance"), [(2, 0.01), (1, 0.0)])
def test_a_tracker_publishes_its_calibration(points, variance):
    calibration = Calibration(scale=2.0, position=0.3, heading=0.05)
    belief = PointsBelief(np.array([[1.0, 2.0, 0.1], [1.2, 2.0, 0.1]])[:points])
    found = {}
    for given in ({}, {"calibration": calibration}):
        tracker = Tracker(Believes(belief), np.random.default_rng(0), **given)
        tracker.odometry(0.0, (0.0, 0.0, 0.0))
        tracker.initialpose(None)
        found[bool(given)] = tracker.at().covariance
    believed = np.diag([variance, 0.0, 0.0])
    if points == 1:
        assert np.isnan(found[False]).all()
    else:
        np.testing.assert_allclose(found[False], believed, atol=1e-15)
    np.testing.assert_allclose(found[True], calibration.published(believed), atol=1e-15)


@pytest.mark.parametrize(
    ("refuse", "words"),
    [
        (lambda: Calibration().published(np.eye(2)), "must be (…, 3, 3)"),
        (lambda: Calibration.fitted(np.zeros((4, 2)), np.zeros((4, 3, 3))), "(4, 2)"),
        (lambda: Calibration.fitted(np.zeros((4, 3)), np.zeros((5, 3, 3))), "(5, 3, 3)"),
        (lambda: Calibration.fitted(np.full((4, 3), np.nan), np.ones((4, 3, 3))), "is finite"),
    ],
)
def test_what_is_no_calibration_is_refused(refuse, words):
    with refused(words):
        refuse()
