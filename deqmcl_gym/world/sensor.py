"""The world's lidar: exact ranges plus noise, clipped to [0, max_range]."""

import numpy as np

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.types import Floats, Indices, Singles
from deqmcl_gym.world.path import Pose
from deqmcl_gym.world.streams import NormalTable


class LidarSensor:
    """The lidar of one robot: o = clip(r + ε, 0, max_range), r exact, ε ~ N(0, σ²)."""

    def __init__(self, floor_plan: Map, lidar: Lidar, rng: np.random.Generator) -> None:
        """Mount ``lidar``; one normal number per beam and scan is drawn from ``rng``."""
        self._lidar = lidar
        self._caster, self._bearings = floor_plan.local.caster, _bearings(lidar)
        self._x, self._y = floor_plan.datum
        self._max_range, self._sigma, self._rng = lidar.max_range, lidar.sigma, rng
        self._origin = np.empty((3, 1), np.float32)
        self._exact = np.empty((lidar.beams, 1), np.float32)

    def scan(self, pose: Pose) -> Singles:
        """Return the ranges seen from a pose as a fresh array, (B,), in [0, max_range]."""
        origin, exact = self._origin, self._exact
        x, y, heading = pose
        origin[0, 0], origin[1, 0], origin[2, 0] = x - self._x, y - self._y, heading
        self._caster.cast(self._lidar.origins(origin), self._bearings, exact)
        seen = np.empty(exact.size, np.float32)
        normals = self._rng.standard_normal(exact.size)
        _report(exact, normals, self._sigma, self._max_range, seen)
        return seen


class LidarSensors:
    """The same lidar in each of many rooms.

    Attributes:
        scans: the last ones, (n, B) float32.
    """

    def __init__(self, floor_plan: Map, lidar: Lidar, rooms: int, most: int) -> None:
        """Mount ``lidar`` in n ``rooms``, for at most ``most`` scans in an episode."""
        self._lidar = lidar
        self._caster, self._bearings = floor_plan.local.caster, _bearings(lidar)
        self._datum = np.array([*floor_plan.datum, 0.0])
        self._max_range, self._sigma = lidar.max_range, lidar.sigma
        self._noise = NormalTable(rooms, lidar.beams, most)
        self.scans = np.zeros((rooms, lidar.beams), np.float32)

    def renew(self, room: int, rng: np.random.Generator) -> None:
        """Draw the noise of a room from another stream from now on."""
        self._noise.renew(room, rng)

    def scan(self, rooms: Indices, poses: Floats) -> None:
        """Take a scan in each of ``rooms`` (k,), at ``poses`` (k, 3)."""
        origins = (poses - self._datum).T.astype(np.float32, order="C")
        exact = np.empty((self._bearings.size, rooms.size), np.float32)
        self._caster.cast(self._lidar.origins(origins), self._bearings, exact)
        noise = self._noise
        noise.fill()
        _report_rooms(rooms, exact, noise.drawn, noise.at, self._sigma, self._max_range, self.scans)


def _bearings(lidar: Lidar) -> Singles:
    """Bearings in the caster's precision."""
    return lidar.bearings.astype(np.float32)


@compiled
def _report(exact: Singles, normals: Floats, sigma: float, max_range: float, out: Singles) -> None:
    """Fill in clip(exact (B, 1) + σ normals (B,), 0, max_range) in one pass: NumPy takes five."""
    for beam in range(out.size):
        seen = exact[beam, 0] + sigma * normals[beam]
        out[beam] = min(max(seen, 0.0), max_range)


@compiled
def _report_rooms(
    rooms: Indices,
    exact: Singles,
    normals: Floats,
    at: Indices,
    sigma: float,
    max_range: float,
    out: Singles,
) -> None:
    """Do the same for ``rooms`` (k,) out of n, each with its next row of the normal numbers.

    ``exact`` is (B, k).
    """
    for i in range(rooms.size):
        room = rooms[i]
        row = at[room]
        at[room] = row + 1
        for beam in range(out.shape[1]):
            seen = exact[beam, i] + sigma * normals[room, row, beam]
            out[room, beam] = min(max(seen, 0.0), max_range)
