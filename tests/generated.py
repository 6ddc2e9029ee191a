"""Floor plans, laps and worlds drawn by Hypothesis: of any shape, size and place."""

import math

import numpy as np
from hypothesis import strategies as st

FAR = (0.0, 0.0, 400.0, -1e3, 2e3)  # px: where a floor plan may lie
SIZES = (60.0, 350.0, 350.0, 3e3, 4e4)  # px


def stars(centre: tuple[float, float], size: float) -> st.SearchStrategy[list]:
    """Simple polygons around a point: convex or not, thin, with few corners or some."""
    corner = st.tuples(st.floats(0.02, 1.0), st.floats(0.1, 1.0))

    def polygon(parts: list[tuple[float, float]], turn: float, reverse: bool) -> list:
        gaps = np.array([gap for _, gap in parts])
        angles = turn + 2 * np.pi * np.cumsum(gaps) / gaps.sum()
        radii = size * np.array([radius for radius, _ in parts])
        xy = np.array(centre) + radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        return xy[:: -1 if reverse else 1].tolist()

    turns = st.floats(0.0, 2 * math.pi)
    return st.builds(polygon, st.lists(corner, min_size=3, max_size=10), turns, st.booleans())


def rectangles(centre: tuple[float, float], size: float) -> st.SearchStrategy[list]:
    """Axis-aligned ones, thin ones too."""
    side = st.sampled_from([0.001, 0.03, 0.3, 0.6, 0.95, 1.0])
    x, y = centre

    def polygon(a: float, b: float) -> list:
        w, h = size * a, size * b
        return [[x - w, y - h], [x + w, y - h], [x + w, y + h], [x - w, y + h]]

    return st.builds(polygon, side, side)


@st.composite
def spoilt(draw, polygons: st.SearchStrategy[list]) -> list:
    """What is often wrong with a polygon: a corner twice, a spike, a touch, corners exchanged."""
    polygon = [list(corner) for corner in draw(polygons)]
    k = draw(st.integers(0, len(polygon) - 1))
    (x, y), (u, v) = polygon[k], polygon[(k + 1) % len(polygon)]
    way = draw(st.sampled_from(["as it is", "twice", "spike", "touch", "exchange", "midway"]))
    middle = [(x + u) / 2, (y + v) / 2]
    if way == "twice":
        polygon.insert(k, [x, y])
    elif way == "spike":
        polygon[k + 1 : k + 1] = [middle, draw(st.sampled_from([[x - 40, y + 9], [x, y]])), middle]
    elif way == "touch":
        polygon[(k + 2) % len(polygon)] = middle
    elif way == "exchange":
        j = draw(st.integers(0, len(polygon) - 1))
        polygon[k], polygon[j] = polygon[j], polygon[k]
    elif way == "midway":
        polygon.insert(k + 1, middle)  # a corner of 180°: nothing wrong
    return polygon


@st.composite
def floor_plans(draw, *, sound: bool = False) -> dict:
    """A building of any size and place, with up to three obstacles; ``sound``: simple ones."""
    size = draw(st.sampled_from(SIZES))
    centre = tuple(draw(st.tuples(st.sampled_from(FAR), st.sampled_from(FAR))))
    outer = rectangles(centre, size) | stars(centre, size)
    count = draw(st.integers(0, 3))
    places = st.tuples(*[st.floats(c - 0.5 * size, c + 0.5 * size) for c in centre])
    obstacles = []
    for _ in range(count):
        at, share = draw(places), draw(st.sampled_from([0.02, 0.1, 0.3]))
        one = stars(at, size * share) | rectangles(at, size * share)
        obstacles.append(draw(one if sound else one | spoilt(one)))
    return {"outer": draw(outer if sound else outer | spoilt(outer)), "obstacles": obstacles}


@st.composite
def worlds(draw) -> dict:
    """Arguments of an environment: any floor plan, lap, noise, sensor and robot."""
    plan = draw(floor_plans(sound=True))
    (x0, y0), (x1, y1) = np.min(plan["outer"], axis=0), np.max(plan["outer"], axis=0)
    size = float(max(x1 - x0, y1 - y0))
    given = {
        "floor_plan": plan,
        "robot": {
            "radius": size * draw(st.sampled_from([0.0, 1e-3, 0.01, 0.03])),
            "max_distance": size * draw(st.sampled_from([0.03, 0.1])),
        },
        "lap": {"step": size * draw(st.sampled_from([0.011, 0.03]))},
        "lidar": draw(st.fixed_dictionaries({
            "beams": st.sampled_from([1, 2, 9, 40]),
            "field_of_view": st.sampled_from([0.01, 1.5, 2 * math.pi]),
            "sigma": st.sampled_from([0.0, 1.0, 100.0, 1e12]),
            "max_range": st.sampled_from([1e-3, 400.0, 1e12]),
        })),
        "noise": draw(st.fixed_dictionaries({
            "drive": st.sampled_from([0.0, 0.02, 2.0, 1e12]),
            "turn": st.sampled_from([0.0, 0.02, 2.0, 1e12]),
            "drift": st.sampled_from([0.0, 0.0005, 1.0]),
        })),
    }  # fmt: skip
    corner = st.tuples(st.floats(float(x0), float(x1)), st.floats(float(y0), float(y1)))
    if draw(st.booleans()):
        given["lap"]["waypoints"] = draw(st.lists(corner, min_size=3, max_size=6))
    if draw(st.integers(0, 3)) == 0:
        given["start"] = {"sd_position": 0.01 * size, "sd_heading": 0.3}
    if draw(st.integers(0, 4)) == 0:
        given["driver"] = {"look_ahead": 0.05 * size}
    return given
