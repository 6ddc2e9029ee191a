"""Random streams of an episode, one per source of randomness, all derived from the reset seed.

Stream k of episode i after ``reset(seed=s)`` is SeedSequence(s, spawn_key=(i, k)): what one source
draws never shifts what another one gets. The j-th further source of the same kind, say a second
wrapper, has the key (i, k, j).
"""

import enum
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.numerics.compiling import compiled


class Stream(enum.IntEnum):
    """Sources of randomness. The numbers are part of what a seed means: never change them."""

    MOTION = 0
    SENSOR = 1
    START = 2
    DROPOUT = 3
    KIDNAP = 4


def episode_stream(seed: int, episode: int, stream: Stream, twin: int = 0) -> np.random.Generator:
    """Return the generator of one source in the ``episode``-th episode (from 0) after seeding.

    Args:
        seed: of the last reset that had one.
        episode: its number since then.
        stream: the kind of source.
        twin: how many sources of this kind come before it.
    """
    key = (episode, int(stream), twin) if twin else (episode, int(stream))
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


class NormalRows:
    """Rows of normal numbers, drawn in blocks: many times faster than one by one."""

    def __init__(self, rng: np.random.Generator, width: int, sd: float = 1.0) -> None:
        """Draw rows (width,) of N(0, sd²) from ``rng``."""
        self._rng, self._sd = rng, sd
        # As many rows as a lap may have steps, but no more than 0.5 MB of a wide one.
        self._block = (max(1, min(256, 65_536 // width)), width)
        self._rows: Iterator[NDArray[np.float64]] = iter(())

    def next(self) -> NDArray[np.float64]:
        """Return the next row, (width,), as the caller's own."""
        for row in self._rows:
            return row
        self._rows = iter(self._sd * self._rng.standard_normal(self._block))
        return self.next()


class NormalTable:
    """One row of normal numbers for each of many rooms: what its own :class:`NormalRows` gives."""

    def __init__(self, rooms: int, width: int, sd: float = 1.0) -> None:
        """Draw rows (width,) of N(0, sd²) from each room's stream; :meth:`renew` names it."""
        self._sd = sd
        # Few calls of NumPy, and few numbers drawn in vain at the end of an episode.
        self._drawn = np.empty((rooms, max(1, min(256, 512 // width)), width))
        self._at = np.zeros(rooms, np.intp)
        self._rngs: list[np.random.Generator | None] = [None] * rooms

    def renew(self, room: int, rng: np.random.Generator) -> None:
        """Let a room draw from another stream from now on."""
        self._rngs[room] = rng
        self._at[room] = self._drawn.shape[1]

    def next(self, among: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the next row of each room ``among``, (n, width); the others' rows mean nothing."""
        rows = np.empty((among.size, self._drawn.shape[2]))
        used_up = np.empty(among.size, np.intp)
        count = _take(self._drawn, self._at, among, self._sd, rows, used_up)
        if count:
            late = np.zeros_like(among)
            late[used_up[:count]] = True
            self._draw(used_up[:count])
            _take(self._drawn, self._at, late, self._sd, rows, used_up)
        return rows

    def _draw(self, rooms: NDArray[np.intp]) -> None:
        for room in rooms.tolist():
            rng = self._rngs[room]
            assert rng is not None  # a room begins before it draws
            rng.standard_normal(out=self._drawn[room])
        self._at[rooms] = 0


@compiled
def _take(
    drawn: NDArray[np.float64],
    at: NDArray[np.intp],
    among: NDArray[np.bool_],
    sd: float,
    out: NDArray[np.float64],
    used_up: NDArray[np.intp],
) -> int:
    """Fill in sd times each room's next row, (n, width), and go on to the one after it.

    Returns:
        How many rooms have none left; ``used_up`` begins with those.
    """
    count = 0
    for room in range(among.size):
        if not among[room]:
            continue
        row = at[room]
        if row == drawn.shape[1]:
            used_up[count] = room
            count += 1
            continue
        for column in range(out.shape[1]):
            out[room, column] = sd * drawn[room, row, column]
        at[room] = row + 1
    return count
