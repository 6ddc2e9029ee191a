"""The world's lidar: exact ranges, plus noise, clipped to what the instrument reports."""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.floorplan import FloorPlan, Lidar
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.seeding import NormalRows, NormalTable


class Scanner:
    """o = clip(r + ε, 0, max_range) for each beam, r the exact distance to the wall."""

    def __init__(self, floor_plan: FloorPlan, lidar: Lidar) -> None:
        """Mount ``lidar`` on robots in a room."""
        self._floor_plan = floor_plan
        self._bearings = lidar.bearings.astype(np.float32)  # as the caster takes them
        self._max_range, self._sigma = lidar.max_range, lidar.sigma

    def scans(self, poses: NDArray[np.floating], noise: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the ranges seen from poses (n, 3) with ``noise`` ε (n, B): fresh, (n, B) px."""
        exact = self._floor_plan.ranges(poses, self._bearings)
        seen = np.empty(exact.shape, np.float32)
        _report(exact, noise, self._max_range, seen)
        return seen

    def scan_rooms(
        self,
        rooms: NDArray[np.intp],
        poses: NDArray[np.floating],
        noise: NormalTable,
        scans: NDArray[np.float32],
    ) -> None:
        """Take a scan in each of some ``rooms``.

        Args:
            rooms: their numbers, (k,).
            poses: in these, (k, 3).
            noise: ε / σ of all rooms; each of ``rooms`` takes its next row.
            scans: of all rooms, (n, B) px; those of ``rooms`` are overwritten.
        """
        exact = self._floor_plan.ranges(poses, self._bearings)
        noise.fill()
        _report_rooms(rooms, exact, noise.drawn, noise.at, self._sigma, self._max_range, scans)


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


@compiled
def _report_rooms(
    rooms: NDArray[np.intp],
    exact: NDArray[np.float32],
    normals: NDArray[np.float64],
    at: NDArray[np.intp],
    sigma: float,
    max_range: float,
    out: NDArray[np.float32],
) -> None:
    """Do the same for ``rooms`` (k,) out of n, each with its next row of the normal numbers."""
    for i in range(rooms.size):
        room = rooms[i]
        row = at[room]
        at[room] = row + 1
        for beam in range(out.shape[1]):
            seen = exact[i, beam] + sigma * normals[room, row, beam]
            out[room, beam] = min(max(seen, 0.0), max_range)
