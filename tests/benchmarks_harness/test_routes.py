"""Scenarios in buildings: the same journey for all methods, and agents that drive to a goal."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from refusals import refused

from benchmarks.agents import OldRoute, OnRoute, ToGoal
from benchmarks.setup.names import scenario
from benchmarks.trials import Trial
from benchmarks.trials.stage import Stage
from deqmcl_gym.logs.motion import dead_reckoned
from deqmcl_gym.maps import Office
from localizers import PoseBelief

RADIUS, CELL = 0.25, 0.1
NEAR = 3.0 * 2.0**-10  # m: float32 commands along 60 m, and the skin


def trial(name, number=0, **kwargs):
    few = {"localizer": "mcl", "params": (("particles", 50),), "lag": 0, "seed": 0} | kwargs
    return Trial(scenario=name, trial=number, **few)


def begun(name, number=0):
    one = trial(name, number)
    room = Stage.of(one).room
    return room, room.reset(seed=one.world_seed)[1]


def contacts(room, pose, actions):
    points = dead_reckoned(actions, pose)[:, :2]
    return int(room.floor_plan.collides(points[:-1], points[1:], RADIUS - NEAR).sum())


def driving(number=0, agent=ToGoal):
    room, info = begun("driving", number)
    driver = agent(scenario("driving").robot_model(room))
    at_reset = driver.plan_at_reset(info | {"route": room.course.path.corners})
    assert at_reset is None or len(at_reset) == 0  # no plan of one's own before there is a belief
    return room, info, driver


def shown(info):
    return info["planned_actions"][: info["planned_count"]]


def test_a_trial_has_its_building_and_its_journey_whatever_the_localizer():
    rooms = [begun("lost", number) for number in (0, 1, 20)]
    shapes = [room.floor_plan.occupancy.shape for room, _ in rooms]
    assert rooms[0][0].floor_plan is rooms[2][0].floor_plan  # 20 buildings, each made once
    assert shapes[0] != shapes[1]
    assert not np.array_equal(rooms[0][1]["goal"], rooms[2][1]["goal"])


def test_trials_take_turns_in_the_buildings_of_a_range_of_seeds(tmp_path):
    path = tmp_path / "unseen.toml"
    path.write_text('base = "searching"\nenv.floor_plan.office = { wings = 1, seeds = [50, 53] }\n')
    told = scenario(str(path))
    offices = [told.in_building(k).world.floor_plan for k in range(4)]
    assert offices == [Office(wings=1, seed=seed).grid for seed in (50, 51, 52, 50)]
    assert told.world.floor_plan is offices[0]
    varied = (("floor_plan.office.seeds", [7, 9]), ("floor_plan.office.wings", 1))
    drawn = [Stage.of(trial("lost", k, world=varied)).scenario.world.floor_plan for k in range(3)]
    assert drawn == [Office(wings=1, seed=seed).grid for seed in (7, 8, 7)]


@pytest.mark.parametrize("number", range(6))
def test_the_route_fits_one_of_two_wings_or_both_of_two_halves(number):
    room, info = begun("lost-symmetric", number)
    rows, columns = room.floor_plan.occupancy.shape
    # walls of 2 cells at both ends, three corridors of 20 and two wings
    apart = ((columns - 2 * 2 - 3 * 20) // 2 + 20) * CELL
    x, y, heading = info["truth"]
    twin = (x + apart if x < columns * CELL / 2 else x - apart, y, heading)
    assert contacts(room, info["truth"], shown(info)) == 0
    assert contacts(room, twin, shown(info)) > 0

    room, info = begun("lost-symmetric-route", number)
    rows, columns = room.floor_plan.occupancy.shape
    x, y, heading = info["truth"]
    twin = (columns * CELL - x, rows * CELL - y, heading + np.pi)
    assert contacts(room, info["truth"], shown(info)) == contacts(room, twin, shown(info)) == 0


def test_after_the_kidnap_the_same_robot_drives_on_with_a_plan_about_it_or_with_the_old_one():
    room, _ = begun("kidnapped")
    pair = ("kidnapped", "kidnapped-stale")
    runs = [list(itertools.islice(Stage.of(trial(name)).moments(), 120)) for name in pair]
    for told, stale in zip(*runs, strict=True):
        np.testing.assert_array_equal(told.truth, stale.truth)
        np.testing.assert_array_equal(told.ranges, stale.ranges)
        np.testing.assert_array_equal(told.action, stale.action)
    told, stale = ([moment.plan for moment in run] for run in runs)
    carried = 75
    assert np.hypot(*(runs[0][carried].truth - runs[0][carried - 1].truth)[:2]) > 1
    np.testing.assert_array_equal(stale[0], told[0])
    for step in range(1, carried + 1):  # the dispatcher's, made before the step
        np.testing.assert_array_equal(stale[step], told[step - 1][1:])
    for step in range(carried, 120):
        np.testing.assert_array_equal(stale[step], stale[carried][step - carried :])
    truth = runs[0][90].truth
    assert contacts(room, truth, told[90]) == 0 < contacts(room, truth, stale[90])
    assert not any(moment.collided for moment in runs[1])


@pytest.mark.parametrize("number", [35, 251])  # of 1,000: they start beside a corner of a wall
def test_one_who_sees_the_pose_cuts_no_corner_however_much_of_the_plan_is_shown(number):
    one = trial("driving-perfect", number)
    rooms = [Stage.of(one).room, Stage.of(replace(one, world=(("horizon", 3),))).room]
    infos = [room.reset(seed=one.world_seed)[1] for room in rooms]
    cornered, ended = 0, False
    while not ended:
        np.testing.assert_array_equal(shown(infos[0])[:3], shown(infos[1]))
        cornered += contacts(rooms[0], infos[0]["truth"], shown(infos[0])) > 0
        *_, done, given_up, infos[0] = rooms[0].step(shown(infos[0])[0])
        infos[1] = rooms[1].step(shown(infos[1])[0])[-1]
        assert not infos[0]["collided"]
        ended = done or given_up
    assert cornered == 0
    assert np.hypot(*(infos[0]["truth"][:2] - infos[0]["goal"])) <= 0.5


@pytest.mark.parametrize("agent", [ToGoal, OnRoute])
@pytest.mark.parametrize("number", range(2))
def test_an_agent_that_is_told_the_truth_arrives_without_contact_by_free_space(agent, number):
    room, info, driver = driving(number, agent)
    touched, ended = 0, False
    while not ended:
        action, plan = driver.act(PoseBelief(info["truth"]), info)
        assert contacts(room, info["truth"], np.vstack([action, plan])) == 0
        *_, done, given_up, info = room.step(action)
        ended = done or given_up
        touched += info["collided"]
    assert touched == 0
    assert np.hypot(*(info["truth"][:2] - info["goal"])) <= 0.5


def test_an_agent_that_believes_anything_acts_and_plans_through_free_space():
    room, info, driver = driving()
    rng = np.random.default_rng(0)
    low, high = room.floor_plan.bounds[:2], room.floor_plan.bounds[2:]
    believed = [(*rng.uniform(low, high), rng.uniform(-np.pi, np.pi)) for _ in range(40)]
    free = room.floor_plan.free(believed, RADIUS + 0.05 + CELL)
    assert 5 < free.sum() < 35
    for pose, clear in zip(believed, free, strict=True):
        action, plan = driver.act(PoseBelief(pose), info)
        assert room.action_space.contains(np.asarray(action, np.float32))
        assert not clear or contacts(room, pose, np.vstack([action, plan])) == 0


@pytest.mark.parametrize("agent", [ToGoal, OldRoute])
def test_an_agent_with_a_goal_and_the_old_route_need_a_world_with_a_route(agent):
    paper = scenario("paper")
    room = paper.room()
    with refused("give a world with a route"):
        agent(paper.robot_model(room)).plan_at_reset(room.reset(seed=0)[1])
