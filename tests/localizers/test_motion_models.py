"""Motion models: means and variances as told by the book and by Nav2's source; fits to logs."""

import math

import numpy as np
import pytest
from following import STILL, wrapped

from deqmcl_gym.validation import InputError
from localizers import OdometryMotion, UniformPrior, make
from localizers.models import motion as kernels
from localizers.models.nav2_motion import DifferentialMotion, OmniMotion, moved

N = 100_000
START = (120.0, -40.0, 0.7)
STARTS = np.repeat(np.float32(START)[:, None], N, axis=1)
ACTIONS = [(20.0, 0.0), (20.0, 0.5), (-15.0, -1.0), (3.0, 2.0), (8.0, -3.0)]
NOISES = ({"drive": 0.2, "turn": 0.1, "drift": 0.01}, {"drive": 0.05, "turn": 0.1, "drift": 0.02})
MOTIONS = [OdometryMotion(**noise) for noise in NOISES]


def z(samples: np.ndarray, expected: float) -> float:
    return (samples.mean() - expected) / (samples.std(ddof=1) / math.sqrt(samples.size))


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("motion", MOTIONS)
def test_both_noises_are_normal_and_independent(motion, action):
    """θ' ~ N(θ + φ, (turn |φ| + drift |d|)²), then D ~ N(d, (drive |d|)²) along θ'."""
    distance, turn = action
    after = motion.sample(STARTS, np.array(action), np.random.default_rng(2))
    assert after.dtype == np.float32
    x, y, heading = after.astype(np.float64)
    s = motion.turn * abs(turn) + motion.drift * abs(distance)
    along = (x - START[0]) * np.cos(heading) + (y - START[1]) * np.sin(heading)
    across = (y - START[1]) * np.cos(heading) - (x - START[0]) * np.sin(heading)
    assert np.abs(across).max() < 1e-4  # float32 of 160 px
    noise_d = (along - distance) / (motion.drive * abs(distance))
    noise_turn = wrapped(heading - START[2] - turn) / s
    for noise in (noise_d, noise_turn):
        for bound in (-2, -1, 0, 0.5, 1.5):  # 100 shares at 5 standard errors: 6e-5
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
        MOTIONS[0].sample(STARTS[:, :10], np.array(action), rng)
        states.append(rng.bit_generator.state)
    assert all(state == states[0] for state in states)


def test_the_least_and_the_largest_uniform_number_make_finite_pairs():
    ends = np.empty((2, 2), np.float32)
    kernels.normal_pairs(np.array([0.0, 1 - 2**-53]), 0.0, 1.0, 0.0, 1.0, ends[0], ends[1])
    assert ends[0, 0] == pytest.approx(np.sqrt(2 * np.log(2**25)), rel=1e-6)
    assert np.isfinite(ends).all()


def test_the_gaussian_of_a_kalman_filter_has_the_moments_of_a_uniform_prior(robot):
    prior = UniformPrior(floor_plan=robot.floor_plan)
    poses, _ = make("ekf", robot).reset(prior, [], np.random.default_rng(0)).points()
    # symmetric about (175, 150); 10,000 draws: 5 standard errors of sds of about 100 px
    assert np.abs(poses.mean(axis=0)[:2] - (175, 150)).max() < 5 * 110 / 100
    drawn = prior.sample(10_000, np.random.default_rng(1))[:, :2]
    assert np.abs(poses.std(axis=0)[:2] / drawn.std(axis=0) - 1).max() < 10 / math.sqrt(20_000)


ALPHAS = {"alpha1": 0.001, "alpha2": 0.002, "alpha3": 0.003, "alpha4": 0.0004}
# (forward, left, turn), and (rot1, trans, rot2, r1, r2): rot1 is turn + atan2(left, forward)
CASES = {
    "straight": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0, 0.0)),
    "turn, then drive": ((1.0, 0.0, 0.4), (0.4, 1.0, 0.0, 0.4, 0.0)),
    "arc": ((math.cos(0.2), -math.sin(0.2), 0.4), (0.2, 1.0, 0.2, 0.2, 0.2)),
    "backward": ((-1.0, 0.0, 0.0), (math.pi, 1.0, -math.pi, 0.0, 0.0)),
    "backward arc": (
        (-math.cos(0.2), math.sin(0.2), 0.4), (0.2 - math.pi, 1.0, 0.2 + math.pi, 0.2, 0.2)
    ),
    "in place": ((0.0, 0.0, 0.7), (0.0, 0.0, 0.7, 0.0, 0.7)),
    "nearly in place": ((0.0, 0.009, 0.7), (0.0, 0.009, 0.7, 0.0, 0.7)),
    "strafing": ((0.0, 1.0, 0.0), (math.pi / 2, 1.0, -math.pi / 2, math.pi / 2, math.pi / 2)),
}  # fmt: skip


