"""Worlds that differ from their map: what is told is the map, what is met is the world."""

import math
from itertools import pairwise

import numpy as np
import pytest
import reference
from room_cases import SMALL, WORLD, infos_of

from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.maps import GridMap
from deqmcl_gym.world.differences import BESIDE
from deqmcl_gym.world.drawing import GLASS, MAPPED, PERSON

FAN = {"beams": 24, "field_of_view": 2 * math.pi, "sigma": 0.0}
ROOM = {"preset": "paper", "lidar": FAN, "start": {"pose": (175, 50, 0.0)}}
OFFICE = WORLD | {"floor_plan": {"office": SMALL}, "lidar": FAN | {"max_range": 12.0}, "driver": {}}
EACH = {
    "clutter": {"clutter": {"number": 8}},
    "changed": {"changed_walls": {"share": 0.3}},
    "people": {"people": {"number": 6}},
    "glass": {"glass": {"share": 0.5}},
}
ALL = {key: value for part in EACH.values() for key, value in part.items()}
WORLDS = {"room": ROOM, "office": OFFICE}
PARTS = {"room": EACH["clutter"] | EACH["people"], "office": ALL}  # walls of polygons stay
PAIRS = [(world, part) for world in WORLDS for part in EACH if {*EACH[part]} <= {*PARTS[world]}]
# 7 m x 6 m, with a thin wall in the middle
CELLS = np.zeros((60, 70), np.int8)
CELLS[[0, -1]] = CELLS[:, [0, -1]] = 100
WALLED = CELLS.copy()
WALLED[30:32, 20:50] = 100
HALL = {
    "floor_plan": GridMap(occupancy=WALLED, resolution=0.1),
    "lidar": FAN | {"max_range": 12.0},
    "lap": {"waypoints": [(1, 1), (6, 1), (6, 5), (1, 5)]},
}


def begun(seed=0, **kwargs):
    env = RoomEnv(**kwargs)
    env.reset(seed=seed)
    return env


def there(env):
    return env._begun.there.world.floor_plan


def crowd(env):
    return env._begun._crowd


@pytest.mark.parametrize(("world", "part"), PAIRS)
def test_the_map_and_the_plan_are_those_of_the_world_without_it(world, part):
    env, plain = begun(3, **WORLDS[world], **EACH[part]), begun(3, **WORLDS[world])
    assert env.floor_plan is env.world.floor_plan
    assert plain.floor_plan in (env.floor_plan,) or repr(plain.floor_plan) == repr(env.floor_plan)
    np.testing.assert_array_equal(env.course.path.corners, plain.course.path.corners)
    np.testing.assert_array_equal(env.course.actions, plain.course.actions)
    assert env.pose == plain.pose
    assert env.observation_space == plain.observation_space


@pytest.mark.parametrize("part", EACH)
def test_motion_and_sensor_noise_stay_as_they_are(part):
    still = {"people": {"number": 2, "speed": (0, 0)}} if part == "people" else EACH[part]
    noisy = ROOM if part in ("clutter", "people") else HALL
    noisy = noisy | {"lidar": noisy["lidar"] | {"sigma": 0.01}}
    env, plain = begun(5, **noisy, **still), begun(5, **noisy)
    for action in plain.plan[:60]:
        seen, _, _, _, info = env.step(action)
        plainly, _, _, _, told = plain.step(action)
        np.testing.assert_array_equal(info["truth"], told["truth"])
    same = seen == plainly  # beams that nothing new meets have the same noise
    assert same.sum() > 3 or part == "glass"


@pytest.mark.parametrize("world", WORLDS)
def test_the_next_episode_has_people_elsewhere_and_another_seed_other_walls(world):
    env = begun(4, **WORLDS[world], **PARTS[world])  # the same seed: test_env_laws
    first, people = there(env), crowd(env).places.copy()
    env.reset()
    assert not np.array_equal(crowd(env).places, people)
    env.reset(seed=5)
    assert not np.array_equal(there(env).walls, first.walls)


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_on_the_way_unless_asked(world, seed):
    much = {"clutter": {"number": 12}}
    if world == "office":
        much["changed_walls"] = {"share": 0.5, "distance": 1.0}
    env = begun(seed, **WORLDS[world], **much)
    path, px = env.course.path, env.world.pixel
    corners = path.outline
    size = env.world.body + 0.99 * BESIDE * px
    points = np.vstack([np.linspace(a, b, 200) for a, b in pairwise(corners)])
    was, now = env.floor_plan.distance(points), there(env).distance(points)
    assert (now >= np.minimum(was, size)).all()  # where it is nearer, the map's wall was
    assert not there(env).collides(corners[:-1], corners[1:], env.world.body).any()


