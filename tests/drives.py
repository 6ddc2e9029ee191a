"""Logs that the tests record themselves: of the paper's room, of a hall of cells, as real ones."""

import functools
import math
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np

import deqmcl_gym  # noqa: F401  # registers the envs
from deqmcl_gym import logs
from deqmcl_gym.envs.wrappers import RecordLog
from deqmcl_gym.maps import GridMap

NAN = float("nan")
ENDINGS = (".log", ".log.gz", ".csv", ".csv.gz", ".npz", ".bag", ".mcap", "")
SQUARE = {"outer": [[0, 0], [7, 0], [7, 6], [0, 6]], "unit": "m"}


def recorded(steps: int, seed: int, **world) -> logs.Log:
    """The log of a room in which what is planned is carried out."""
    env = RecordLog(gym.make("deqmcl_gym/Room-v0", **world))
    _, info = env.reset(seed=seed)
    for _ in range(steps):
        *_, info = env.step(info["planned_actions"][0])
    return env.log


@functools.cache
def episode(steps: int = 40, preset: str = "sharp", seed: int = 3) -> logs.Log:
    return recorded(steps, seed, preset=preset)


def recorded_in_a_hall(steps: int) -> tuple[GridMap, logs.Log]:
    cells = np.pad(np.zeros((66, 86), np.int8), 1, constant_values=100)
    cells[28:40, 28:60] = cells[1:12, 40:44] = cells[50:, 10:14] = 100
    hall = GridMap(occupancy=cells, resolution=0.05)
    world = {
        "lap": {"waypoints": [[1.2, 1.0], [3.4, 1.0], [3.4, 2.4], [1.0, 2.4]]},
        "lidar": {"beams": 61, "field_of_view": math.pi, "max_range": 6.0, "sigma": 0.02},
        "noise": {"drive": 0.1, "turn": 0.1, "drift": 0.1},
        "driver": {},
    }
    return hall, recorded(steps, 0, floor_plan=hall, **world)


def write_lap(lap: tuple[GridMap, logs.Log], folder: Path) -> None:
    hall, log = lap
    hall.save(folder / "hall.yaml")
    logs.Trajectory(log.times, log.reference).write(folder / "lap.tum")
    bare = logs.Log(log.scanner, log.times, log.odometry, log.ranges, None, "m")
    logs.write(bare, folder / "lap.csv")


def real(n: int = 30, beams: int = 5, seed: int = 0) -> logs.Log:
    """A log in m as real ones are: uneven times and way, beams without a return, gaps of truth."""
    rng = np.random.default_rng(seed)
    angles = tuple(np.linspace(-1.5, 1.4, beams))
    scanner = logs.Scanner(angles=angles, max_range=8.0, min_range=0.1, mounting=(0.2, -0.05))
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
