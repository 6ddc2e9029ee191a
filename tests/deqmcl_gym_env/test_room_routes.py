"""Worlds with a route: a start and a goal, the way between them, and who drives it."""

import itertools
import math

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from room_cases import PAPER, SMALL, STILL, WORLD, infos_of
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

import localizers
from deqmcl_gym import JOURNEY_ENV_ID as JOURNEY
from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.envs.belief import BeliefObservation
from deqmcl_gym.envs.wrappers import Kidnap
from deqmcl_gym.maps import Office, PolygonMap
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.course import Path
from deqmcl_gym.world.route import Routes

ROOM = PolygonMap(**PAPER)
ROUTES = Routes(ROOM, radius=10.0, comfort=40.0)


def office(seed=0, seeds=None, **kwargs) -> RoomEnv:
    kind = {key: kwargs.pop(key) for key in ("wings", "corridors") if key in kwargs}
    which = {"seed": seed} if seeds is None else {"seeds": seeds}
    return RoomEnv(floor_plan={"office": SMALL | kind | which}, **(WORLD | kwargs))


def check_arrives(env, seed):
    infos = infos_of(env, seed)
    assert not any(info["collided"] for info in infos)
    assert np.hypot(*(infos[-1]["truth"][:2] - infos[-1]["goal"])) <= 0.5
    assert infos[-1]["planned_count"] == 0
    path = env.course.path
    assert 15 <= path.length <= 60
    assert not env.floor_plan.collides(path.corners[:-1], path.corners[1:], 0.3 - 1e-3).any()


@pytest.mark.parametrize("seed", range(4))
def test_a_driver_who_sees_the_pose_reaches_every_goal_without_contact(seed):
    env = office(seed, driver={})
    for journey in range(5):
        check_arrives(env, journey)


def test_without_noise_the_plan_made_before_the_start_leads_to_the_goal():
    env = office(noise=STILL, ends_at_goal=False)
    for seed in range(5):
        infos = infos_of(env, seed)
        assert not any(info["collided"] for info in infos)
        # float32 commands: half an ulp of a turn below 0.5 rad, 60 m on, some hundred times
        assert infos[-1]["truth"][:2] == pytest.approx(infos[-1]["goal"], abs=60 * 300 * 2.0**-26)


def test_the_episode_ends_at_the_goal():
    infos = infos_of(office(noise=STILL), 1)
    off = [np.hypot(*(info["truth"][:2] - info["goal"])) for info in infos]
    assert off[-1] <= 0.5 < min(off[:-1])
    assert infos[-1]["planned_count"] > 0


def test_places_of_ones_own_replace_what_is_drawn():
    free = office()
    info = free.reset(seed=3)[1]
    start, goal = tuple(info["truth"]), tuple(info["goal"])
    for seed in range(3):
        one = office(start={"pose": start}).reset(seed=seed)[1]
        np.testing.assert_allclose(one["truth"], start)
        other = office(route={**WORLD["route"], "goal": goal}).reset(seed=seed)[1]
        np.testing.assert_allclose(other["goal"], goal)
    both = office(start={"pose": start}, route={"goal": goal, "min_length": 100, "max_length": 100})
    np.testing.assert_allclose(both.reset(seed=0)[1]["goal"], goal)


def test_each_episode_is_in_an_office_drawn_by_its_seed_and_is_as_if_that_were_given():
    env = office(seeds=[20, 30], horizon=5)
    drawn = []
    for seed in (5, 5, None, None, None):
        info = env.reset(seed=seed)[1]
        drawn.append(int(info["building"]))
        assert env.floor_plan is Office(**SMALL, seed=info["building"]).grid
        x, y = info["goal"]
        assert env.floor_plan.free([(x, y)], env.radius)[0]
        assert env.step(info["planned_actions"][0])[4]["building"] == drawn[-1]
    assert drawn[0] == drawn[1]
    assert len(set(drawn)) > 2
    assert set(drawn) <= set(range(20, 30))
    alone = office(seed=drawn[0], horizon=5)
    (seen, info), (own, same) = env.reset(seed=5), alone.reset(seed=5)
    assert info.pop("building") == drawn[0]
    np.testing.assert_equal((seen, info), (own, same))
    for _ in range(3):
        action = same["planned_actions"][0]
        (seen, *_, info), (own, *_, same) = env.step(action), alone.step(action)
        np.testing.assert_equal(seen, own)


