"""The noise of a log's motion: that which made it, whether its reference is dense or sparse."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.setup.logs import motion_noise, typical_steps
from deqmcl_gym.logs import Log, Scanner, Trajectory
from deqmcl_gym.logs.motion import dead_reckoned, increments_of
from deqmcl_gym.logs.trajectory import referenced
from deqmcl_gym.validation import InputError
from localizers import OdometryMotion
from localizers.models.nav2_motion import (
    MOTION_MODELS,
    DifferentialMotion,
    OmniMotion,
    kind_of,
    unknown_motion,
)

STEPS = 4000
# as of good odometry
QUIET = [
    DifferentialMotion(alpha1=0.02, alpha2=0.01, alpha3=0.01, alpha4=0.002),
    OmniMotion(alpha1=0.02, alpha2=0.01, alpha3=0.01, alpha4=0.002, alpha5=0.01),
]


def told(steps: int = STEPS, seed: int = 0) -> np.ndarray:
    """Increments of 0.1 to 0.4 m, some 0.2 rad each."""
    rng = np.random.default_rng(seed)
    return np.column_stack(
        [rng.uniform(0.1, 0.4, steps), np.zeros(steps), rng.normal(0, 0.2, steps)]
    )


@functools.cache
def done_by(model) -> np.ndarray:
    """What a robot of a model does when its odometry tells ``told()``."""
    rng, begin = np.random.default_rng(1), np.zeros((3, 1), np.float32)
    ends = np.array([model.sample(begin, one, rng)[:, 0] for one in told()], dtype=float)
    return np.array([increments_of(np.vstack([np.zeros(3), end]))[0] for end in ends])


def log_of(meant: np.ndarray, done: np.ndarray, every: int = 1, unit: str = "m") -> Log:
    """A log whose reference has the pose of every so many-th record."""
    times = np.arange(len(meant) + 1.0)
    scanner = Scanner(angles=(0.0,), max_range=5.0)
    ranges = np.ones((times.size, 1))
    log = Log(scanner, times, dead_reckoned(meant), ranges, unit=unit)
    truth = Trajectory(times[::every], dead_reckoned(done)[::every])
    return referenced(log, truth, max_gap=math.inf)


def halved(model):
    """The least noise that is estimated from a log, if the model is that of an unknown robot."""
    noise = {name: value / 2 for name, value in vars(model).items() if name != "still"}
    return replace(model, **noise)


NOISY = [  # above what is assumed anyway
    OdometryMotion(drive=0.3, turn=0.4, drift=0.25),
    OmniMotion(alpha1=0.5, alpha2=0.4, alpha3=0.3, alpha4=0.3, alpha5=0.4),
]


@pytest.mark.parametrize("model", NOISY, ids=kind_of)
def test_noise_above_what_is_assumed_is_found_again_by_a_model_of_its_kind(model):
    # Half of the 4,000 steps tell the noise of drives: √(2 / 2,000) = 3 %, the 99 % point 6 % of a
    # variance. Noise from turning and from driving trades off, by some times that: 25 %; α4 is
    # a fifth of its variance at most: 60 %.
    found = motion_noise(log_of(told(), done_by(model)), kind_of(model))
    for name, value in vars(model).items():
        assert getattr(found, name) == pytest.approx(value, rel=0.6 if name == "alpha4" else 0.25)


@pytest.mark.parametrize("unit", ["m", "px"])
@pytest.mark.parametrize("kind", MOTION_MODELS)
def test_noise_is_never_less_than_half_of_what_is_assumed_of_an_unknown_robot(kind, unit):
    meant = told(200)
    perfect = log_of(meant * ([50, 50, 1] if unit == "px" else 1), meant, unit=unit)
    perfect = log_of(perfect.increments, perfect.increments, unit=unit)
    assert motion_noise(perfect, kind) == halved(unknown_motion(kind, unit))


@pytest.mark.parametrize("every", [2, 10])
@pytest.mark.parametrize("model", QUIET, ids=kind_of)
def test_a_sparse_reference_tells_the_noise_of_a_step_as_a_dense_one_does(model, every):
    meant = told()
    logs = (log_of(meant, done_by(model), each) for each in (1, every))
    dense, sparse = (type(model).fitted(*typical_steps(log)) for log in logs)
    # a variance of k errors is right to √(2 / k), the 99 % point that drives are raised to to
    # 0.0995 / (0.029 √k), 1.33 / √k of its 2.58, and twice that of the variance
    stretches = STEPS // every
    of_turns, of_drives = 5 * math.sqrt(2 / stretches), 5 * 2 * 1.33 / math.sqrt(stretches / 2)
    ways, turns = np.mean(meant[:, 0] ** 2), np.mean(meant[:, 2] ** 2)

    def variances(found) -> tuple[float, float]:  # of an average step's way and turn
        return found.alpha3 * ways + found.alpha4 * turns, found.alpha1 * turns + 2 * (
            found.alpha2 * ways
        ) / (1 if isinstance(found, DifferentialMotion) else 2)

    (drive, turn), (own_drive, own_turn) = variances(sparse), variances(dense)
    assert abs(math.log(turn / own_turn)) < math.log1p(of_turns), (turn, own_turn)
    assert abs(math.log(drive / own_drive)) < math.log1p(of_drives), (drive, own_drive)


@pytest.mark.parametrize("every", [1, 4, 20])
def test_a_wheel_that_is_too_small_is_an_error_of_each_step_however_sparse_the_reference(every):
    # 5 % of each way and turn. Were it noise, it would grow as √n in a stretch: 0.22 for 20.
    meant = np.tile([0.25, 0.0, 0.02], (STEPS, 1))
    steps, true = typical_steps(log_of(meant, meant * 1.05, every))
    # a stretch is a chord of an arc of θ ≤ 0.4 rad, shorter by θ² / 24, of which the difference
    # (1.05³ - 1) θ² / 24 = 0.001
    assert (true - steps)[:, 0] / steps[:, 0] == pytest.approx(0.05, abs=0.002)
    assert (true - steps)[:, 2] / steps[:, 2] == pytest.approx(0.05, abs=0.002)


def test_what_cannot_be_estimated_from_is_refused_with_what_to_give_instead():
    meant = told(20)
    log = log_of(meant, meant)
    with pytest.raises(InputError, match="no reference: give the noise of the motion instead"):
        motion_noise(Log(log.scanner, log.times, log.odometry, log.ranges))
    with pytest.raises(InputError, match=r"has 9 stretches .* needs 10: give it by --motion"):
        motion_noise(log.segment(0, 10))
    with pytest.raises(InputError, match="has 4 stretches"):
        motion_noise(log_of(meant, meant, every=5))