def draws(motion, increment, heading=0.0) -> np.ndarray:
    states = np.zeros((3, N), np.float32)
    states[2] = heading
    return motion.sample(states, np.array(increment), np.random.default_rng(7)).astype(float)


def assert_normal(seen, mean, variance):
    assert seen.mean() == pytest.approx(mean, abs=5 * math.sqrt(variance / N) + 1e-6)
    assert seen.var() == pytest.approx(variance, rel=5 * math.sqrt(2 / N), abs=1e-10)


@pytest.mark.parametrize("case", CASES)
def test_the_differential_model_has_the_sources_means_and_variances(case):
    increment, (rot1, trans, rot2, r1, r2) = CASES[case]
    a1, a2, a3, a4 = ALPHAS.values()
    x, y, heading = draws(DifferentialMotion(**ALPHAS), increment)
    drive_variance = a3 * trans**2 + a4 * (r1**2 + r2**2)
    first, second = a1 * r1**2 + a2 * trans**2, a1 * r2**2 + a2 * trans**2
    assert_normal(wrapped(heading - rot1 - rot2), 0.0, first + second)
    if trans < 0.1:  # ρ varies about 0, either way, along a heading that hardly does
        assert x.mean() == pytest.approx(trans, abs=5 * math.sqrt(drive_variance / N) + 1e-4)
        assert np.hypot(x, y).max() < trans + 6 * math.sqrt(drive_variance)
        return
    assert_normal(np.hypot(x, y), trans, drive_variance)
    assert_normal(wrapped(np.arctan2(y, x) - rot1), 0.0, first)
    # the turns are independent: what remains of the heading is rot2
    assert_normal(wrapped(heading - np.arctan2(y, x) - rot2), 0.0, second)


@pytest.mark.parametrize("case", CASES)
def test_the_omni_model_has_the_sources_means_and_variances(case):
    increment, _ = CASES[case]
    forward, left, turn = increment
    a1, a2, a3, a4, a5 = *ALPHAS.values(), 0.005
    x, y, heading = draws(OmniMotion(**ALPHAS, alpha5=a5), increment, heading=0.3)
    trans = math.hypot(forward, left)
    bearing = 0.3 + turn + (math.atan2(left, forward) if trans else 0.0)
    along = x * math.cos(bearing) + y * math.sin(bearing)
    across = y * math.cos(bearing) - x * math.sin(bearing)
    assert_normal(along, trans, a3 * trans**2 + a4 * turn**2)
    assert_normal(across, 0.0, a5 * trans**2 + a4 * turn**2)
    assert_normal(wrapped(heading - 0.3 - turn), 0.0, a1 * turn**2 + a2 * trans**2)


@pytest.mark.parametrize("model", [DifferentialMotion, OmniMotion])
@pytest.mark.parametrize("case", CASES)
def test_without_noise_a_pose_goes_where_the_odometry_does(model, case):
    increment, _ = CASES[case]
    forward, left, turn = increment
    noiseless = {f"alpha{k}": 0.0 for k in range(1, 5 if model is DifferentialMotion else 6)}
    states = np.array([[1.0], [2.0], [3.0]], np.float32)
    after = model(**noiseless).sample(states, np.array(increment), np.random.default_rng(0))
    x = 1 + forward * math.cos(3 + turn) - left * math.sin(3 + turn)
    y = 2 + forward * math.sin(3 + turn) + left * math.cos(3 + turn)
    # below 1 cm it counts as straight ahead in the differential model: off by a chord, at most 2 ρ
    tolerance = 0.018 if case == "nearly in place" and model is DifferentialMotion else 1e-6
    np.testing.assert_allclose(after[:2, 0], [x, y], atol=tolerance)
    assert wrapped(float(after[2, 0]) - 3 - turn) == pytest.approx(0, abs=1e-6)
    np.testing.assert_allclose(moved(states, np.array(increment))[:2, 0], [x, y], atol=1e-6)


