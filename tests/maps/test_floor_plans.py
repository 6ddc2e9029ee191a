"""What a floor plan may be given as, and what is refused in one sentence."""

import json
import math

import numpy as np
import pytest
from refusals import refused

from deqmcl_gym.maps import GridMap, Office, PolygonMap
from deqmcl_gym.world import WORLDS, offices_of

OFFICE = Office(seed=3, wings=1)
NAN = float("nan")
SQUARE = [(0, 0), (100, 0), (100, 100), (0, 100)]
COVER = [(-1, -1), (101, -1), (101, 101), (-1, 101)]


def floor_plan(given):
    return WORLDS["paper"].changed(floor_plan=given).floor_plan


def offices(**office):
    return offices_of({"office": office})


def test_an_office_is_a_floor_plan_of_cells():
    for given in (OFFICE, {"office": {"seed": 3, "wings": 1}}, {"office": OFFICE}):
        assert floor_plan(given) is OFFICE.grid


def test_polygons_in_a_file_are_those_that_it_says(tmp_path):
    path = tmp_path / "room.json"
    obstacle = [*SQUARE[:2], (9, 9)]
    path.write_text(json.dumps({"outer": SQUARE, "obstacles": [obstacle], "unit": "m"}))
    for given in (path, str(path), {"file": str(path)}):
        assert floor_plan(given) == PolygonMap(SQUARE, [[*SQUARE[:2], (9, 9)]], "m")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is truncated, or not JSON"),
        ("[]", "is not a JSON object"),
        ('{"outer": [], "file": "a.json"}', "unknown key 'file'"),
        ('{"outer": [[0, 0], [9, 0], [9, 9]], "outer": []}', "has the name 'outer' twice"),
        ('{"outer": ' + "[" * 10**5, "is nested too deeply"),
        ('{"outer": [[0, 0], [9, 0], [9, ' + "9" * 5000, "is truncated, or not JSON"),
        ("\xff", "is not UTF-8"),
    ],
)
def test_a_broken_file_of_polygons_is_refused_by_name(tmp_path, text, words):
    path = tmp_path / "broken.json"
    path.write_bytes(text.encode("latin-1"))
    with refused(words, "broken.json"):
        floor_plan(path)


@pytest.mark.parametrize(
    ("polygons", "text"),
    [
        ([[(0, 0), (9, 0)]], "the outer wall"),
        ([[(0, 0), (100, 0), (100, NAN), (0, 100)]], "the outer wall"),
        ([SQUARE, [[(1, 1), (2, 1), (2, 2)], [(5, 5), (6, NAN), (5, 6)]]], "obstacle 1"),
        ([SQUARE, [(20, 20), (40, 20), (40, 40)]], "obstacle 0"),  # a polygon, not a list of them
        ([[(0, 0), (100, 0), (100, 0), (100, 100)]], "zero length at (100, 0)"),
        ([[*SQUARE, SQUARE[0]]], "the last corner is joined to the first by itself"),
        ([[(0, 0), (9, 9), (9, 0), (0, 9)]], "crosses or touches itself between edges 0 and 2"),
        ([SQUARE, [COVER]], "no free space"),
        ([[(6e5, 0), (6e5 + 9, 0), (6e5, 9)]], "move the floor plan towards (0, 0)"),
        ([[(0, 0), (50, 0), (100, 0)]], "folds back on itself at corner 2, (100, 0)"),
    ],
)
def test_a_floor_plan_that_cannot_be_is_refused_in_one_sentence(polygons, text):
    with refused(text):
        PolygonMap(*polygons)


def cells(occupancy, **more):
    return GridMap(occupancy=occupancy, resolution=0.05, **more)


