"""Priors, and the motion model: exact without noise; moments against the analytic ones.

θ' ~ N(μ, s²) with μ = θ + φ, s = turn |φ| + drift |d|, and D ~ N(d, (drive |d|)²), independent.
With E cos θ' = e^(-s²/2) cos μ and E cos² θ' = (1 + e^(-2s²) cos 2μ) / 2:

    E x' = x + d e^(-s²/2) cos μ        Var x' = E D² (1 + e^(-2s²) cos 2μ) / 2 - (E x' - x)²
    E y' = y + d e^(-s²/2) sin μ        Var y' = E D² (1 - e^(-2s²) cos 2μ) / 2 - (E y' - y)²
    Cov(x', y') = E D² e^(-2s²) sin(2μ) / 2 - (E x' - x)(E y' - y)

Each moment of N = 100,000 samples is tested at 5 standard errors: false alarms 6e-7 each, 5e-5 for
the 80 together. float32 adds at most 3e-5 px per sample, a hundredth of a standard error; s ≤ 0.5
keeps headings from wrapping (6 s).
"""

import math

import numpy as np
import pytest
from following import STILL, wrapped

from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.validation import InputError
from localizers import GaussianPrior, OdometryMotion, RobotModel, UniformPrior, make
from localizers.checks import default_robot
from localizers.models import motion as kernels

N = 100_000
START = (120.0, -40.0, 0.7)
ACTIONS = [(20.0, 0.0), (20.0, 0.5), (-15.0, -1.0), (3.0, 2.0), (8.0, -3.0)]
MOTIONS = [
    OdometryMotion(drive=0.2, turn=0.1, drift=0.01),
    OdometryMotion(drive=0.05, turn=0.1, drift=0.02),
]


def column(pose: tuple[float, float, float], n: int) -> np.ndarray:
    return np.repeat(np.array(pose, dtype=np.float32)[:, None], n, axis=1)


def drawn(motion: OdometryMotion, action: tuple, seed: int = 1, n: int = N) -> np.ndarray:
    after = motion.sample(column(START, n), np.array(action), np.random.default_rng(seed))
    assert after.shape == (3, n)
    assert after.dtype == np.float32
    return after.astype(np.float64)


def z(samples: np.ndarray, expected: float) -> float:
    """(Mean - expected) in standard errors."""
    return (samples.mean() - expected) / (samples.std(ddof=1) / math.sqrt(samples.size))


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("action", ACTIONS)
def test_the_moments_of_100_000_samples_are_the_analytic_ones(motion, action):
    x, y, heading = drawn(motion, action)
    distance, turn = action
    mu, s = START[2] + turn, motion.turn * abs(turn) + motion.drift * abs(distance)
    square = distance**2 + (motion.drive * distance) ** 2
    shrink, shrink2 = math.exp(-(s**2) / 2), math.exp(-2 * s**2)
    mx, my = distance * shrink * math.cos(mu), distance * shrink * math.sin(mu)
    dx, dy, off = x - START[0], y - START[1], wrapped(heading - mu)
    scores = {
        "E x": z(dx, mx),
        "E y": z(dy, my),
        # means of squares about the known mean, so that the standard error is the plain one
        "Var x": z((dx - mx) ** 2, square * (1 + shrink2 * math.cos(2 * mu)) / 2 - mx**2),
        "Var y": z((dy - my) ** 2, square * (1 - shrink2 * math.cos(2 * mu)) / 2 - my**2),
        "Cov": z((dx - mx) * (dy - my), square * shrink2 * math.sin(2 * mu) / 2 - mx * my),
        "E heading": z(off, 0.0),
        "Var heading": z(off**2, s**2),
        "E cos": z(np.cos(heading), shrink * math.cos(mu)),
    }
    assert {name: score for name, score in scores.items() if abs(score) > 5} == {}


@pytest.mark.parametrize("action", ACTIONS)
def test_both_noises_are_normal_and_independent(action):
    motion, (distance, turn) = MOTIONS[0], action
    x, y, heading = drawn(motion, action, seed=2)
    s = motion.turn * abs(turn) + motion.drift * abs(distance)
    along = (x - START[0]) * np.cos(heading) + (y - START[1]) * np.sin(heading)
    noise_d = (along - distance) / (motion.drive * abs(distance))
    noise_turn = wrapped(heading - START[2] - turn) / s
    for noise in (noise_d, noise_turn):
        for bound in (-2, -1, 0, 0.5, 1.5):  # 50 shares at 5 standard errors: 3e-5
            assert abs(z(noise <= bound, (1 + math.erf(bound / math.sqrt(2))) / 2)) < 5
    assert abs(z(noise_d * noise_turn, 0.0)) < 5
    assert abs(z(noise_d**2 * noise_turn**2, 1.0)) < 5


def test_standing_still_changes_no_bit_even_where_the_noise_is_large():
    rng = np.random.default_rng(3)
    poses = rng.uniform((0, 0, -3.14), (350, 300, 3.14), (1000, 3)).astype(np.float32).T
    after = OdometryMotion(drive=9, turn=9, drift=9).sample(poses, np.zeros(2), rng)
    assert np.array_equal(after, poses)


