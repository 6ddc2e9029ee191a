"""Backward simulation draws from the smoothing distribution, by a motion with a density."""

import math

import numpy as np
import pytest
import ring

from localizers import DifferentialMotion, OdometryMotion, OmniMotion
from localizers.inference.backward import GaussianMotion, backward, forward
from localizers.inference.particles import Resampling, multinomial
from localizers.models.scan import Scan

ACTIONS = np.array(ring.AS_PLANNED.executed, float)[:, None]
MOTIONS = [DifferentialMotion(), OmniMotion(), OdometryMotion(drive=0.2, turn=0.2, drift=0.2)]
STEP_ACTIONS = [(0.2, 0.0, 0.0), (0.15, 0.05, 0.1), (0.0, 0.0, 0.1), (-0.2, 0.0, 0.05)]


class RingTransition(ring.RingMotion):
    def density(self, before, after, action):
        return ring.transition(int(action[0]), 0.0)[before[0][None], after[0][:, None]]


def test_on_the_ring_it_is_unbiased_for_the_enumerated_smoother():
    """E[p̂(o) · share of paths in i at s] = γ_T(x_s = i): 25 z-scores, |z| < 4.5 (false: 2e-4)."""
    particles = ring.ring_filter(0.0, resampling=Resampling(multinomial))
    exact, figures = ring.gamma(ring.STEPS, ring.AS_PLANNED.executed, 0.0), []
    for seed in range(2000):
        believed = list(ring.beliefs(particles, ring.AS_PLANNED, seed))
        clouds = [(belief.present, belief.weights) for belief in believed]
        rng = np.random.default_rng([seed, 1])
        paths = backward(clouds, RingTransition(), ACTIONS, 4, rng)
        shares = (paths[:, 0, :, None] == np.arange(ring.STATES)).mean(axis=1)
        figures.append(math.exp(believed[-1].log_evidence) * shares)
    error = np.std(figures, axis=0, ddof=1) / math.sqrt(len(figures))
    assert np.abs((np.mean(figures, axis=0) - exact) / error).max() < 4.5


class Line:
    """x' = x + u + N(0, 0.5²), seen with an error of 1."""

    sd = 0.5

    def sample(self, states, action, rng):
        return states + action[0] + self.sd * rng.standard_normal(states.shape)

    def density(self, before, after, action):
        off = after[0][:, None] - before[0] - action[0]
        return np.exp(-0.5 * (off / self.sd) ** 2) / (self.sd * math.sqrt(2 * math.pi))

    def log_likelihood(self, states, scan):
        return -0.5 * (states[0] - scan.ranges[0]) ** 2


class Start:
    def sample(self, n, rng):
        return rng.standard_normal((n, 1))


def test_on_a_line_it_is_the_smoother_of_rauch_tung_and_striebel():
    rng, steps = np.random.default_rng(1), 30
    actions = np.ones((steps, 1))
    seen = np.arange(steps + 1) + rng.standard_normal(steps + 1)
    means, variances, predicted = [], [], []
    mean, variance, log_evidence = 0.0, 1.0, 0.0
    for t, o in enumerate(seen):
        if t:
            mean, variance = mean + 1.0, variance + Line.sd**2
        predicted.append((mean, variance))
        log_evidence -= (math.log1p(variance) + (o - mean) ** 2 / (1 + variance)) / 2
        gain = variance / (variance + 1)
        mean, variance = mean + gain * (o - mean), (1 - gain) * variance
        means.append(mean)
        variances.append(variance)
    together = np.zeros(steps)  # the covariance of neighbours
    for t in range(steps - 1, -1, -1):
        gain = variances[t] / predicted[t + 1][1]
        together[t] = gain * variances[t + 1]
        means[t] += gain * (means[t + 1] - predicted[t + 1][0])
        variances[t] += gain**2 * (variances[t + 1] - predicted[t + 1][1])
    scans = [Scan(np.array([o]), np.ones(1, bool), 1) for o in seen]
    runs, evidence = [], []
    for seed in range(40):
        stream = np.random.default_rng(seed)
        line, how = Line(), {"dtype": np.float64}
        clouds, own = forward(Start(), line, line, scans, actions, 500, stream, **how)
        evidence.append(math.exp(own - log_evidence))
        runs.append(backward(clouds, Line(), actions, 100, stream)[:, 0])
    assert np.mean(evidence) == pytest.approx(1, abs=0.05)
    # 31 z-scores of run means, |z| < 5 of t with 39 degrees of freedom (false: 4e-4)
    averages = np.mean(runs, axis=2)
    error = averages.std(axis=0, ddof=1) / math.sqrt(len(runs))
    assert np.abs((averages.mean(axis=0) - means) / error).max() < 5
    paths = np.concatenate(runs, axis=1)
    np.testing.assert_allclose(paths.var(axis=1), variances, rtol=0.15)
    apart = np.add(variances[1:], variances[:-1]) - 2 * together
    np.testing.assert_allclose(np.diff(paths, axis=0).var(axis=1), apart, rtol=0.15)


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda motion: type(motion).__name__)
@pytest.mark.parametrize("action", STEP_ACTIONS)
def test_a_gaussian_motion_has_the_moments_of_the_model_and_its_slips(motion, action):
    told, rng, heading = np.array(action), np.random.default_rng(5), 1.0
    start = np.repeat(np.array([[1.0], [2.0], [heading]], np.float32), 100_000, axis=1)
    gaussian = GaussianMotion(motion=motion, length=0.01)
    into = np.array([[math.cos(heading), math.sin(heading), 0],
                     [-math.sin(heading), math.cos(heading), 0], [0, 0, 1]])  # fmt: skip
    theirs, ours = (into @ (model.sample(start, told, rng) - start) for model in (motion, gaussian))
    np.testing.assert_allclose(ours.mean(axis=1), theirs.mean(axis=1), atol=4e-3)
    expected = np.cov(theirs) + np.diag(np.square([0.01, 0.01, 0.01]))
    # of the noise ahead a tenth has 25 times the variance: 3.4 times in all
    root = np.linalg.cholesky(expected) * [math.sqrt(3.4), 1, 1]
    off, sds = np.cov(ours) - root @ root.T, np.sqrt(np.diag(root @ root.T))
    assert np.abs(off / np.outer(sds, sds)).max() < 0.06


def test_its_density_integrates_to_one_and_is_that_of_its_draws():
    gaussian = GaussianMotion(motion=DifferentialMotion(), length=0.01)
    action, rng, n = np.array([0.2, 0.0, 0.1]), np.random.default_rng(0), 200_000
    start = np.array([[0.5], [-1.0], [1.0]], np.float32)
    after = gaussian.sample(np.repeat(start, n, axis=1), action, rng)
    middle = after.mean(axis=1, keepdims=True)

    def mass(half):
        """∫ p over a box of this half-width about the middle, by uniform draws."""
        half = np.array(half)[:, None]
        box = (middle + half * rng.uniform(-1, 1, (3, n))).astype(np.float32)
        return gaussian.density(start, box, action)[:, 0].mean() * 8 * half.prod()

    for half in ([0.1, 0.1, 0.2], [0.3, 0.05, 0.1]):
        inside = (np.abs(after - middle) < np.array(half)[:, None]).all(axis=0)
        assert mass(half) == pytest.approx(inside.mean(), abs=0.01)  # 4 standard errors
    assert mass([1.5, 1.5, 0.8]) == pytest.approx(1.0, abs=0.1)
