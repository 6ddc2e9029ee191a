"""The best cluster, against its rule written out."""

import math
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from localizers import best_cluster, mean_pose


def by_the_rule(poses: np.ndarray, weights: np.ndarray, metre: float):
    """Which points count, (n,): those of the heaviest cell and its neighbours."""
    cells = [
        (
            math.floor(x / metre),
            math.floor(y / metre),
            math.floor(math.remainder(heading, 2 * math.pi) / (math.pi / 6)) % 12,
        )
        for x, y, heading in poses.tolist()
    ]
    total: dict[tuple[int, int, int], float] = defaultdict(float)
    for cell, weight in zip(cells, weights.tolist(), strict=True):
        total[cell] += weight
    # of equal ones the first; sectors are counted from -π
    best = min(total, key=lambda cell: (-total[cell], cell[:2], (cell[2] + 6) % 12))
    return np.array(
        [
            abs(c[0] - best[0]) <= 1 and abs(c[1] - best[1]) <= 1 and (c[2] - best[2] + 1) % 12 <= 2
            for c in cells
        ]
    )


@settings(max_examples=150, deadline=None)
@given(
    n=st.integers(1, 60),
    # the last two: more cells than a table is for, and more than a float64 counts
    spread=st.sampled_from([0.3, 2.0, 20.0, 1e6, 1e11]),
    equal=st.booleans(),
    unit=st.sampled_from(["m", "px"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_it_is_the_heaviest_cell_and_its_neighbours(n, spread, equal, unit, seed):
    rng, metre = np.random.default_rng(seed), {"m": 1.0, "px": 50.0}[unit]
    poses = rng.normal(0, 1, (n, 3)) * (spread * metre, spread * metre, 2.5)
    poses = poses[rng.integers(n, size=n)].astype(np.float32)  # some cells have several
    weights = np.full(n, 1 / n) if equal else rng.dirichlet(np.full(n, 0.3))
    near = by_the_rule(poses, weights, metre)
    found = best_cluster(poses, weights, unit=unit)
    assert found.share == pytest.approx(weights[near].sum())
    assert found.mean == pytest.approx(mean_pose(poses[near], weights[near] / found.share))
