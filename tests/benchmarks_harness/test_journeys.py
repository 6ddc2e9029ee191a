"""Scores of whole runs: of hand-made ones, and of filters whose answer is known."""

import math
from itertools import islice

import numpy as np
import pytest
from test_fixes import fixes

from benchmarks.setup.changes import Changes
from benchmarks.setup.names import scenario
from benchmarks.trials.episode import moments
from benchmarks.trials.journey_log import JourneyLog
from benchmarks.trials.journeys import (
    GROUPS,
    Journey,
    groups_named,
    half_turned,
    is_symmetric,
    scores_of,
    weight_near,
)
from benchmarks.trials.scoring import record
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from benchmarks.trials.trace import trace_of
from deqmcl_gym.maps import PolygonMap
from localizers import make

STRAIGHT = np.array([[0.0, 0, 0], [3, 0, 0], [3, 3, 1]])


def journey(truth=STRAIGHT, goal=(3.0, 3.2), planned=5.0, contacts=0, **parts):
    """A drive of 6 m that ends 0.2 m from its goal."""
    n = len(truth)
    return Journey(
        fixes=fixes([0.0] * n),
        driven=np.linspace(0, 6, n),
        truth=np.array(truth, np.float64),
        collided=np.arange(n) < contacts,
        clearance=0.3,
        goal=np.array(goal),
        planned=planned,
        **parts,
    )


def driving(run):
    return scores_of(run, groups_named(["driving"]))


def test_spl_is_the_planned_way_over_the_driven_one_of_a_success_and_0_of_a_failure():
    assert driving(journey())["spl"] == pytest.approx(5 / 6)
    assert driving(journey(planned=7.0))["spl"] == 1  # a shorter way than planned is not rewarded
    assert driving(journey(contacts=1))["spl"] == 0
    assert driving(journey(goal=(3.0, 3.51)))["spl"] == 0


def test_a_drive_succeeds_within_half_a_metre_of_its_goal_without_contact():
    assert driving(journey(goal=(3.0, 3.5)))["success"] == 1
    assert driving(journey(goal=(3.0, 3.51)))["success"] == 0
    found = driving(journey(contacts=2))
    assert (found["success"], found["contacts"], found["time"]) == (0, 2, 2)


def test_the_robot_was_carried_off_where_it_moved_farthest_beyond_its_command():
    truth = np.zeros((6, 3))
    truth[:, 0] = [0, 5, 10, 10.5, 2, 2.5]  # 5 m by command, then 0.5; carried 8.5 m back at 4
    run = journey(truth)
    assert Journey(**vars(run) | {"driven": np.array([0, 5, 10, 10.5, 11, 11.5])}).carried == 4


def test_the_split_is_the_smaller_share_of_what_is_near_either_place():
    def split(*masses):
        late = np.array([[9.0, 9.0]] * 6 + [masses] * 2)
        run = Journey(**vars(journey(np.zeros((8, 3)))) | {"masses": late})
        return scores_of(run, groups_named(["ambiguity"]))["mass_split"]

    assert split(0.4, 0.4) == 0.5
    assert split(0.1, 0.3) == split(0.3, 0.1) == pytest.approx(0.25)
    assert split(0.9, 0.0) == 0
    assert math.isnan(split(0.0, 0.0))


def test_every_score_says_how_a_failed_run_counts_if_methods_are_compared_by_it():
    tested = [score for group in GROUPS for score in group.scores if score.tested]
    assert {score.name: score.failed for score in tested} == {
        "success_1m": 0,
        "metres_to_localize": math.inf,
        "recovered": 0,
        "metres_to_recover": math.inf,
        "success": 0,
    }


def test_a_half_turn_is_found_where_the_map_has_one():
    square = [(0, 0), (8, 0), (8, 6), (0, 6)]
    even = PolygonMap(outer=square, obstacles=[[(3, 2), (5, 2), (5, 4), (3, 4)]], unit="m")
    odd = PolygonMap(outer=square, obstacles=[[(3, 2), (5, 2), (5, 4.2), (3, 4)]], unit="m")
    assert is_symmetric(even)
    assert not is_symmetric(odd)
    turned = half_turned(even, np.array([[1.0, 2.0, 0.5]]))
    assert turned[0] == pytest.approx([7, 4, 0.5 + math.pi])
    assert half_turned(even, turned)[0] == pytest.approx([1, 2, 0.5 + 2 * math.pi])


