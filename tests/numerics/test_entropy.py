"""Seeds says what np.random.SeedSequence says: a seed keeps its meaning."""

import numpy as np
import pytest

from deqmcl_gym.numerics.entropy import Seeds

# one word, its edges, the pool's four words, and more than the pool holds
SEEDS = (0, 1, 2**32 - 1, 2**32, 2**64 + 3, 2**128 - 1, 2**128, 2**300 + 1)
KEYS = ((0,), (0, 0), (7, 1), (2**32 - 1, 4), (3, 4, 1))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("key", KEYS)
def test_generators_are_those_of_numpys_seed_sequence(seed, key):
    ours = np.random.PCG64(Seeds(seed, key))
    theirs = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key))
    assert ours.state == theirs.state


@pytest.mark.parametrize("words", [0, 1, 2, 3, 9])
@pytest.mark.parametrize("dtype", [np.uint32, np.uint64, "uint64"])
def test_any_number_of_words_agrees(words, dtype):
    ours = Seeds(5, (1, 2)).generate_state(words, dtype)
    theirs = np.random.SeedSequence(5, spawn_key=(1, 2)).generate_state(words, dtype)
    np.testing.assert_array_equal(ours, theirs)
    assert ours.dtype == theirs.dtype


def test_a_generator_spawns_the_children_that_numpys_would():
    ours = np.random.Generator(np.random.PCG64(Seeds(5, (1, 2))))
    theirs = np.random.default_rng(np.random.SeedSequence(5, spawn_key=(1, 2)))
    for _ in range(2):
        for one, other in zip(ours.spawn(2), theirs.spawn(2), strict=True):
            assert one.bit_generator.state == other.bit_generator.state
