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
        # As many rows as a lap may have steps, but no more than 0.5 MB of a wide one.
        self._block = (max(1, min(256, 65_536 // width)), width)
        self._rows: Iterator[NDArray[np.float64]] = iter(())

    def next(self) -> NDArray[np.float64]:
        """Return the next row, (width,), as the caller's own."""
        for row in self._rows:
            return row
        self._rows = iter(self._sd * self._rng.standard_normal(self._block))
        return self.next()
