"""Whole runs: when a robot is localized, committed or found again, and the scores of that."""

import math
from dataclasses import replace

import numpy as np
import pytest
from report_cases import trial_of

from benchmarks.trials import tracks
from benchmarks.trials.scores import groups_named, journey_scores
from benchmarks.trials.scoring import record
from benchmarks.trials.stage import Stage
from benchmarks.trials.trace import JourneyLog, Trace
from benchmarks.trials.tracks import FOUND, NEAR, RECOVERED_STEPS, Journey, way_driven
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.maps.map import metre

NEVER = math.inf
STRAIGHT = np.array([[0.0, 0, 0], [3, 0, 0], [3, 3, 1]])
ANYWHERE = {"prior.kind": "uniform"}
KIDNAP = ({"kind": "kidnap", "step": 40},)


def fixes(distance, angle=0.0, quality=math.nan, *, steps=None, count=None, stride=0.5):
    """Fixes of a run that drives ``stride`` metres a step."""
    off = np.array(distance, np.float64)
    at = np.arange(off.size) if steps is None else np.array(steps)
    return Journey(
        steps=at,
        truth=np.zeros((count or off.size, 3)),
        driven=stride * at,
        way=stride * at,
        distance=off,
        angle=np.broadcast_to(np.array(angle, np.float64), off.shape),
        quality=np.broadcast_to(np.array(quality, np.float64), off.shape),
    )


@pytest.mark.parametrize(
    ("distance", "metres", "lost_at"),
    [
        ([0, 0, 0, 0], 0.0, None),
        ([5, 5, 0.9, 1.0], 1.0, None),
        ([5, 0, 0, 5, 5, 0, 0, 0], 2.5, None),  # lost again: from where on it stays so
        ([0, 5, 0, 5, 1.001], NEVER, 3),  # to the end
        ([5, 5, 5], NEVER, 0),
    ],
)
def test_metres_to_localize_are_those_from_where_on_it_stays_localized(distance, metres, lost_at):
    run = fixes(distance)
    assert (run.metres_to_localize, run.lost_at) == (metres, lost_at)


def test_both_the_distance_and_the_angle_must_be_near():
    half_right = [[0.4, 0.6, 1.0, 1.1], np.radians([9, 9, 30, 0])]
    assert fixes(*half_right).localized("05m").tolist() == [True, False, False, False]
    assert fixes(*half_right).localized("1m").tolist() == [True, True, True, False]


def test_success_is_judged_in_every_step_of_the_last_quarter_and_in_no_other():
    assert fixes([9, 9, 9, 9, 9, 9, 0, 0]).success("1m") == 1
    assert fixes([0, 0, 0, 0, 0, 0, 9, 0]).success("1m") == 0
    # the reference of a log ends early: nothing is known of its last quarter
    assert math.isnan(fixes([0, 0], steps=[0, 1], count=8).success("1m"))


def test_a_commitment_is_false_above_one_half_and_beyond_two_metres():
    run = fixes([3, 3, 2, 3, 3], quality=[0.9, 0.5, 0.9, 0.51, math.nan])
    assert run.false.tolist() == [True, False, False, True, False]
    assert run.rated.tolist() == [False, True, True, True, False]  # nothing was seen at t = 0


def test_a_kidnapped_robot_is_found_where_twenty_good_steps_on_end_begin():
    bad, good = [9.0], [0.45]
    short = good * (RECOVERED_STEPS - 1)
    before = good * 10
    found = before + bad * 4 + short + bad + good * RECOVERED_STEPS + bad
    assert fixes(found).metres_to_recover(10) == 0.5 * (4 + len(short) + 1)
    assert fixes(before + bad * 4 + short).metres_to_recover(10) == NEVER
    assert fixes(before + good * 30).metres_to_recover(10) == 0
    assert fixes(before).metres_to_recover(10) == NEVER  # carried off in the last step


def test_the_way_is_what_was_commanded_and_a_metre_is_fifty_pixels():
    assert way_driven([[1.0, 9.0], [-2.0, 0.0]]).tolist() == [0, 1, 3]
    assert way_driven([[-2.0, 0.0, 9.0], [0.3, 0.4, 7.0]]).tolist() == [0, 2, 2.5]
    assert (metre("px"), metre("m")) == (50.0, 1.0)


def journey(truth=STRAIGHT, goal=(3.0, 3.2), planned=5.0, contacts=0, **parts):
    """A drive of 6 m that ends 0.2 m from its goal."""
    n = len(truth)
    return replace(
        fixes([0.0] * n),
        driven=np.linspace(0, 6, n),
        truth=np.array(truth, np.float64),
        collided=np.arange(n) < contacts,
        clearance=0.3,
        goal=np.array(goal),
        planned=planned,
        **parts,
    )


