"""Roll-outs and laid paths of a grid in one pass: what ``collides`` says step by step."""

import numpy as np
from grid_cases import grids, office, somewhere
from hypothesis import given, settings
from hypothesis import strategies as st

from deqmcl_gym.maps import Map

OFFICE = office()


def poses_around(grid, n, rng) -> np.ndarray:
    """Poses on the map and around it, one of them lost, rows (3, n) float32."""
    points = somewhere(grid, n, rng, margin=2.0)
    poses = np.float32(np.column_stack([points, rng.uniform(-4, 4, n)])).T.copy()
    poses[:, rng.integers(n)] = np.nan
    return poses


@settings(max_examples=200, deadline=None)
@given(
    grid=st.one_of(grids(), st.just(OFFICE)),
    n=st.sampled_from([1, 7, 512, 700]),
    steps=st.integers(1, 9),
    cells=st.sampled_from([0.0, 0.3, 2.0, 9.0]),
    radius=st.sampled_from([0.0, 0.2, 1.0, 3.4]),
    kept_all=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_both_count_the_steps_that_the_grid_says_collide(
    grid, n, steps, cells, radius, kept_all, seed
):
    rng, size = np.random.default_rng(seed), radius * grid.resolution
    poses = poses_around(grid, n, rng)
    far = cells * grid.resolution
    moves = rng.normal(0, 1, (steps, 3, n)) * np.array([[far], [far / 2], [1.0]])
    moves = moves.astype(np.float32)
    kept = steps if kept_all else 1
    ends, counts = grid.rolled_out(poses, moves, size, kept=kept)
    one_by_one, hits = Map.rolled_out(grid, poses, moves, size, kept=kept)
    assert np.array_equal(ends, one_by_one, equal_nan=True)
    assert np.array_equal(counts, hits)

    path = np.cumsum(moves[:, ::2, 0] * np.float32(0.7), axis=0)
    path = np.vstack([np.zeros((1, 2), np.float32), path])
    hits = Map.collisions_along(grid, poses, path, size)
    assert np.array_equal(grid.collisions_along(poses, path, size), hits)