@pytest.mark.parametrize("alpha2", [0.002, 0.02])
@pytest.mark.parametrize("distance", [0.3, -1.0])
def test_two_noises_stand_for_three_along_a_straight_drive_and_double_across(distance, alpha2):
    alphas = ALPHAS | {"alpha2": alpha2, "alpha4": 0.0}
    model, increment = DifferentialMotion(**alphas), (distance, 0.0, 0.0)
    # turns before and after are independent, and both of variance α2 ρ²
    turned = alpha2 * distance**2
    for one, across in ((model, turned), (model.turn_and_drive, 2 * turned)):
        x, y, heading = draws(one, increment)
        assert_normal(np.hypot(x, y), abs(distance), alphas["alpha3"] * distance**2)
        assert_normal(wrapped(heading), 0.0, 2 * turned)
        direction = wrapped(np.arctan2(y, x) - (math.pi if distance < 0 else 0.0))
        assert_normal(direction, 0.0, across)


def driven(model, steps, rng) -> tuple[np.ndarray, np.ndarray]:
    """Increments that an odometry tells, and those of robots that move so by the model."""
    ahead, others = rng.uniform(0.05, 0.5, steps), rng.normal(0, [[0.01], [0.3]], (2, steps))
    meant = np.column_stack([ahead, *others])
    meant[::5, :2] = 0.0  # on the spot
    done = []
    for increment in meant:
        x, y, turn = model.sample(np.zeros((3, 1), np.float32), increment, rng)[:, 0].astype(float)
        cosine, sine = math.cos(turn), math.sin(turn)
        done.append([cosine * x + sine * y, cosine * y - sine * x, turn])
    return meant, np.array(done)


@pytest.mark.parametrize("model", [DifferentialMotion, OmniMotion])
def test_odometry_that_loses_some_signs_leaves_drives_possible_and_the_turns_alone(model):
    rng = np.random.default_rng(6)
    still = dict.fromkeys(["alpha1", "alpha2", "alpha3", "alpha4"], 0.001)
    meant, done = driven(model(**still), 4000, rng)
    lost = rng.random(len(meant)) < 0.02
    done[lost, :2] = -meant[lost, :2]
    found, clean = model.fitted(meant, done), model.fitted(meant[~lost], done[~lost])
    # the error is 2 ρ: within 2.58 to 4 standard deviations of what is fitted
    assert 2 / 4.0 < math.sqrt(found.alpha3) < 2 / 2.4
    assert found.alpha1 == pytest.approx(clean.alpha1, rel=0.2)
    assert found.alpha2 == pytest.approx(clean.alpha2, rel=0.2)


@pytest.mark.parametrize("distance", [0.2, 0.06])
@pytest.mark.parametrize("model", [DifferentialMotion, OmniMotion])
def test_a_reference_with_noise_does_not_inflate_what_it_cannot_tell(model, distance):
    # at rest between steps, on the spot and to the side the reference jitters by 1 cm
    rng = np.random.default_rng(8)
    meant = np.tile([[distance, 0.0, 0.01], [0.001, 0.0, 0.3]], (1000, 1))
    done = meant + rng.normal(0, [0.01, 0.01, 0.003], meant.shape)
    found = model.fitted(meant, done)
    # of drives all alike only the sum is told; the standard deviation is right to 1 / √2,000 = 2 %,
    # its 99 % point to 5 %
    variance = found.alpha3 * distance**2 + found.alpha4 * 0.01**2
    assert math.sqrt(variance) == pytest.approx(0.01, rel=0.15)
    # headings jitter by 0.003 rad, the direction of a drive by 0.01 / distance
    turns = 2 if model is DifferentialMotion else 1
    assert math.sqrt(turns * found.alpha2) * distance == pytest.approx(0.003, rel=0.15)


@pytest.mark.parametrize("model", [DifferentialMotion, OmniMotion, OdometryMotion])
def test_too_few_steps_are_refused(model):
    steps = np.full((20, 3), 0.1)
    steps[9:] = np.nan
    with pytest.raises(InputError, match="9 steps have movement"):
        model.fitted(steps, steps)
