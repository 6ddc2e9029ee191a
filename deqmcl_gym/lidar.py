"""The world's lidar: exact ranges, plus noise, clipped to what the instrument reports."""

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.floorplan import FloorPlan, Lidar
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.path import Pose
from deqmcl_gym.seeding import NormalRows, NormalTable

Floats = NDArray[np.float64]
Scan = NDArray[np.float32]


class Scanner:
    """o = clip(r + ε, 0, max_range) for each beam, r the exact distance to the wall."""

    def __init__(self, floor_plan: FloorPlan, lidar: Lidar) -> None:
        """Mount ``lidar`` on robots in a room."""
        self._caster = floor_plan.caster
        self._bearings = lidar.bearings.astype(np.float32)  # as the caster takes them
        self._max_range, self._sigma = lidar.max_range, lidar.sigma

    def scan(self, pose: Pose, noise: Floats) -> Scan:
        """Return the ranges seen from a pose with ``noise`` ε (B,): fresh, (B,) px."""
        exact = self._exact(np.array([pose]))
        seen = np.empty(noise.size, np.float32)
        _report(exact, noise, self._max_range, seen)
        return seen

    def scan_rooms(
        self, rooms: NDArray[np.intp], poses: Floats, noise: NormalTable, scans: Scan
    ) -> None:
        """Take a scan in each of some ``rooms``.

        Args:
            rooms: their numbers, (k,).
            poses: in these, (k, 3).
            noise: ε / σ of all rooms; each of ``rooms`` takes its next row.
            scans: of all rooms, (n, B) px; those of ``rooms`` are overwritten.
        """
        exact = self._exact(poses)
        noise.fill()
        _report_rooms(rooms, exact, noise.drawn, noise.at, self._sigma, self._max_range, scans)

    def _exact(self, poses: Floats) -> NDArray[np.float32]:
        """Return r, beam by beam, (B, n) px: ``FloorPlan.ranges`` without its questions."""
        origins = poses.T.astype(np.float32, order="C")
        exact = np.empty((self._bearings.size, len(poses)), np.float32)
        self._caster.cast(origins, self._bearings, exact)
        return exact


class LidarSensor:
    """The lidar of one robot, ε ~ N(0, σ²)."""

    def __init__(self, floor_plan: FloorPlan, lidar: Lidar, rng: np.random.Generator) -> None:
        """Mount ``lidar``; one normal number per beam and scan is drawn from ``rng``."""
        self._scanner = Scanner(floor_plan, lidar)
        self._noise = NormalRows(rng, lidar.beams, lidar.sigma)

    def scan(self, pose: Pose) -> Scan:
        """Return the ranges seen from a pose as a fresh array, (B,) px, in [0, max_range]."""
        return self._scanner.scan(pose, self._noise.next())


@compiled
def _report(exact: Scan, noise: Floats, max_range: float, out: Scan) -> None:
    """Fill in clip(exact + noise, 0, max_range), (B,): one pass for what takes NumPy five.

    ``exact`` is (B, 1) px.
    """
    for beam in range(out.size):
        seen = exact[beam, 0] + noise[beam]
        out[beam] = min(max(seen, 0.0), max_range)


@compiled
def _report_rooms(
    rooms: NDArray[np.intp],
    exact: Scan,
    normals: Floats,
    at: NDArray[np.intp],
    sigma: float,
    max_range: float,
    out: Scan,
) -> None:
    """Do the same for ``rooms`` (k,) out of n, each with its next row of the normal numbers."""
    for i in range(rooms.size):
        room = rooms[i]
        row = at[room]
        at[room] = row + 1
        for beam in range(out.shape[1]):
            seen = exact[beam, i] + sigma * normals[room, row, beam]
            out[room, beam] = min(max(seen, 0.0), max_range)
