"""Random streams of an episode, one per source of randomness, all derived from the reset seed.

Stream k of episode i after ``reset(seed=s)`` is SeedSequence(s, spawn_key=(i, k)): what one source
draws never shifts what another one gets.
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


def episode_stream(seed: int, episode: int, stream: Stream) -> np.random.Generator:
    """Return the generator of one source in the ``episode``-th episode (from 0) after seeding."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(episode, int(stream))))


class NormalRows:
    """Rows of standard normal numbers, drawn in blocks: many times faster than one by one."""

    def __init__(self, rng: np.random.Generator, width: int) -> None:
        """Draw rows (width,) from ``rng``."""
        self._rng, self._width = rng, width
        self._rows: Iterator[NDArray[np.float64]] = iter(())

    def next(self) -> NDArray[np.float64]:
        """Return the next row, (width,)."""
        for row in self._rows:
            return row
        self._rows = iter(self._rng.standard_normal((256, self._width)))
        return self.next()
