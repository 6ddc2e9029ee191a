"""Bad floor plans are refused with one sentence that says what was given."""

import pytest

from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.validation import InputError

SQUARE = [(0, 0), (100, 0), (100, 100), (0, 100)]


def refusal(*polygons: object) -> str:
    with pytest.raises(InputError) as caught:
        PolygonMap(*polygons)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    return sentence


@pytest.mark.parametrize("outer", [[], [(0, 0), (9, 0)]])
def test_an_outer_wall_of_fewer_than_three_corners_is_refused(outer):
    assert refusal(outer).startswith("the outer wall")


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_corner_that_is_not_finite_is_refused(bad):
    assert "the outer wall" in refusal([(0, 0), (100, 0), (100, bad), (0, 100)])
    assert "obstacle 1" in refusal(SQUARE, [[(1, 1), (2, 1), (2, 2)], [(5, 5), (6, bad), (5, 6)]])


def test_an_edge_of_zero_length_is_refused_with_its_place():
    assert "zero length at (100, 0)" in refusal([(0, 0), (100, 0), (100, 0), (100, 100)])
    assert "zero length at (0, 0)" in refusal([(0, 0), (1e-4, 0), (100, 0), (100, 100)])


def test_naming_the_first_corner_again_at_the_end_is_refused_because_a_wall_closes_itself():
    assert "the last corner is joined to the first by itself" in refusal([*SQUARE, SQUARE[0]])


def test_a_wall_that_crosses_itself_is_refused_with_the_edges():
    assert "crosses itself between edges 0 and 2" in refusal([(0, 0), (9, 9), (9, 0), (0, 9)])
    assert "obstacle 0 crosses itself" in refusal(
        SQUARE, [[(10, 10), (20, 20), (20, 10), (10, 20)]]
    )


@pytest.mark.parametrize("grown", [0.0, 1.0, 1000.0])
def test_a_plan_whose_obstacle_fills_it_has_no_free_space_and_is_refused(grown):
    cover = [
        (-grown, -grown),
        (100 + grown, -grown),
        (100 + grown, 100 + grown),
        (-grown, 100 + grown),
    ]
    assert "no free space" in refusal(SQUARE, [cover])


def test_an_outer_wall_without_area_has_no_free_space_and_is_refused():
    assert "no free space" in refusal([(0, 0), (50, 0), (100, 0)])


@pytest.mark.parametrize(
    "outer",
    [
        None,
        "abc",
        [(0, 0, 0), (1, 0, 0), (1, 1, 0)],
        [(0, 0), (1, 0), None],
    ],
)
def test_an_outer_wall_that_is_no_list_of_corners_is_refused(outer):
    assert refusal(outer).startswith("the outer wall")


@pytest.mark.parametrize("obstacles", [None, 5])
def test_obstacles_that_are_no_list_are_refused(obstacles):
    assert refusal(SQUARE, obstacles).startswith("obstacles is")


def test_a_polygon_where_a_list_of_polygons_belongs_is_refused():
    assert refusal(SQUARE, [(20, 20), (40, 20), (40, 40)]).startswith("obstacle 0")


def test_a_plan_without_obstacles_and_one_with_overlapping_obstacles_are_allowed():
    assert PolygonMap(SQUARE).free([(50, 50)]).all()
    two = [[(20, 20), (60, 20), (60, 60), (20, 60)], [(40, 40), (80, 40), (80, 80), (40, 80)]]
    plan = PolygonMap(SQUARE, two)
    assert plan.free([(30, 30), (50, 50), (70, 70), (70, 30)]).tolist() == [
        False,
        False,
        False,
        True,
    ]
