"""The world's lidar: exact ranges, plus noise, clipped to what the instrument reports."""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.floorplan import FloorPlan, Lidar
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.seeding import NormalRows


class Scanner:
    """o = clip(r + ε, 0, max_range) for each beam, r the exact distance to the wall."""

    def __init__(self, floor_plan: FloorPlan, lidar: Lidar) -> None:
        """Mount ``lidar`` on robots in a room."""
        self._floor_plan = floor_plan
        self._bearings = lidar.bearings.astype(np.float32)  # as the caster takes them
        self._max_range = lidar.max_range

    def scans(self, poses: NDArray[np.floating], noise: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the ranges seen from poses (n, 3) with ``noise`` ε (n, B): fresh, (n, B) px."""
        exact = self._floor_plan.ranges(poses, self._bearings)
        seen = np.empty(exact.shape, np.float32)
        _report(exact, noise, self._max_range, seen)
        return seen


class LidarSensor:
    """The lidar of one robot, ε ~ N(0, σ²)."""

    def __init__(self, floor_plan: FloorPlan, lidar: Lidar, rng: np.random.Generator) -> None:
        """Mount ``lidar``; one normal number per beam and scan is drawn from ``rng``."""
        self._scanner = Scanner(floor_plan, lidar)
        self._noise = NormalRows(rng, lidar.beams, lidar.sigma)
        self._pose = np.empty((1, 3), np.float32)

    def scan(self, pose: tuple[float, float, float]) -> NDArray[np.float32]:
        """Return the ranges seen from a pose as a fresh array, (B,) px, in [0, max_range]."""
        self._pose[0] = pose
        seen: NDArray[np.float32] = self._scanner.scans(self._pose, self._noise.next()[None])[0]
        return seen


@compiled
def _report(
    exact: NDArray[np.float32],
    noise: NDArray[np.float64],
    max_range: float,
    out: NDArray[np.float32],
) -> None:
    """Fill in clip(exact + noise, 0, max_range), (n, B): one pass for what takes NumPy five."""
    for room in range(out.shape[0]):
        for beam in range(out.shape[1]):
            seen = exact[room, beam] + noise[room, beam]
            out[room, beam] = min(max(seen, 0.0), max_range)