def driving(run):
    return journey_scores(run, groups_named(["driving"]))


def test_spl_is_the_planned_way_over_the_driven_one_of_a_success_and_0_of_a_failure():
    assert driving(journey())["spl"] == pytest.approx(5 / 6)
    assert driving(journey(planned=7.0))["spl"] == 1  # a shorter way than planned is not rewarded


def test_a_drive_succeeds_within_half_a_metre_of_its_goal_without_contact():
    assert driving(journey(goal=(3.0, 3.5)))["success"] == 1
    astray, bumped = driving(journey(goal=(3.0, 3.51))), driving(journey(contacts=2))
    assert (astray["success"], astray["spl"]) == (bumped["success"], bumped["spl"]) == (0, 0)
    assert (bumped["contacts"], bumped["time"]) == (2, 2)


def test_the_split_is_the_smaller_share_of_what_is_near_either_place():
    def split(*masses):
        late = np.array([[9.0, 9.0]] * 6 + [masses] * 2)
        run = replace(journey(np.zeros((8, 3))), masses=late)
        return journey_scores(run, groups_named(["ambiguity"]))["mass_split"]

    assert split(0.4, 0.4) == 0.5
    assert split(0.1, 0.3) == split(0.3, 0.1) == pytest.approx(0.25)
    assert split(0.9, 0.0) == 0
    assert math.isnan(split(0.0, 0.0))


def test_a_half_turn_is_found_where_the_map_has_one():
    square = [(0, 0), (8, 0), (8, 6), (0, 6)]
    even = PolygonMap(outer=square, obstacles=[[(3, 2), (5, 2), (5, 4), (3, 4)]], unit="m")
    odd = PolygonMap(outer=square, obstacles=[[(3, 2), (5, 2), (5, 4.2), (3, 4)]], unit="m")
    assert tracks.is_symmetric(even)
    assert not tracks.is_symmetric(odd)
    turned = tracks.half_turned(even, np.array([[1.0, 2.0, 0.5]]))
    assert turned[0] == pytest.approx([7, 4, 0.5 + math.pi])
    assert tracks.half_turned(even, turned)[0] == pytest.approx([1, 2, 0.5 + 2 * math.pi])


def test_near_a_pose_is_within_a_metre_and_thirty_degrees():
    poses = np.array([[0, 0, 0], [0.9, 0, 0.52], [1.1, 0, 0], [0, 0, 0.6], [0, 0, 6.2]])
    for unit in ("m", "px"):
        placed = poses * [metre(unit), metre(unit), 1]
        near = NEAR[FOUND](placed, np.zeros(3), unit=unit)
        assert near.tolist() == [True, True, False, False, True]


def trial(**parts):
    usual = {"scenario": "sharp", "lag": 0, "params": {"particles": 300}}
    return trial_of("mcl-map", 0, **usual | parts)


@pytest.mark.parametrize(
    ("parts", "about"),
    [
        ({}, []),
        ({"assumed": ANYWHERE}, ["lost", "ambiguity"]),  # the paper's room has a half turn
        ({"disturbance": KIDNAP}, ["recovery"]),
        ({"assumed": ANYWHERE, "disturbance": KIDNAP}, ["lost", "ambiguity", "recovery"]),
        ({"scenario": "guided-estimate"}, []),  # a lap has no goal
    ],
)
def test_a_trial_has_the_scores_that_its_parts_are_about_and_no_others(parts, about):
    assert [group.name for group in Stage.of(trial(**parts)).groups] == about


def test_a_filter_that_begins_with_the_truth_localizes_at_once_and_succeeds():
    known = trial(assumed={"prior.sd_heading": 0.0, "prior.sd_position": 0.0})
    stage, groups = Stage.of(known), groups_named(["lost"])
    trace = Trace(stage.moments(), (0,), stage.task, JourneyLog(stage.task, groups))
    kept = record(trace).journey
    nothing = dict.fromkeys(("metres_to_localize", "false_commitment", "false_steps"), 0)
    assert kept.scores == nothing | {"success_1m": 1, "success_05m": 1}
    assert [len(curve) for curve in kept.curves.values()] == [205] * 3
    assert kept.curves["way"][-1] == pytest.approx(0.1 * 180)  # 180 drives of 5 px, 24 turns


def test_the_run_of_a_kidnapped_robot_is_scored_from_where_it_was_carried_to():
    stage = Stage.of(trial(disturbance=KIDNAP))
    trace = stage.trace()
    log, run = trace.whole, trace.whole.journey(trace)
    assert run.carried == 40
    assert np.hypot(*(run.truth[40] - run.truth[39])[:2]) > 0.5
    assert run.distance[:40].max() < 0.45 < run.distance[40]
    assert journey_scores(run, log.groups)["recovered"] in (0, 1)
