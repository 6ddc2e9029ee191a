"""Random streams of an episode, one per source of randomness, all derived from the reset seed.

Stream k of episode i after ``reset(seed=s)`` is SeedSequence(s, spawn_key=(i, k)), so that draws
from one source do not change those from another. The j-th further source of the same kind, such as
a second wrapper, has the key (i, k, j).
"""

import enum
from typing import cast

import numpy as np

from deqmcl_gym.numerics.entropy import Seeds


class Stream(enum.IntEnum):
    """Sources of randomness. Never change the numbers: results of a seed depend on them."""

    MOTION = 0
    SENSOR = 1
    START = 2
    DROPOUT = 3
    KIDNAP = 4
    ROUTE = 5


def episode_stream(seed: int, episode: int, stream: Stream, twin: int = 0) -> np.random.Generator:
    """Return the generator of one source in the ``episode``-th episode (from 0) after seeding.

    Args:
        seed: of the last reset with a seed.
        episode: number of episodes since then.
        stream: the kind of source.
        twin: number of sources of this kind before it.
    """
    key = (episode, int(stream), twin) if twin else (episode, int(stream))
    # NumPy accepts any ISeedSequence, but its annotations do not.
    seeds = cast(np.random.SeedSequence, Seeds(seed, key))
    return np.random.Generator(np.random.PCG64(seeds))


class NormalTable:
    """Normal numbers for many rooms, each from its own stream, drawn many rows at a time.

    A kernel reads row ``at[i]`` of room i and adds one to ``at[i]``, without copies.

    Attributes:
        drawn: N(0, 1), (n, rows, width).
        at: the next row of each room, (n,).
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