OPEN = np.zeros((2, 2), int)
CASES = [
    (Office, {"seed": -1}, "office.seed is -1"),
    (Office, {"wings": 3, "symmetric": True}, "an even number"),
    (Office, {"repeated": True, "symmetric": True}, "either symmetric or repeated"),
    (Office, {"door": 0.85}, "a multiple of 0.1 m"),
    (cells, {"occupancy": [[0, 101], [0, 0]]}, "values from 0 to 101"),
    (cells, {"occupancy": [[0, 0], [0]]}, "rows of whole numbers"),
    *((cells, {"occupancy": OPEN, "unknown": bad}, "unknown") for bad in ("wall", 2)),
    *((GridMap.load, {"path": bad}, ".yaml file") for bad in ("map.pgm", 5)),
    (floor_plan, {"given": {"office": {"sed": 3}}}, "did you mean 'seed'"),
    (floor_plan, {"given": {"office": {}, "form": "x"}}, "allowed values: office"),
    (floor_plan, {"given": {"office": {"seeds": [0, 9]}}}, "give a seed"),
    (offices, {"seeds": [0, 9], "seed": 3}, "has seed = 3 and seeds = [0, 9]: give one of them"),
    (offices, {"seeds": [1]}, "must be two seeds, such as [0, 1000]"),
    (floor_plan, {"given": {"file": "a.json", "unknown": "free"}}, "floor_plan 'unknown'"),
    (floor_plan, {"given": {"file": "m.yaml", "outer": []}}, "key in floor_plan 'outer'"),
    (floor_plan, {"given": {"file": "nowhere.yaml"}}, "does not exist"),
    (floor_plan, {"given": 3}, "floor_plan is 3, but must be a map, the path"),
]


@pytest.mark.parametrize(("make", "kwargs", "text"), CASES)
def test_a_map_that_cannot_be_is_refused_in_one_sentence(make, kwargs, text):
    with refused(text):
        make(**kwargs)


def test_overlapping_obstacles_are_allowed():
    two = [[(20, 20), (60, 20), (60, 60), (20, 60)], [(40, 40), (80, 40), (80, 80), (40, 80)]]
    free = PolygonMap(SQUARE, two).free([(30, 30), (50, 50), (70, 70), (70, 30)])
    assert free.tolist() == [False, False, False, True]


def test_a_map_of_cells_shows_what_it_is_and_not_its_cells():
    grid = GridMap(occupancy=np.zeros((20, 30), np.int8), resolution=0.05)
    assert repr(grid) == "GridMap(30 x 20 cells of 0.05 m, origin (0.0, 0.0, 0.0))"


@pytest.mark.parametrize("floor_plan", [PolygonMap(SQUARE), Office().grid])
def test_arrays_of_another_shape_are_refused_before_a_kernel_reads_past_their_end(floor_plan):
    poses, points = np.zeros((3, 4), np.float32), np.full((5, 2), 5.0)
    path = np.zeros((3, 2), np.float32)
    calls = [
        lambda: floor_plan.ranges(points, [0.0]),  # no heading
        lambda: floor_plan.ranges([5.0, 5.0, 0.0], [0.0]),
        lambda: floor_plan.free([5.0, 5.0]),
        lambda: floor_plan.distance(points[:, :1]),
        lambda: floor_plan.collides(points[:1], points, 0.1),
        lambda: floor_plan.collides(points, points[:1], 0.1),
        lambda: floor_plan.collisions_along(poses[:2], path, 0.1),
        lambda: floor_plan.collisions_along(poses, path[:1], 0.1),
        lambda: floor_plan.collisions_along(poses, path.T.copy(), 0.1),
    ]
    for call in calls:
        with refused():
            call()


@pytest.mark.parametrize("floor_plan", [PolygonMap(SQUARE), Office().grid])
@pytest.mark.parametrize(
    ("bad", "words"),
    [
        *(({"radius": bad}, "radius is") for bad in (-20.0, math.nan, math.inf, "8")),
        ({"pose": (5, 5, 1e6)}, "a heading of poses is 1e+06 rad"),
        ({"pose": ("a", "b", "c")}, "poses is"),
        ({"bearings": [[0.0]]}, "bearings have shape (1, 1)"),
    ],
)
def test_a_question_with_what_is_no_radius_pose_or_bearing_is_refused(floor_plan, bad, words):
    rows = np.ones((3, 1), np.float32)
    questions = [
        lambda pose, bearings, **_: floor_plan.ranges([pose], bearings),
        lambda radius, **_: floor_plan.free([(5, 5)], radius),
        lambda radius, **_: floor_plan.collides([(5, 5)], [(6, 5)], radius),
        lambda radius, **_: floor_plan.collisions_along(rows, rows[:2, [0, 0]], radius),
    ]
    for ask in questions[1:] if "radius" in bad else questions[:1]:
        with refused(words):
            ask(**{"pose": (5, 5, 0), "bearings": [0.0], "radius": 0.1} | bad)