@pytest.mark.parametrize("turns", [-3, -1, 0, 1, 3])
def test_the_heading_comes_back_to_within_half_a_turn_and_means_the_same_direction(turns):
    headings = np.linspace(-math.pi, math.pi, 2001, dtype=np.float32)
    poses = np.stack([np.zeros_like(headings), np.zeros_like(headings), headings])
    turn = turns * 2 * math.pi + 0.3
    after = STILL.sample(poses, np.array([0.0, turn]), np.random.default_rng(0))[2]
    assert np.abs(after).max() <= np.float32(math.pi)
    # sums up to 22 rad are resolved to 2e-6 by float32
    assert np.abs(wrapped(after.astype(float) - headings - turn)).max() < 4e-6


def test_two_normal_numbers_are_drawn_per_particle_whatever_the_action():
    states = []
    for action in [(0.0, 0.0), *ACTIONS]:
        rng = np.random.default_rng(5)
        MOTIONS[0].sample(column(START, 10), np.array(action), rng)
        states.append(rng.bit_generator.state)
    assert all(state == states[0] for state in states)


def pairs(uniforms: np.ndarray) -> np.ndarray:
    out = np.empty((2, uniforms.size), np.float32)
    kernels.normal_pairs(uniforms, 0.0, 1.0, 0.0, 1.0, out[0], out[1])
    return out.astype(np.float64)


def test_a_pair_is_box_and_mullers_formula():
    uniforms = np.random.default_rng(1).random(10_000)
    scaled = uniforms * 2**24
    radius = np.sqrt(-2 * np.log((np.floor(scaled) + 0.5) / 2**24))
    angle = 2 * np.pi * (scaled % 1)
    # float32: the argument of the logarithm is off by 6e-8, the radius by that over itself, at
    # least 0.01 here; the angle by 4e-7 rad, the radius at most 5.9
    expected = radius * np.array([np.cos(angle), np.sin(angle)])
    assert np.abs(pairs(uniforms) - expected).max() < 1e-5


def test_the_least_and_the_largest_uniform_number_make_finite_pairs():
    ends = pairs(np.array([0.0, 1 - 2**-53]))
    assert ends[0, 0] == pytest.approx(np.sqrt(2 * np.log(2**25)), rel=1e-6)
    assert np.isfinite(ends).all()


HALL = PolygonMap(outer=[(0, 0), (9, 0), (9, 6), (0, 6)], unit="m")
PRIOR = GaussianPrior(mean=(50.0, 40.0, 3.0), sd_position=15.0, sd_heading=0.2)


def test_the_log_density_is_that_of_three_normals():
    poses = np.array([(50, 40, 3.0), (65, 40, 3.0), (50, 10, 3.2)])
    peak = -3 / 2 * math.log(2 * math.pi) - math.log(15 * 15 * 0.2)
    assert PRIOR.log_density(poses) == pytest.approx([peak, peak - 0.5, peak - 2 - 0.5])


def test_headings_a_full_turn_apart_have_the_same_density():
    poses = np.array([(50, 40, 3.1), (50, 40, 3.1 - 2 * math.pi), (50, 40, 3.1 + 4 * math.pi)])
    density = PRIOR.log_density(poses)
    assert density == pytest.approx(np.full(3, density[0]), abs=1e-9)


def test_the_gaussian_of_a_kalman_filter_has_the_moments_of_a_uniform_prior(robot):
    prior = UniformPrior(floor_plan=robot.floor_plan)
    poses, _ = make("ekf", robot).reset(prior, [], np.random.default_rng(0)).points()
    # symmetric about (175, 150); 10,000 draws: 5 standard errors of sds of about 100 px
    assert np.abs(poses.mean(axis=0)[:2] - (175, 150)).max() < 5 * 110 / 100
    drawn = prior.sample(10_000, np.random.default_rng(1))[:, :2]
    assert np.abs(poses.std(axis=0)[:2] / drawn.std(axis=0) - 1).max() < 10 / math.sqrt(20_000)


@pytest.mark.parametrize("name", ["mcl", "deq-mcl", "ekf", "grid", "amcl"])
def test_a_spread_of_10_px_by_default_is_refused_on_a_map_in_metres(name):
    localizer = make(name, RobotModel(floor_plan=HALL, lidar=Lidar(max_range=9.0)))
    plan, rng = np.zeros((0, 2)), np.random.default_rng(0)
    with pytest.raises(InputError, match="give sd_position in m"):
        localizer.reset(GaussianPrior(mean=(4.0, 3.0, 0.0)), plan, rng)
    localizer.reset(GaussianPrior(mean=(4.0, 3.0, 0.0), sd_position=10.0), plan, rng)


def test_a_spread_that_is_not_given_is_10_px_in_a_room():
    assert GaussianPrior(mean=(1.0, 2.0, 0.0)) == GaussianPrior(mean=(1, 2, 0), sd_position=10.0)
    robot = default_robot()
    plan, rng = np.zeros((0, 2)), np.random.default_rng(0)
    make("mcl", robot).reset(GaussianPrior(mean=(50.0, 50.0, 0.0)), plan, rng)
