"""Whatever polygons are given: exact geometry, or a refusal in one sentence."""

import re
import tracemalloc
from fractions import Fraction
from itertools import combinations

import numpy as np
import reference
from generated import floor_plans
from hypothesis import HealthCheck, assume, event, given, settings
from hypothesis import strategies as st

from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.maps.polygons import OVERLAP
from deqmcl_gym.validation import InputError

quietly = settings(suppress_health_check=list(HealthCheck))
corners = st.tuples(st.integers(0, 12), st.integers(0, 12))


def made(plan: dict) -> PolygonMap | str:
    try:
        return PolygonMap(**plan)
    except InputError as refused:
        sentence = str(refused)
    event("refused: " + " ".join(re.sub(r"[\d.]+", "", sentence).partition("(")[0].split()[:4]))
    assert sentence.endswith(".")
    return sentence


def crosses_itself(polygon: list) -> bool:
    corners = [(Fraction(x), Fraction(y)) for x, y in polygon]
    edges = list(zip(corners, corners[1:] + corners[:1], strict=True))

    def left(edge, point) -> Fraction:
        (ax, ay), (bx, by), (x, y) = *edge, point
        return (bx - ax) * (y - ay) - (by - ay) * (x - ax)

    def cross(a, b) -> bool:
        return left(a, b[0]) * left(a, b[1]) < 0 and left(b, a[0]) * left(b, a[1]) < 0

    return any(cross(*pair) for pair in combinations(edges, 2))


@quietly
@given(floor_plans(), st.integers(0, 2**32))
def test_a_floor_plan_is_made_with_exact_geometry_or_refused_for_what_is_wrong(plan, seed):
    found = made(plan)
    polygons = [plan["outer"], *plan["obstacles"]]
    if isinstance(found, str):
        assume(False)
    event("made")
    assert not any(map(crosses_itself, polygons))
    rng = np.random.default_rng(seed)
    x0, y0, x1, y1 = found.bounds
    size = max(x1 - x0, y1 - y0)
    step = 8 * np.spacing(np.float32(max(map(abs, found.bounds))))  # of single precision
    poses = rng.uniform((x0, y0, -np.pi), (x1, y1, np.pi), (200, 3))
    far = reference.clearance(found.walls, poses, poses)
    clear = far > 1e-4 * size + step
    poses, far = poses[clear], far[clear]
    inside = reference.winding(found.walls, poses) == 1
    np.testing.assert_array_equal(found.free(poses), inside)
    np.testing.assert_allclose(found.distance(poses), far, rtol=1e-4, atol=1e-5 * size + step)
    bearings = rng.uniform(-np.pi, np.pi, 8)
    seen = found.ranges(poses, bearings)[inside]
    exact = reference.ranges(found.walls, poses[inside], bearings)
    # A ray may hit or miss a corner that it passes: walls are cast longer by OVERLAP.
    off = np.zeros_like(poses[inside])
    off[:, 2] = 1e-5 + 2 * OVERLAP / far[inside]
    nudged = [reference.ranges(found.walls, poses[inside] + share * off, bearings)
              for share in (-1, -0.5, 0.5, 1)]  # fmt: skip
    low, high = np.min([exact, *nudged], axis=0), np.max([exact, *nudged], axis=0)
    assert (seen > low - 1e-4 * size - 16 * step).all()
    assert (seen < high + 1e-4 * size + 16 * step).all()


@quietly
@given(st.lists(corners, min_size=3, max_size=7))
def test_of_any_corners_at_all_those_of_a_simple_polygon_are_taken(polygon):
    """Whole corners: what touches, touches exactly."""
    refused = isinstance(made({"outer": polygon}), str)
    edges = np.hstack([polygon, np.roll(polygon, -1, axis=0)]).astype(float)
    count = len(edges)
    others = ((i, j) for i in range(count) for j in range(i + 2, count - (i == 0)))
    apart = [reference.clearance(edges[[i]], edges[[j], :2], edges[[j], 2:])[0] for i, j in others]
    along = edges[:, 2:] - edges[:, :2]
    turned = np.roll(along, -1, axis=0)
    straight = along[:, 0] * turned[:, 1] == along[:, 1] * turned[:, 0]
    back = straight & ((along * turned).sum(axis=1) <= 0)
    assert refused == (min(apart, default=1.0) == 0.0 or bool(back.any()))


@quietly
@given(st.integers(1, 400), st.sampled_from([(0, 0), (600, -300)]), st.floats(0, 3))
def test_the_narrowest_corridor_is_free_space(parts, at, turn):
    """An obstacle that leaves a gap of 1 px or less around it."""
    turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    ring = np.array([(-500, -500), (500, -500), (500, 500), (-500, 500)]) @ turned
    gap = 1 - 1 / (500 * parts)
    plan = PolygonMap((ring + at).tolist(), [(gap * ring + at).tolist()])
    assert plan.free([(ring[0] + ring[1]) / 2 * (1 + gap) / 2 + at]).all()


def test_a_contour_of_two_thousand_corners_takes_memory_for_them_alone():
    turn = np.linspace(0, 2 * np.pi, 2_000, endpoint=False)
    radius = 60 + 10 * np.sin(37 * turn)
    contour = np.column_stack([175 + radius * np.cos(turn), 150 + radius * np.sin(turn)])
    tracemalloc.start()
    plan = PolygonMap([(0, 0), (350, 0), (350, 300), (0, 300)], [contour.tolist()])
    ahead = plan.ranges([(175, 50, np.pi / 2)], [0.0])[0, 0]
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 7e6  # n x n numbers would take 32 MB
    walls = reference.ranges(plan.walls, [(175, 50, np.pi / 2)], [0.0])[0, 0]
    assert abs(ahead - walls) < 1e-3
