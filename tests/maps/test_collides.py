"""PolygonMap.collides against pymunk and against the plain NumPy reference.

pymunk decides what touches; it knows no interior, so where a step ends comes from the winding
number. Two things about its thick segment query (7.3): it misses a disc that overlaps at the start,
so the nearest point at both ends is asked for as well; and ``Space.segment_query`` does not widen
its broad phase by the radius (it misses walls whose bounding box the centre's path does not cross),
so each shape is asked by itself.

Away from touching, where the path's clearance from the walls differs from the radius by more than
BAND, both must agree exactly. Nearer than that float32 may decide either way: coordinates of 400 px
are resolved to 3e-5 px, and a clearance is a handful of operations on them.
"""

import numpy as np
import pymunk
import pytest
import reference
from sample_plans import PLANS, anywhere, corners, space_of

from deqmcl_gym.maps import PolygonMap

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
