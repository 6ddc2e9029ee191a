"""A hall of cells, and what a robot saw that drove in it."""

import math
from pathlib import Path

import gymnasium as gym
import numpy as np

import deqmcl_gym  # noqa: F401  # registers the envs
from deqmcl_gym.envs.wrappers import RecordLog
from deqmcl_gym.logs import Log, Trajectory, write
from deqmcl_gym.maps import GridMap


def recorded_in_a_hall(steps: int) -> tuple[GridMap, Log]:
    cells = np.pad(np.zeros((66, 86), np.int8), 1, constant_values=100)
    cells[28:40, 28:60] = cells[1:12, 40:44] = cells[50:, 10:14] = 100
    hall = GridMap(occupancy=cells, resolution=0.05)
    world = {
        "lap": {"waypoints": [[1.2, 1.0], [3.4, 1.0], [3.4, 2.4], [1.0, 2.4]]},
        "lidar": {"beams": 61, "field_of_view": math.pi, "max_range": 6.0, "sigma": 0.02},
        "noise": {"drive": 0.1, "turn": 0.1, "drift": 0.1},
        "driver": {},
    }
    env = RecordLog(gym.make("deqmcl_gym/Room-v0", floor_plan=hall, **world))
    _, info = env.reset(seed=0)
    for _ in range(steps):
        *_, info = env.step(info["planned_actions"][0])
    return hall, env.log


def write_lap(lap: tuple[GridMap, Log], folder: Path) -> None:
    """Write hall.yaml, lap.csv, the log without its poses, and these as lap.tum."""
    hall, log = lap
    hall.save(folder / "hall.yaml")
    Trajectory(log.times, log.reference).write(folder / "lap.tum")
    bare = Log(log.scanner, log.times, log.odometry, log.ranges, None, "m")
    write(bare, folder / "lap.csv")
