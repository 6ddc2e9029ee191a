"""The world's lidar: exact ranges, plus noise, clipped to what the instrument reports."""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.floorplan import FloorPlan, Lidar
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.seeding import NormalRows


class LidarSensor:
    """o = clip(r + N(0, σ²), 0, max_range) for each beam, r the exact distance to the wall."""

    def __init__(self, floor_plan: FloorPlan, lidar: Lidar, rng: np.random.Generator) -> None:
        """Mount ``lidar``; one normal number per beam and scan is drawn from ``rng``."""
        self._floor_plan = floor_plan
        self._bearings = lidar.bearings.astype(np.float32)  # as the caster takes them
        self._max_range = lidar.max_range
        self._noise = NormalRows(rng, lidar.beams, lidar.sigma)
        self._pose = np.empty((1, 3), np.float32)

    def scan(self, pose: tuple[float, float, float]) -> NDArray[np.float32]:
        """Return the ranges seen from a pose as a fresh array, (B,) px, in [0, max_range]."""
        self._pose[0] = pose
        exact = self._floor_plan.ranges(self._pose, self._bearings)[0]
        seen = np.empty(len(exact), np.float32)
        _report(exact, self._noise.next(), self._max_range, seen)
        return seen


@compiled
def _report(
    exact: NDArray[np.float32],
    noise: NDArray[np.float64],
    max_range: float,
    out: NDArray[np.float32],
) -> None:
    """Fill in clip(exact + noise, 0, max_range), (B,): one pass for what takes NumPy five."""
    for beam in range(exact.size):
        out[beam] = min(max(exact[beam] + noise[beam], 0.0), max_range)
