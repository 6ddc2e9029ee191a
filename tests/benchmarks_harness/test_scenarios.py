"""Scenarios: ours and users', what a trial changes of them, and how they are refused."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from refusals import refused
from report_cases import TURNER

from benchmarks.report.films import camera_of
from benchmarks.setup.names import make_agent, scenario
from benchmarks.setup.overrides import Named
from benchmarks.setup.priors import Places
from benchmarks.setup.scenario import Thresholds
from benchmarks.sweeps.sweepfile import sweep_named
from benchmarks.trials import Trial
from benchmarks.trials.stage import Stage, key_of
from deqmcl_gym import Driver
from deqmcl_gym.maps.map import scaled
from deqmcl_gym.world.drawing import PERSON
from localizers import BeamModel
from localizers.models.nav2_motion import unknown_motion

agent = partial(make_agent, robot=None)


def trial(**changes):
    few = {"scenario": "sharp", "localizer": "dead-reckoning", "params": ()}
    return Trial(**few | {"lag": 0, "seed": 0, "trial": 0} | changes)


def test_a_change_of_the_world_reaches_the_world_and_leaves_the_other_streams_alone():
    changes = {"lidar.beams": 9, "lidar.sigma": 1.0, "noise.drive": 0.5}
    room = scenario("paper").changed(changes).room()
    assert (room.lidar.beams, room.lidar.sigma, room.world.noise.drive) == (9, 1.0, 0.5)
    assert room.world.noise.turn == scenario("paper").room().world.noise.turn
    ours = [m.truth for m in Stage.of(trial()).moments()]
    theirs = [m.truth for m in Stage.of(trial(world=(("lidar.sigma", 50.0),))).moments()]
    assert np.array_equal(ours, theirs)  # another sensor, the same motion


def test_an_assumption_reaches_the_filters_and_no_other_and_the_world_is_not_changed():
    sharp = scenario("sharp")
    assumed = {"scan.sigma": 7.0, "motion.drive": 0.3, "prior.sd_heading": 0.5}
    changed = sharp.changed(assumed=assumed)
    assert changed.scan == replace(sharp.scan, sigma=7.0)
    assert changed.motion == replace(sharp.motion, drive=0.3)
    assert changed.prior == replace(sharp.prior, sd_heading=0.5)
    mcl = trial(localizer="mcl", params=(("particles", 20),))
    others = replace(mcl, assumed=(("scan.sigma", 50.0),))
    ours, theirs = (list(Stage.of(one).moments()) for one in (mcl, others))
    assert np.array_equal([m.ranges for m in ours], [m.ranges for m in theirs])
    assert not np.array_equal(ours[-1].belief.points()[0], theirs[-1].belief.points()[0])


def test_what_is_assumed_as_in_the_world_is_the_worlds_and_follows_its_changes(tmp_path):
    as_world = {"motion": "world", "scan.sigma": "world", "prior": "world"}
    changes = {"noise.drive": 0.5, "lidar.sigma": 7.0, "start.sd_heading": 0.3}
    changed = scenario("sharp").changed(changes, as_world)
    assert vars(changed.motion) == vars(changed.world.noise)
    assert (changed.scan.sigma, changed.motion.drive) == (7.0, 0.5)
    assert (changed.prior.sd_position, changed.prior.sd_heading) == (0.0, 0.3)
    part = scenario("sharp").changed(changes, {"motion.drive": "world"}).motion
    assert part == replace(scenario("sharp").motion, drive=0.5)
    (tmp_path / "as.toml").write_text('base = "sharp"\nprior = "world"\nassumed.motion = "world"')
    own = scenario(str(tmp_path / "as.toml"))
    assert vars(own.motion) == vars(own.world.noise)
    assert own.prior.sd_position == own.world.start.sd_position


@pytest.mark.parametrize("kind", ["differential", "omni"])
def test_another_kind_of_motion_has_its_own_defaults_in_the_worlds_unit(kind):
    sharp, assumed = scenario("sharp"), {"motion.kind": kind, "motion.alpha3": 0.1}
    changed = sharp.changed(assumed=assumed)
    assert changed.motion == replace(unknown_motion(kind, "px"), alpha3=0.1)
    assert changed.motion.alpha4 == pytest.approx(0.2 * 50**2)
    assert sharp.changed(assumed={"motion.kind": "odometry"}).motion == sharp.motion
    other = {"differential": "omni", "omni": "differential"}[kind]
    kept = changed.changed(assumed={"motion.kind": other}).motion
    assert kept == replace(unknown_motion(other, "px"), alpha3=0.1)
    moments = list(Stage.of(trial(localizer="mcl", assumed=tuple(assumed.items()))).moments())
    assert len(moments) > 5


PLACES = """
[prior]
kind = "places"
[[prior.places]]
weight = 3
kind = "uniform"
polygon = [[1, 1], [3, 1], [3, 2], [1, 2]]
[[prior.places]]
kind = "uniform"
near = [6, 4]
within = 1.0
beyond = 0.4
[[prior.places]]
kind = "gaussian"
mean = [6.5, 1.5, 3.0]
sd_position = 0.2
"""


def test_places_of_a_file_have_their_weights_and_are_scored_as_of_the_lost(tmp_path):
    path = tmp_path / "office.toml"
    hall = "outer = [[0, 0], [8, 0], [8, 6], [0, 6]]"
    path.write_text(f'base = "paper"\n[env.floor_plan]\nunit = "m"\n{hall}\n{PLACES}')
    found = scenario(str(path))
    prior = found.prior_in(found.room())
    assert prior.weights == pytest.approx((0.6, 0.2, 0.2))
    at = np.array([[2.0, 1.5, 1.0], [6.0, 4.1, 1.0], [6.0, 4.7, -3.0], [4.0, 3.0, 0.0]])
    ring = math.pi * (1.0**2 - 0.4**2)
    expected = [0.6 / 2.0 / (2 * math.pi), 0.0, 0.2 / ring / (2 * math.pi), 0.0]
    np.testing.assert_allclose(np.exp(prior.log_density(at)), expected, rtol=1e-9, atol=1e-30)
    stage = Stage.of(trial(scenario=str(path), localizer="mcl"))
    assert "lost" in [group.name for group in stage.groups]
    copy = tmp_path / "same.toml"
    copy.write_text(f'base = "{path.name}"')
    assert scenario(str(copy)).prior == found.prior


def test_places_keep_their_size_when_the_unit_changes():
    told = {"prior.kind": "uniform", "prior.near": (100.0, 200.0), "prior.within": 50.0}
    own = Places(places=({"kind": "uniform", "near": (100.0, 200.0), "within": 50.0},))
    hall = {"floor_plan.unit": "m", "floor_plan.outer": [[0, 0], [8, 0], [8, 6], [0, 6]]}
    base = scenario("paper").changed(assumed=told)
    for before in (base, replace(base, prior=own)):
        prior = before.changed(hall).prior
        near = prior.places[0].prior if isinstance(prior, Places) else prior
        assert (near.near, near.within) == (pytest.approx((2.0, 4.0)), pytest.approx(1.0))


BAD = [
    ({"world": (("lidr.beams", 9),)}, ["'lidr'", "did you mean 'lidar'?"]),
    ({"world": (("lidar", 9),)}, ["lidar", "9", "mapping"]),
    ({"world": (("driver", "nobody"),)}, ["driver", "'nobody'", "none"]),
    ({"world": (("driver", "none"), ("driver.look_ahead", 9.0))}, ["driver", "whole and by key"]),
    ({"assumed": (("scan.sigm", 9),)}, ["'scan.sigm'", "did you mean 'scan.sigma'?"]),
    ({"assumed": (("scan.kind", "beam"),)}, ["'beam'", "did you mean 'beam-model'?"]),
    ({"assumed": (("motion.kind", "diff"),)}, ["kind of motion 'diff'", "omni"]),
    ({"assumed": (("motion.kind", "omni"), ("motion.drive", 1))}, ["'motion.drive'", "alpha1"]),
    ({"assumed": (("prior.kind", "uniform"), ("prior.mean", 3))}, ["'prior.mean'", "prior.kind"]),
    ({"assumed": {"prior.kind": "uniform", "prior.near": (1, 2)}}, ["near and within"]),
    ({"assumed": {"prior.kind": "places"}}, ["no place", "[[prior.places]]"]),
    (
        {"assumed": {"prior.kind": "places", "prior.places": ({"kind": "gaussian"},)}},
        ["needs mean and sd_position"],
    ),
    ({"assumed": {"prior.kind": "places", "prior.places": (3,)}}, ["a place", "table"]),
    ({"disturbance": ((("kind", "kidnap"),),)}, ["'kidnap'", "step"]),
    ({"disturbance": ((("kind", "dropout"), ("probability", 2)),)}, ["probability", "2"]),
]


@pytest.mark.parametrize(("changes", "named"), BAD)
def test_a_setting_that_cannot_be_is_refused(changes, named):
    with refused(*named):
        list(Stage.of(trial(**changes)).moments())


ROOM = """
words = "an L of 8 by 6 m"
base = "guided"
agent = "agent.py:Turner"
[env.floor_plan]
unit = "m"
outer = [[0, 0], [8, 0], [8, 6], [0, 6]]
obstacles = [[[3, 2], [5, 2], [5, 4], [3, 4]]]
[env.lidar]
beams = 5
[assumed.motion]
turn = 0.4
[prior]
sd_position = 0.3
[thresholds]
lost = 2.0
"""


@pytest.fixture
def room(tmp_path):
    (tmp_path / "agent.py").write_text(TURNER)
    path = tmp_path / "room.toml"
    path.write_text(ROOM)
    return path


def test_a_scenario_file_changes_its_base_and_lengths_are_in_the_unit_of_its_map(room):
    ours, base = scenario(str(room)), scenario("guided")
    assert (ours.words, ours.world.floor_plan.unit) == ("an L of 8 by 6 m", "m")
    assert ours.world.lidar == replace(scaled(base.world.lidar, 0.02), beams=5)
    assert ours.motion == replace(base.motion, turn=0.4, drift=base.motion.drift / 0.02)
    assert ours.scan == replace(base.scan, sigma=0.02 * base.scan.sigma)
    assert ours.prior == replace(base.prior, sd_position=0.3)
    assert ours.thresholds == Thresholds(far=0.02 * 50, lost=2.0)
    assert ours.room().world.robot.radius == 0.02 * base.world.robot.radius
    assert make_agent(ours.agent, ours.robot_model(ours.room())).robot.lidar.beams == 5
    assert (sweep_named(str(room)).scenario, sweep_named(str(room)).title) == (str(room), "room")
    another = ours.changed(assumed={"scan.kind": "beam-model"}).scan
    assert another == BeamModel(sigma=0.02 * 100, decay=0.01 / 0.02)


def test_a_disturbance_of_a_scenario_file_is_that_of_a_sweep_file(tmp_path):
    path = tmp_path / "room.toml"
    path.write_text('base = "kidnapped"\ndisturbance = [{ kind = "dropout", probability = 0.5 }]')
    assert scenario(str(path)).disturbance == ({"kind": "dropout", "probability": 0.5},)
    path.write_text('base = "kidnapped"')
    assert scenario(str(path)).disturbance == ({"kind": "kidnap", "step": 75},)
    path.write_text('disturbance = ["kidnap"]')
    with refused("room.toml", "an entry of disturbance is 'kidnap'"):
        scenario(str(path))


def test_an_empty_table_is_a_value(tmp_path):
    path = tmp_path / "room.toml"
    for text in ("[env.driver]\n[env.route]\n[env.floor_plan.office]", "env.driver = {}"):
        path.write_text(f"buildings = 3\n{text}\n")
        found = scenario(str(path)).in_building(5)
        assert isinstance(found.world.driver, Driver)
        assert (found.unit, found.world.route is None) == (("m", False), ("px", True))["=" in text]
    path.write_text("[env.lidar]\n[assumed.scan]\n[prior]")  # nothing is changed
    assert scenario(str(path)).world == scenario("paper").world


def test_a_scenario_file_can_be_the_base_of_another(room):
    (room.parent / "more.toml").write_text('base = "room.toml"\nenv.driver = "none"')
    more = scenario(str(room.parent / "more.toml"))
    assert (more.words, more.world.driver, more.world.lidar.beams) == ("more", None, 5)
    assert more.room().world.driver is None
    assert more.agent == scenario(str(room)).agent


@pytest.mark.parametrize("edited", ["room.toml", "agent.py", "base.toml"])
def test_a_file_that_is_edited_makes_results_of_another_key(room, edited):
    (room.parent / "base.toml").write_text('base = "sharp"')
    room.write_text(ROOM.replace("guided", "base.toml"))
    before = key_of(trial(scenario=str(room)))
    assert key_of(trial(scenario=str(room))) == before
    (room.parent / edited).write_text((room.parent / edited).read_text() + "\n# edited")
    assert key_of(trial(scenario=str(room))) != before


BAD_FILES = [
    ("wrods = 'x'", ["'wrods'", "did you mean 'words'?"]),
    ("base = 'room.toml'", ["its own base"]),
    ("base = '~nobody/x.toml'", ["x.toml", "does not exist"]),
    ("[env]\nfloor_plan = '~nobody/x.yaml'", ["x.yaml", "does not exist"]),
    ("env = 3", ["env", "3", "table"]),
    ("[env.floor_plan]\nouter = [[0, 0], [1, 0]]", ["outer", "3"]),
    ("[thresholds]\nfar = 0", ["thresholds.far", "0"]),
    ("agent = 3", ["agent", "3", "a name, or"]),
    ("words = 'x", ["not valid TOML"]),
    ("agent = 'open-lop'", ["did you mean 'open-loop'"]),
    ("[env]\nhorizon = -3", ["horizon is -3"]),
    ("[env.floor_plan.office]", ["lap.waypoints"]),
]


@pytest.mark.parametrize(("text", "named"), BAD_FILES, ids=[text for text, _ in BAD_FILES])
def test_a_bad_scenario_file_is_refused_by_name(tmp_path, text, named):
    path = tmp_path / "room.toml"
    path.write_text(text)
    with refused(str(path), *named):
        Stage.of(trial(scenario=str(path))).check()


@pytest.mark.parametrize(
    ("find", "name", "named"),
    [
        (scenario, "papr", ["'papr'", "did you mean 'paper'?", "your own as room.toml"]),
        (scenario, 3, ["unknown scenario 3"]),
        (agent, "gone.py:Mine", ["the agent", "gone.py", "No such file"]),
        (agent, "math:pi", ["'math:pi'", "float", "NAME(robot"]),
        (agent, "math:sqrt", ["'math:sqrt'", "raised TypeError"]),
        (agent, Named("stale", {"shift": 1.0}), ["parameter of agent 'stale'", "shift"]),
        (agent, Named("misplaced", {"shift": -1.0}), ["shift is -1"]),
    ],
)
def test_a_scenario_or_agent_that_is_not_there_or_is_none_is_refused(find, name, named):
    with refused(*named):
        find(name)


@pytest.mark.parametrize(
    ("name", "spread"), [("paper", 0.0), ("matched", 50.0), ("guided", 50.0), ("driving", 0.5)]
)
def test_the_prior_is_centred_on_the_planned_start_not_on_the_truth(name, spread):
    found = scenario(name)
    room = found.room()
    for seed in range(3):
        truth = room.reset(seed=seed)[1]["truth"]
        mean = found.prior_in(room).mean
        assert mean == room.course.start
        assert 0 <= np.hypot(*(truth - mean)[:2]) <= spread  # 5 sd
        assert (truth != mean).any() == (spread > 0)


def test_a_localizer_is_given_the_map_and_a_film_shows_the_people_that_are_not_on_it():
    crowded = (("clutter.number", 30), ("people.number", 5))
    there = partial(trial, scenario="driving", localizer="mcl", trial=2)
    stage, plain = (Stage.of(there(world=world)) for world in (crowded, ()))
    assert stage.robot.floor_plan == plain.robot.floor_plan
    frame = camera_of(stage).scene(next(stage.moments())).image
    assert (frame == PERSON).all(axis=2).sum() > 100