@pytest.mark.parametrize("seed", range(4))
def test_a_driver_reaches_his_goal_through_clutter_and_changed_walls(seed):
    small = {"noise": {"drive": 0.02, "turn": 0.02, "drift": 0.02}}
    much = {"clutter": {"number": 40}, "changed_walls": {"share": 0.5}}
    env = RoomEnv(**(OFFICE | small | much), ends_at_goal=True)
    infos = infos_of(env, seed)
    assert math.dist(infos[-1]["truth"][:2], infos[-1]["goal"]) <= env.world.route.tolerance


def test_a_driver_who_sees_that_his_way_is_blocked_goes_another_if_there_is_one():
    office = {"office": {"wings": 2, "corridors": 2, "seed": 1}}
    blocked = {"clutter": {"number": 60, "keep_route": False}}
    went, ended = 0, 0
    for seed in range(6):
        env = RoomEnv(**(OFFICE | {"floor_plan": office} | blocked))
        plain = begun(seed, **(OFFICE | {"floor_plan": office}))
        env.reset(seed=seed)
        went += not np.array_equal(env.course.path.corners, plain.course.path.corners)
        corners = env.course.path.corners
        ended += not there(env).collides(corners[:-1], corners[1:], env.world.body).any()
    assert went >= 3
    assert ended >= 4  # one thing in a door may close the only way


@pytest.mark.parametrize(("world", "part", "key", "less", "more"), [
    ("room", "clutter", "number", 5, 9), ("office", "clutter", "number", 5, 9),
    ("office", "changed_walls", "share", 0.1, 0.4),
])  # fmt: skip
def test_more_adds_to_what_less_has(world, part, key, less, more):
    small, large = (begun(2, **WORLDS[world], **{part: {key: value}}) for value in (less, more))
    if world == "room":
        few, many = ([tuple(o) for o in there(env).obstacles] for env in (small, large))
        assert many[: len(few)] == few
        assert len(many) == len(few) + 4
    else:
        clean = small.floor_plan.occupancy
        few, many = (there(env).occupancy != clean for env in (small, large))
        assert few.any()
        assert (few & ~many).sum() <= 0.05 * few.sum()  # walls added may lie over a wall removed
        assert many.sum() > few.sum()


def test_as_many_things_as_are_asked_for_stand_where_they_are_asked_to():
    env = begun(1, **ROOM, clutter={"number": 12, "where": "walls", "round": 1.0})
    _, *things = there(env).obstacles
    assert len(things) == 12
    for thing in things:
        corners = np.array(thing)
        size = math.dist(corners[0], corners[8]) / 2
        assert env.floor_plan.distance([corners.mean(axis=0)])[0] <= size + 1e-3


def brute(walls, places, radius, pose, bearings):
    """Distance along each beam to walls (S, 4), and to discs as polygons of 4,000 corners."""
    turns = 2 * np.pi * np.arange(4001) / 4000
    rim = radius * np.column_stack([np.cos(turns), np.sin(turns)])
    rims = [place + rim for place in places]
    walls = np.vstack([walls, *(np.hstack([r[:-1], r[1:]]) for r in rims)])
    return reference.ranges(walls, [pose], bearings)[0]


@pytest.mark.parametrize("world", WORLDS)
def test_scans_are_exact_among_clutter_changed_walls_and_people(world):
    parts = EACH["clutter"] | {"people": {"number": 15}}
    parts |= EACH["changed"] if world == "office" else {}
    env, hits = begun(1, **WORLDS[world], **parts), 0
    unit = 1.0 if world == "room" else 0.02
    for step in range(12):
        scan = env._begun.scan
        bearings = env.lidar.bearings
        free = brute(there(env).walls, [], 1.0, env.pose, bearings)
        exact = brute(there(env).walls, crowd(env).places, 15 * unit, env.pose, bearings)
        hits += (exact < free).sum()
        # float32 coordinates and a polygon of 4,000 corners are off by less, along a slant more
        off = np.abs(scan - np.minimum(exact, env.lidar.max_range)) > 0.02 * unit
        assert off.mean() < 0.05, (scan, exact)  # a beam may graze a corner or a rim
        env.step(env.plan[min(step, len(env.plan) - 1)] if step else (0.0, 0.3))
    assert hits > 5


