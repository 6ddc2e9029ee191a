"""The world's lidar, and the random streams of an episode.

Stream k of episode i after ``reset(seed=s)`` is SeedSequence(s, spawn_key=(i, k)), so that draws
from one source do not change those from another. The j-th further source of the same kind, such as
a second wrapper, has the key (i, k, j).
"""

import enum

import numpy as np

from deqmcl_gym.maps import Lidar
from deqmcl_gym.maps.map import Caster
from deqmcl_gym.numerics import Floats, Pose, Singles
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.world.differences import Glass


class Stream(enum.IntEnum):
    """Sources of randomness. Never change the numbers: results of a seed depend on them."""

    MOTION = 0
    SENSOR = 1
    START = 2
    DROPOUT = 3
    KIDNAP = 4
    ROUTE = 5
    CLUTTER = 6
    CHANGED_WALLS = 7
    PEOPLE = 8
    GLASS = 9  # which walls are glass
    THROUGH_GLASS = 10  # which beams it does not reflect
    BUILDING = 11  # which office it is, where each episode has another


def episode_stream(seed: int, episode: int, stream: Stream, twin: int = 0) -> np.random.Generator:
    """Return the generator of one source in the ``episode``-th episode (from 0) after seeding.

    ``twin`` is the number of sources of this kind before it.
    """
    key = (episode, int(stream), twin) if twin else (episode, int(stream))
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


class NormalTable:
    """Normal numbers for many rooms, each from its own stream, drawn many rows at a time.

    A kernel reads row ``at[i]`` of room i of ``drawn``, (n, rows, width), and adds one to
    ``at[i]``, without copies.
    """

    def __init__(self, rooms: int, width: int, lap: int) -> None:
        """Prepare rows (width,) for each room, of which an episode uses about ``lap``.

        :meth:`renew` sets a room's stream.
        """
        self.drawn = np.empty((rooms, self.rows(width, lap), width))
        self.at = np.zeros(rooms, np.intp)
        self._sure = 0  # calls of fill() for which every room has rows left
        self._rngs: list[np.random.Generator | None] = [None] * rooms

    @staticmethod
    def rows(width: int, lap: int) -> int:
        """Number of rows drawn at a time: about 32 KB for each room, at least one row."""
        blocks = -(-lap * width // 4096)  # calls of NumPy for a lap
        return -(-lap // blocks)

    def renew(self, room: int, rng: np.random.Generator) -> None:
        """Draw the numbers of a room from another stream from now on."""
        self._rngs[room] = rng
        self.at[room] = self.drawn.shape[1]
        self._sure = 0

    def fill(self) -> None:
        """Draw new rows for rooms without any left; a room uses one row between two calls."""
        if self._sure == 0:
            rows = self.drawn.shape[1]
            for room in (self.at == rows).nonzero()[0].tolist():
                rng = self._rngs[room]
                assert rng is not None  # a room begins before it draws
                rng.standard_normal(out=self.drawn[room])
                self.at[room] = 0
            self._sure = rows - int(self.at.max())
        self._sure -= 1


def cast_through_glass(
    walls: Caster,
    others: Caster,
    glass: Glass,
    closest: float,
    rng: np.random.Generator,
    poses: Singles,
    bearings: Singles,
    out: Singles,
) -> None:
    """Cast among walls, some of them glass, which does not reflect all beams.

    ``others`` are those that are not glass; two walls count as one at a distance of ``closest``.
    One number per beam says whether it is lost.
    """
    beyond = np.empty_like(out)
    walls(poses, bearings, out)
    others(poses, bearings, beyond)
    lost = (beyond > out + closest) & (rng.random(out.shape) < glass.lost)
    np.copyto(out, beyond, where=lost)


class LidarSensor:
    """The lidar of one robot: o = clip(r + ε, 0, max_range), r exact, ε ~ N(0, σ²).

    Readings that the lidar loses (``Lidar.lose``) are +inf.
    """

    def __init__(self, caster: Caster, lidar: Lidar, rng: np.random.Generator) -> None:
        """Mount ``lidar``; one normal number per beam and scan is drawn from ``rng``."""
        self._lidar, self._caster = lidar, caster
        self._max_range, self._sigma, self._rng = lidar.max_range, lidar.sigma, rng
        self._origin = np.empty((3, 1), np.float32)
        self._exact = np.empty((lidar.beams, 1), np.float32)

    def scan(self, pose: Pose) -> Singles:
        """Return the ranges seen from a pose as a fresh array, (B,), in [0, max_range] or +inf."""
        origin, exact = self._origin, self._exact
        origin[0, 0], origin[1, 0], origin[2, 0] = pose
        self._lidar.cast(self._caster, origin, exact)
        seen = np.empty(exact.size, np.float32)
        normals = self._rng.standard_normal(exact.size)
        _report(exact, normals, self._sigma, self._max_range, seen)
        if self._lidar.loses:
            self._lidar.lose(seen)
        return seen


@compiled
def _report(exact: Singles, normals: Floats, sigma: float, max_range: float, out: Singles) -> None:
    """Fill in clip(exact (B, 1) + σ normals (B,), 0, max_range) in one pass: NumPy takes five."""
    for beam in range(out.size):
        seen = exact[beam, 0] + sigma * normals[beam]
        out[beam] = min(max(seen, 0.0), max_range)