def test_progress_adds_up_to_the_way():
    env = office(noise=STILL, ends_at_goal=False)
    info, total, ended = env.reset(seed=2)[1], 0.0, False
    while not ended:
        _, reward, done, given_up, info = env.step(info["planned_actions"][0])
        ended = done or given_up
        total += reward
    assert total == pytest.approx(env.course.path.length, rel=1e-4)


def test_a_driver_plans_from_where_the_robot_was_carried_or_shows_what_was_planned():
    seen, blind = (Kidnap(office(driver={}), 20, noticed=noticed) for noticed in (True, False))
    one, other = infos_of(seen, 4), infos_of(blind, 4)
    np.testing.assert_array_equal(one[19]["planned_actions"], other[19]["planned_actions"])
    np.testing.assert_allclose(one[20]["goal"], one[19]["goal"])
    assert np.hypot(*(one[-1]["truth"][:2] - one[-1]["goal"])) <= 0.5
    assert not any(info["collided"] for info in one)
    shown = other[19]["planned_actions"][: other[19]["planned_count"]]
    for step in (20, 21, len(shown)):
        rest = other[19 + step]["planned_actions"][: other[19 + step]["planned_count"]]
        np.testing.assert_array_equal(rest, shown[step:])
    assert len(other) == 20 + len(shown)


def seen_from(pose, goal):
    dx, dy = goal[0] - pose[0], goal[1] - pose[1]
    bearing = math.atan2(dy, dx) - pose[2]
    return [math.hypot(dx, dy), math.atan2(math.sin(bearing), math.cos(bearing))]


def test_the_goal_is_seen_from_the_true_pose_and_no_plan_is_seen():
    env = gym.make(JOURNEY, plan=False, goal="relative")
    seen, info = env.reset(seed=3)
    goal = env.unwrapped.course.goal
    for _ in range(20):
        assert sorted(seen) == ["clock", "goal", "progress", "scan"]
        np.testing.assert_allclose(seen["goal"], seen_from(info["truth"], goal), atol=1e-5)
        assert env.observation_space.contains(seen)
        seen, *_, info = env.step(info["planned_actions"][0])


def test_the_goal_may_be_seen_from_the_belief():
    env = gym.make(JOURNEY, plan=False, floor_plan={"office": {"seed": 1}})
    room = env.unwrapped
    robot = localizers.RobotModel(floor_plan=room.floor_plan, lidar=room.lidar)
    anywhere = localizers.UniformPrior(floor_plan=room.floor_plan)
    mcl = localizers.make("mcl", robot, particles=50)
    view = BeliefObservation(env, mcl, anywhere, goal="relative")
    seen, info = view.reset(seed=0)
    for _ in range(5):
        wanted = seen_from(seen["mean"], room.course.goal)
        np.testing.assert_allclose(seen["goal"], wanted, atol=1e-4)
        assert view.observation_space.contains(seen)
        seen, *_, info = view.step(info["planned_actions"][0])


def test_a_picture_shows_the_way_and_its_goal():
    env = office(render_mode="rgb_array")
    env.reset(seed=0)
    image = env.render().astype(int)
    assert (image[:, :, 2] - image[:, :, 0] > 60).sum() > 300  # the way in blue, the goal is 81


def test_a_driver_set_down_at_its_goal_is_refused_and_nothing_has_changed():
    env = office(driver={})
    _, info = env.reset(seed=1)
    for x in (0.0, 0.3):
        with pytest.raises(InputError, match="the pose is within"):
            env.place((info["goal"][0] + x, info["goal"][1], 0.0))
    again = office(driver={})
    again.reset(seed=1)
    for _ in range(3):
        info = env.step(info["planned_actions"][0])[-1]
        same = again.step(info["command"])[-1]
        np.testing.assert_array_equal(same["planned_actions"], info["planned_actions"])


