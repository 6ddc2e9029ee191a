"""Steps that collide, one by one and rolled out together."""

import numpy as np
import pymunk
import pytest
import reference
from grid_cases import grids, office, somewhere
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_plans import PLANS, anywhere, corners, space_of

from deqmcl_gym.maps import Map, PolygonMap

BAND = 1e-3  # px
EVERYTHING = pymunk.ShapeFilter()


def random_steps(plan: PolygonMap, n: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Starts and ends anywhere, also in solids and outside; steps of 0 to 400 px; near corners."""
    starts = anywhere(plan, n, rng, margin=30)
    near = rng.choice(corners(plan), n) + rng.normal(0, 10, (n, 2))
    starts = np.where(rng.random((n, 1)) < 0.3, near, starts)
    length = rng.choice([0.0, 0.1, 5.0, 30.0, 400.0], n) * rng.random(n)
    angle = rng.uniform(-np.pi, np.pi, n)
    ends = starts + length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return starts, ends


def pymunk_touches(space: pymunk.Space, start: tuple, end: tuple, radius: float) -> bool:
    def overlaps(point: tuple) -> bool:
        nearest = space.point_query_nearest(point, 1000.0, EVERYTHING)
        return nearest.distance <= radius

    if overlaps(start) or overlaps(end):
        return True
    return start != end and any(
        wall.segment_query(start, end, radius) is not None for wall in space.shapes
    )


@pytest.mark.parametrize("radius", [0.01, 8.0, 25.0])
@pytest.mark.parametrize("name", PLANS)
def test_a_step_collides_iff_pymunk_touches_or_it_ends_outside_free_space(name, radius):
    plan, space = PLANS[name], space_of(PLANS[name])
    starts, ends = random_steps(plan, 4_000, np.random.default_rng(1))  # 12,000 per plan
    clearance = reference.clearance(plan.walls, starts, ends)
    clear_cut = np.abs(clearance - radius) > BAND
    assert clear_cut.mean() > 0.99  # the band excuses next to nothing
    touches = np.array(
        [
            pymunk_touches(space, tuple(a), tuple(b), radius)
            for a, b in zip(starts.tolist(), ends.tolist(), strict=True)
        ]
    )
    expected = touches | (reference.winding(plan.walls, ends) != 1)
    seen = plan.collides(starts, ends, radius)
    assert 0.05 < expected.mean() < 0.999  # both answers occur
    assert np.flatnonzero((seen != expected) & clear_cut).tolist() == []


@pytest.mark.parametrize("name", PLANS)
def test_a_point_without_a_radius_collides_iff_it_crosses_a_wall_or_ends_outside_free_space(name):
    plan = PLANS[name]
    starts, ends = random_steps(plan, 10_000, np.random.default_rng(3))

    def exact(shift: tuple[float, float]) -> np.ndarray:
        crosses = reference.clearance(plan.walls, starts + shift, ends + shift) == 0
        return crosses | (reference.winding(plan.walls, ends + shift) != 1)

    # Here the band is: the answer depends on a shift of the step by BAND.
    shifts = [(sx * BAND, sy * BAND) for sx in (-1, 1) for sy in (-1, 1)]
    answers = np.array([exact(shift) for shift in shifts])
    clear_cut = (answers == answers[0]).all(axis=0)
    assert clear_cut.mean() > 0.99
    seen = plan.collides(starts, ends, 0.0)
    assert np.flatnonzero((seen != answers[0]) & clear_cut).tolist() == []


def test_neither_further_columns_nor_the_number_of_steps_change_an_answer():
    plan = PLANS["hall"]
    starts, ends = random_steps(plan, 200, np.random.default_rng(4))
    together = plan.collides(starts, ends, 8.0)
    headings = np.full((200, 1), 2.0)
    poses, after = np.hstack([starts, headings]), np.hstack([ends, headings])
    for n in (0, 1, 63, 64, 65, 200):
        assert plan.collides(poses[:n], after[:n], 8.0).tolist() == together[:n].tolist()


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
