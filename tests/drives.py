"""Logs that the tests record themselves."""

import functools
import warnings

import gymnasium as gym
import numpy as np

import deqmcl_gym  # noqa: F401  # registers the envs
from deqmcl_gym import logs
from deqmcl_gym.envs.wrappers import RecordLog

NAN = float("nan")
ENDINGS = (".log", ".log.gz", ".csv", ".csv.gz", ".npz", ".bag", ".mcap", "")
SQUARE = {"outer": [[0, 0], [7, 0], [7, 6], [0, 6]], "unit": "m"}


@functools.cache
def episode(steps: int = 40, preset: str = "sharp", seed: int = 3) -> logs.Log:
    env = RecordLog(gym.make("deqmcl_gym/Room-v0", preset=preset))
    _, info = env.reset(seed=seed)
    for _ in range(steps):
        *_, info = env.step(info["planned_actions"][0])
    return env.log


def real(n: int = 30, beams: int = 5, seed: int = 0) -> logs.Log:
    """A log in m as real ones are: uneven times and way, beams without a return, gaps of truth."""
    rng = np.random.default_rng(seed)
    scanner = logs.Scanner(
        angles=tuple(np.linspace(-1.5, 1.4, beams)), max_range=8.0, min_range=0.1,
        mounting=(0.2, -0.05),
    )  # fmt: skip
    steps = rng.normal((0.1, 0.0), (0.05, 0.2), (n - 1, 2))
    odometry = logs.motion.dead_reckoned(steps, (1.0, -2.0, 3.0))
    reference = odometry + rng.normal(0, 0.02, (n, 3))
    reference[rng.random(n) < 0.3] = NAN
    reference[0] = odometry[0]
    ranges = rng.uniform(0.0, 9.0, (n, beams))
    times = np.round(np.cumsum(rng.uniform(0.1, 0.5, n)), 6)
    return logs.Log(scanner, times, odometry, ranges, reference)


def same(one: logs.Log, other: logs.Log, within: float = 0.0, angles: float = 0.0) -> None:
    """Refuse two logs that are not the same records of the same scanner."""
    assert one.unit == other.unit
    np.testing.assert_array_equal(one.ranges, other.ranges)
    for name in ("times", "odometry"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=0, atol=within)
    assert (one.reference is None) == (other.reference is None)
    if one.reference is not None:
        np.testing.assert_allclose(one.reference, other.reference, rtol=0, atol=1e-12 + within)
    np.testing.assert_allclose(one.scanner.bearings, other.scanner.bearings, rtol=0, atol=angles)
    assert one.scanner.mounting == other.scanner.mounting


def read_and_warned(*args, **kwargs) -> tuple[logs.Log, str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        log = logs.read(*args, **kwargs)
    return log, " ".join(str(one.message) for one in caught)