@given(st.lists(st.tuples(*[st.integers(-50, 50)] * 2), min_size=2, max_size=8), st.floats(0, 1))
def test_an_open_path_is_followed_to_its_end_and_not_round(corners, share):
    corners = np.array([c for i, c in enumerate(corners) if i == 0 or c != corners[i - 1]], float)
    if len(corners) < 2:
        return
    path = Path(corners, closed=False)
    assert path.length == pytest.approx(np.hypot(*np.diff(corners, axis=0).T).sum())
    assert path.at(2 * path.length)[:2] == pytest.approx(tuple(corners[-1]))
    at = path.at(share * path.length)[:2]
    near = path.at(path.arc(at))[:2]
    assert near == pytest.approx(at, abs=1e-9)
    assert path.advance(0.0, path.length) == path.length
    points = path.corners_from(share * path.length)
    rest = np.hypot(*np.diff(points, axis=0).T).sum()
    assert rest == pytest.approx((1 - share) * path.length, abs=1e-9)


def points(seed, count):
    drawn = np.random.default_rng(seed).uniform((0, 0), (350, 300), (8 * count, 2))
    return drawn[ROOM.free(drawn, 15.0)][:count]


def length(route):
    return np.hypot(*np.diff(route, axis=0).T).sum()


@pytest.mark.parametrize("seed", range(10))
def test_a_route_leads_from_start_to_goal_clear_of_walls_and_back_the_same_way(seed):
    start, goal = points(seed, 2)
    route = ROUTES.to(goal).start_at(start)
    assert (route[[0, -1]] == [start, goal]).all()
    assert not ROOM.collides(route[:-1], route[1:], 9.9).any()
    assert length(ROUTES.to(start).start_at(goal)) == pytest.approx(length(route), rel=0.1)


def test_a_way_in_sight_is_straight_and_any_keeps_its_distance_where_there_is_room():
    assert len(ROUTES.to((300, 50)).start_at((50, 50))) == 2
    route = ROUTES.to((90, 50)).start_at((50, 90))
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
        ROUTES.to(goal).start_at(start)


def test_goals_anywhere_in_any_of_several_offices_are_in_the_space():
    env = gym.make(JOURNEY, floor_plan={"office": {"seeds": [0, 5], **SMALL}})
    for seed in range(5):
        x0, y0, x1, y1 = Office(seed=seed, **SMALL).grid.bounds
        for corner in ((x0, y0), (x1, y1)):
            assert np.array(corner, np.float32) in env.observation_space["goal"]


def graph_of(routes):
    """Costs of steps between neighbouring free cells, a sparse matrix, by the definition."""
    free = {cell: number for number, cell in enumerate(zip(*np.nonzero(routes._room), strict=True))}
    dear = routes._cell * (1 + 4 * np.clip(1 - routes._room / routes.comfort, 0, 1))
    steps = [step for step in itertools.product((-1, 0, 1), repeat=2) if step != (0, 0)]
    costs = [
        (math.sqrt(down**2 + right**2) * (dear[row, column] + dear[row + down, column + right]) / 2,
         number, free[row + down, column + right])
        for (row, column), number in free.items()
        for down, right in steps
        if (row + down, column + right) in free
    ]  # fmt: skip
    values, here, there = zip(*costs, strict=True)
    return csr_array((values, (here, there)), shape=(len(free), len(free)))


def test_of_ways_at_equal_cost_a_route_takes_that_by_the_nearest_cell_and_of_these_the_last():
    outer = [(0, 0), (355, 0), (355, 300), (0, 300)]
    block = [(100, 100), (255, 100), (255, 200), (100, 200)]
    routes = Routes(PolygonMap(outer=outer, obstacles=[block]), radius=10.0, comfort=40.0)
    ways, graph, ties = routes.to((177.5, 50)), graph_of(routes), 0
    for cell, following in enumerate(ways.following):
        its = slice(*graph.indptr[cell : cell + 2])
        near = graph.indices[its]
        leading = near[ways.costs[near] + graph.data[its] == ways.costs[cell]]
        order = sorted((ways.costs[one], -one) for one in leading)
        assert following == (-order[0][1] if order else -1)
        ties += len(order) > 1 and order[0][0] == order[1][0]
    assert ties > 0


@pytest.mark.parametrize("seed", range(3))
def test_costs_are_those_of_scipys_dijkstra_bit_for_bit(seed):
    routes = Routes(Office(seed=seed, **SMALL).grid, radius=0.3, comfort=0.8)
    graph = graph_of(routes)
    for goal in np.random.default_rng(seed).integers(len(routes.centres), size=3):
        costs = routes.to(tuple(routes.centres[goal])).costs
        np.testing.assert_array_equal(costs, dijkstra(graph, indices=goal))