def test_weight_near_a_pose_is_within_a_metre_and_thirty_degrees():
    poses = np.array([[0, 0, 0], [0.9, 0, math.pi / 6], [1.1, 0, 0], [0, 0, 0.6], [0, 0, 6.2]])
    assert weight_near(poses, np.array([1, 2, 4, 8, 16.0]), np.zeros(3), 1.0) == 1 + 2 + 16
    assert weight_near(poses, np.array([1, 2, 4, 8, 16.0]), np.zeros(3), 2.0) == 1 + 2 + 4 + 16


def trial(**parts):
    given = {"scenario": "sharp", "localizer": "mcl-map", "lag": 0, "seed": 0, "trial": 0}
    return Trial(**given | {"params": Changes({"particles": 300})} | parts)


ANYWHERE = (("prior.kind", "uniform"),)
KIDNAP = (Changes({"kind": "kidnap", "step": 40}),)


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
    known = trial(assumed=(("prior.sd_heading", 0.0), ("prior.sd_position", 0.0)))
    stage, groups = Stage.of(known), groups_named(["lost"])
    kept = record(
        trace_of(stage.moments(), (0,), stage.task, groups), 0, scenario("sharp").thresholds
    ).journey
    assert kept.scores == {
        "success_1m": 1,
        "success_05m": 1,
        "metres_to_localize": 0,
        "false_commitment": 0,
        "false_steps": 0,
    }
    assert [len(curve) for curve in kept.curves.values()] == [205] * 3
    assert kept.curves["way"][-1] == pytest.approx(0.1 * 180)  # 180 drives of 5 px, 24 turns


class TwoPlaces:
    """A cloud at the start of a course and, as likely, at its twin under a half turn."""

    mean = None

    def __init__(self, room):
        self._room = room

    def sample(self, n, rng):
        poses = np.array(self._room.course.start) + rng.normal(0, (5, 5, 0.05), (n, 3))
        poses[::2] = half_turned(self._room.floor_plan, poses[::2])
        return poses


def test_where_two_places_fit_a_filter_that_does_not_see_the_plan_stays_split_between_them():
    setup = scenario("sharp").changed({"lidar.sigma": 40.0}, {"scan.sigma": 40.0})
    steps, particles, seeds = 20, 2000, 6
    room = setup.room()
    shares = []
    for seed in range(seeds):
        localizer = make("mcl-map", setup.robot_model(room), particles=particles)
        log = JourneyLog(Stage.of(trial()).task, groups_named(["lost", "ambiguity"]))
        rng = np.random.default_rng(seed)
        episode = moments(room, OpenLoop(), localizer, lambda: TwoPlaces(room), rng, seed=1)
        for moment in islice(episode, steps + 1):
            log.see(moment)
        masses = log.journey().masses[-1]
        assert masses.sum() > 0.9
        shares.append(masses[0] / masses.sum())
    # Each resampling of N particles adds at most ¼ / N to the variance of a share near ½.
    sd = math.sqrt(0.25 * steps / particles)
    assert abs(np.mean(shares) - 0.5) < 4 * sd / math.sqrt(seeds)  # by chance in 1 of 16,000
    assert max(abs(share - 0.5) for share in shares) < 5 * sd


class OpenLoop:
    """Carries out the plan."""

    def plan_at_reset(self, info):
        return None

    def act(self, belief, info):
        return info["planned_actions"][0], None


def test_the_run_of_a_kidnapped_robot_is_scored_from_where_it_was_carried_to():
    stage = Stage.of(trial(disturbance=KIDNAP))
    log = JourneyLog(stage.task, stage.groups)
    for moment in stage.moments():
        log.see(moment)
    run = log.journey()
    assert run.carried == 40
    assert np.hypot(*(run.truth[40] - run.truth[39])[:2]) > 0.5
    assert run.fixes.distance[:40].max() < 0.45 < run.fixes.distance[40]
    assert log.scored().scores["recovered"] in (0, 1)
