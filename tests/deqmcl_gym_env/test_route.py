"""Routes: shortest ways with room on either side."""

import numpy as np
import pytest

from deqmcl_gym.maps import Office, PolygonMap
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.route import Routes

ROOM = PolygonMap(
    outer=[(0, 0), (350, 0), (350, 300), (0, 300)],
    obstacles=[[(100, 100), (250, 100), (250, 200), (100, 200)]],
)
ROUTES = Routes(ROOM, radius=10.0, comfort=40.0)
_MIRROR = PolygonMap(
    outer=[(0, 0), (355, 0), (355, 300), (0, 300)],
    obstacles=[[(100, 100), (255, 100), (255, 200), (100, 200)]],
)
MIRRORED = Routes(_MIRROR, radius=10.0, comfort=40.0)


def points(seed, count):
    """Places in free space, (count, 2)."""
    drawn = np.random.default_rng(seed).uniform((0, 0), (350, 300), (8 * count, 2))
    return drawn[ROOM.free(drawn, 15.0)][:count]


def length(route):
    return np.hypot(*np.diff(route, axis=0).T).sum()


@pytest.mark.parametrize("seed", range(10))
def test_a_route_leads_from_start_to_goal_clear_of_walls_and_back_the_same_way(seed):
    start, goal = points(seed, 2)
    route = ROUTES.between(start, goal)
    assert (route[[0, -1]] == [start, goal]).all()
    assert not ROOM.collides(route[:-1], route[1:], 9.9).any()
    assert length(ROUTES.between(goal, start)) == pytest.approx(length(route), rel=0.1)


def test_a_way_in_sight_is_straight():
    assert len(ROUTES.between((50, 50), (300, 50))) == 2


def test_a_route_goes_round_the_shorter_side():
    # 350 px below the rectangle, 450 px above it
    route = ROUTES.between((50, 130), (300, 130))
    assert route[:, 1].max() < 150
    # taut along the corners would be 268 px; keeping 40 px off them takes less than half more
    assert length(route) < 400


def test_a_route_keeps_its_distance_where_there_is_room():
    route = ROUTES.between((50, 90), (90, 50))
    assert ROOM.distance(route).min() >= 35  # comfort, less a cell


@pytest.mark.parametrize(
    ("start", "goal", "words"),
    [
        ((5, 5), (300, 50), r"the start \(5, 5\) is less than 10 px from a wall"),
        ((50, 50), (400, 50), r"the goal \(400, 50\)"),
        ((50, 50), (175, 150), r"the goal \(175, 150\)"),
    ],
)
def test_places_without_room_are_refused(start, goal, words):
    with pytest.raises(InputError, match=words):
        ROUTES.between(start, goal)


def test_no_way_is_said_to_be_none():
    closed = PolygonMap(
        outer=[(0, 0), (350, 0), (350, 300), (0, 300)],
        obstacles=[[(150, 5), (160, 5), (160, 295), (150, 295)]],
    )
    with pytest.raises(InputError, match="there is no route from"):
        Routes(closed, radius=10.0, comfort=20.0).between((50, 50), (300, 50))


def test_of_ways_at_equal_cost_a_route_takes_that_by_the_nearest_cell_and_of_these_the_last():
    ways, graph = MIRRORED.to((177.5, 50)), MIRRORED._graph + MIRRORED._graph.T
    ties = 0
    for cell, following in enumerate(ways.following):
        its = slice(*graph.indptr[cell : cell + 2])
        near, costs = graph.indices[its], graph.data[its]
        leading = near[ways.costs[near] + costs == ways.costs[cell]]
        order = sorted((ways.costs[one], -one) for one in leading)
        assert following == (-order[0][1] if order else -1)
        ties += len(order) > 1 and order[0][0] == order[1][0]
    assert ties > 0


@pytest.mark.parametrize("form", ["grid", "polygons"])
def test_cells_cost_as_if_the_distance_to_walls_were_known_at_each(form):
    """It is looked up near walls only; beyond the comfort it costs nothing."""
    plan, radius, comfort = getattr(Office(seed=2, wings=1), form), 0.3, 0.8
    found = Routes(plan, radius, comfort)._room
    x0, y0, _, _ = plan.bounds
    rows, columns = np.indices(found.shape)
    centres = np.column_stack([x0 + 0.1 * (columns.ravel() + 0.5), y0 + 0.1 * (rows.ravel() + 0.5)])
    everywhere = np.minimum(plan.distance(centres), comfort)
    expected = np.where(plan.free(centres, radius), everywhere, 0.0).reshape(found.shape)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert (found == comfort).any()
