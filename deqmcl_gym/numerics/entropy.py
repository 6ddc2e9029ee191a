"""``np.random.SeedSequence`` as a kernel, for vector envs that need new streams at each reset.

O'Neill's seed_seq (2015) with a pool of four words; NumPy guarantees its stability.
"""

from functools import cached_property
from typing import Any

import numpy as np
from numpy.random.bit_generator import ISpawnableSeedSequence
from numpy.typing import NDArray

from deqmcl_gym.numerics.compiling import compiled

Word = Any  # 32 bits, as uint64

_POOL = 4
_BITS = 32
_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(16)
_FULL = np.uint64(32)
_START_IN, _TIMES_IN = np.uint64(0x43B0D7E5), np.uint64(0x931E8875)
_START_OUT, _TIMES_OUT = np.uint64(0x8B51F9DD), np.uint64(0x58F38DED)
_LEFT, _RIGHT = np.uint64(0xCA01F9DD), np.uint64(0x4973F715)


class Seeds(ISpawnableSeedSequence):
    """SeedSequence(seed, spawn_key=key)."""

    def __init__(self, seed: int, key: tuple[int, ...]) -> None:
        """Take a seed ≥ 0 and a spawn key of one or more numbers below 2³²."""
        if seed < 0:
            raise ValueError(f"the seed is {seed}, but must be 0 or more")
        self._seed, self._key = seed, key

    def generate_state(self, n_words: int, dtype: Any = np.uint32) -> NDArray[Any]:
        """Return the first words of the sequence; fast for 64 bits, which PCG64 asks for."""
        if dtype is not np.uint64:
            return self._numpy.generate_state(n_words, dtype)
        words: list[int] = []  # of 32 bits, the lowest first
        rest = self._seed
        while rest or len(words) < _POOL:
            words.append(rest & 0xFFFFFFFF)
            rest >>= _BITS
        state = np.empty(n_words, np.uint64)
        _fill(np.array([*words, *self._key], np.uint64), state)
        return state

    def spawn(self, n_children: int) -> list[Any]:
        """Return child sequences, the same as NumPy's."""
        return self._numpy.spawn(n_children)

    @cached_property
    def _numpy(self) -> np.random.SeedSequence:
        return np.random.SeedSequence(self._seed, spawn_key=self._key)


@compiled
def _fill(words: NDArray[np.uint64], out: NDArray[np.uint64]) -> None:
    """Mix words (4 or more) into a pool; fill in the words it generates."""
    pool = np.empty(_POOL, np.uint64)
    constant = _START_IN
    for i in range(_POOL):
        pool[i], constant = _hashed(words[i], constant, _TIMES_IN)
    for source in range(words.size):
        for i in range(_POOL):
            if source != i:
                word = pool[source] if source < _POOL else words[source]
                hashed, constant = _hashed(word, constant, _TIMES_IN)
                pool[i] = _mixed(pool[i], hashed)
    constant = _START_OUT
    for i in range(out.size):
        low, constant = _hashed(pool[2 * i % _POOL], constant, _TIMES_OUT)
        high, constant = _hashed(pool[(2 * i + 1) % _POOL], constant, _TIMES_OUT)
        out[i] = low | (high << _FULL)


@compiled
def _hashed(word: Word, constant: Word, times: Word) -> tuple[Word, Word]:
    """Return the word, hashed, and the constant for the next one."""
    following = (constant * times) & _LOW
    word = ((word ^ constant) * following) & _LOW
    return word ^ (word >> _HALF), following


@compiled
def _mixed(x: Word, y: Word) -> Word:
    word = (_LEFT * x - _RIGHT * y) & _LOW
    return word ^ (word >> _HALF)
