"""The world's lidar: exact ranges, plus noise, clipped to what the instrument reports."""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.floorplan import FloorPlan, Lidar
from deqmcl_gym.seeding import NormalRows


class LidarSensor:
    """o = clip(r + N(0, σ²), 0, max_range) for each beam, r the exact distance to the wall."""

    def __init__(self, floor_plan: FloorPlan, lidar: Lidar, rng: np.random.Generator) -> None:
        """Mount ``lidar``; one normal number per beam and scan is drawn from ``rng``."""
        self._floor_plan = floor_plan
        self._bearings = lidar.bearings
        self._max_range, self._sigma = lidar.max_range, lidar.sigma
        self._noise = NormalRows(rng, lidar.beams)

    def scan(self, pose: tuple[float, float, float]) -> NDArray[np.float32]:
        """Return the ranges seen from a pose, (B,) px, in [0, max_range]."""
        exact = self._floor_plan.ranges([pose], self._bearings)[0]
        noisy = exact + self._sigma * self._noise.next()
        reported: NDArray[np.float32] = np.clip(noisy, 0.0, self._max_range).astype(np.float32)
        return reported