def test_people_keep_off_walls_and_the_robot_and_it_stops_before_them():
    rng = np.random.default_rng(0)
    for world in ("room", "office"):
        parts = {"people": {"number": 12 if world == "room" else 60}}
        env = begun(2, **(WORLDS[world] | {"driver": "none"}), **parts, ends_at_goal=False)
        size, stopped, moved = crowd(env).radius, 0, 0.0
        touch = size + env.world.body
        step = env.world.robot.max_distance if world == "room" else 0.2
        info = {"collided": False}
        for _ in range(200):
            before = crowd(env).places.copy()
            turn = 0.75 if info["collided"] else rng.uniform(-0.1, 0.1)
            *_, ended, given_up, info = env.step(np.array([step, turn], np.float32))
            if ended or given_up:
                env.reset()
                continue
            places = crowd(env).places
            moved += np.abs(places - before).sum()
            assert there(env).free(places, 0.99 * size).all()
            nearest = np.sqrt(((places - env.pose[:2]) ** 2).sum(axis=1)).min()
            assert nearest >= touch
            walls = there(env).distance([env.pose[:2]])[0] - env.world.body
            stopped += info["collided"] and walls > 0.1 * step
        assert stopped > 0
        assert moved > 0


@pytest.mark.parametrize("seed", range(3))
def test_nobody_stands_in_the_way_for_long(seed):
    small = {"noise": {"drive": 0.02, "turn": 0.02, "drift": 0.02}}
    infos = infos_of(RoomEnv(**(OFFICE | small), people={"number": 30}), seed)
    assert math.dist(infos[-1]["truth"][:2], infos[-1]["goal"]) <= 1.0
    words = "".join("x" if info["collided"] else " " for info in infos).split()
    assert max(map(len, words), default=0) <= 20  # 8 s


def test_glass_stops_the_robot_and_loses_its_share_of_the_beams():
    start = {"start": {"pose": (3.5, 1.0, math.pi / 2)}}
    env = begun(**HALL, **start, ends_at_goal=False, glass={"share": 1.0, "lost": 0.4})
    through = env.floor_plan.ranges([env.pose], env.lidar.bearings)[0]
    hall = GridMap(occupancy=CELLS, resolution=0.1)
    behind = hall.ranges([env.pose], env.lidar.bearings)[0]
    met = behind > through + 0.1
    assert 5 <= met.sum() <= 15
    lost = []
    for _ in range(100):
        scan = env.step((0.0, 0.0))[0]
        is_lost = np.abs(scan - behind) < 1e-2
        assert (is_lost | (np.abs(scan - through) < 1e-2)).all()
        lost.append(is_lost[met])
    # a binomial share of n is off by 4 standard deviations once in 16,000 runs
    assert abs(np.mean(lost) - 0.4) < 4 * math.sqrt(0.24 / np.size(lost))
    for _ in range(20):
        _, _, _, _, info = env.step((0.2, 0.0))
    assert info["collided"]
    assert env.pose[1] < 3.0


def test_a_kidnapped_robot_is_put_where_nothing_is():
    env = begun(0, **OFFICE, clutter={"number": 40}, changed_walls={"share": 0.5})
    rng = np.random.default_rng(0)
    for _ in range(3):
        pose = env.elsewhere(rng)
        assert there(env).free([pose], env.world.body)[0]
        env.place(pose)


def test_frames_show_what_is_there_and_the_map_in_outline():
    parts = {"changed_walls": {"share": 0.5}, "people": {"number": 3}}
    env = begun(4, **HALL, **parts, render_mode="rgb_array")
    frame, view = env.render(), env.rules.view
    rows = lambda points: tuple(np.rint(view.pixels(points)).astype(int).T[::-1])  # noqa: E731
    assert (frame[rows(crowd(env).places)] == PERSON).all()
    middles = np.array([(wall[:2] + wall[2:]) / 2 for wall in env.floor_plan.walls])
    shown = frame[rows(middles[there(env).distance(middles) > 0.06])].astype(int)
    assert len(shown) > 0
    assert (np.abs(shown - MAPPED).sum(axis=1) < 250).all()  # a thin line, smoothed
    solid = begun(1, **HALL, glass={"share": 1.0}, render_mode="rgb_array").render()
    assert (solid == GLASS).all(axis=2).sum() > 4_000
    plain = begun(1, **HALL, render_mode="rgb_array").render()
    assert (plain == MAPPED).all(axis=2).sum() == 0
