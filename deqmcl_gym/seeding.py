"""Random streams of an episode, one per source of randomness, all derived from the reset seed.

Stream k of episode i after ``reset(seed=s)`` is SeedSequence(s, spawn_key=(i, k)): what one source
draws never shifts what another one gets. The j-th further source of the same kind, say a second
wrapper, has the key (i, k, j).
"""

import enum
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray


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
        self._block = (_rows_at_once(256, width), width)  # 256: a lap's steps
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
        self._drawn = np.empty((rooms, _rows_at_once(64, width), width))
        self._at = np.zeros(rooms, np.intp)
        self._all = np.arange(rooms)
        self._rngs: list[np.random.Generator | None] = [None] * rooms

    def renew(self, room: int, rng: np.random.Generator) -> None:
        """Let a room draw from another stream from now on."""
        self._rngs[room] = rng
        self._at[room] = self._drawn.shape[1]

    def next(self, among: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the next row of each room ``among``, (n, width); the others' rows mean nothing."""
        for room in np.flatnonzero(among & (self._at == self._drawn.shape[1])).tolist():
            self._fill(room)
        last = self._drawn.shape[1] - 1
        rows: NDArray[np.float64] = self._drawn[self._all, np.minimum(self._at, last)]
        self._at += among
        return rows

    def _fill(self, room: int) -> None:
        rng, block = self._rngs[room], self._drawn[room]
        assert rng is not None  # a room begins before it draws
        rng.standard_normal(out=block)
        block *= self._sd
        self._at[room] = 0


def _rows_at_once(most: int, width: int) -> int:
    """Return how many rows to draw: ``most``, but no more than 0.5 MB of wide ones."""
    return max(1, min(most, 65_536 // width))
