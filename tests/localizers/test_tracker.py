"""A tracker is the replay of its log, whatever order, rate and faults its messages have."""

import math
import resource
import sys
from dataclasses import replace

import numpy as np
import pytest
from drives import recorded_in_a_hall
from refusals import refused

from benchmarks.setup.names import make_agent
from benchmarks.trials.episode import moments
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.logs.motion import composed, dead_reckoned, relative
from localizers import GaussianPrior, PointsBelief, RobotModel, Tracker, best_cluster, make

NEAR = (0.2, math.radians(5))
ALL = (0.0, 0.0)


@pytest.fixture(scope="module")
def lap():
    return recorded_in_a_hall(steps=60)


def start(log):
    return GaussianPrior(mean=tuple(log.reference[0]), sd_position=0.1, sd_heading=0.05)


def tracker_of(lap, name="mcl", every=NEAR, **params):
    hall, log = lap
    robot = RobotModel(floor_plan=hall, lidar=log.scanner)
    localizer = make(name, robot, **(params or {"particles": 200}))
    return Tracker(localizer, np.random.default_rng(5), every=every)


def messages(log):
    for record in log:
        yield "odometry", record.time, record.odometry
        yield "scan", record.time, record.ranges


def fed(tracker, given):
    found = []
    for kind, time, value in given:
        if getattr(tracker, kind)(time, value):
            found.append(tracker.at(time))
    return found


def begun(tracker, log):
    tracker.initialpose(start(log), log.times[0])
    return tracker


class Follows:
    def reset(self, prior, plan, rng):
        self.pose = np.array(prior.mean)
        return PointsBelief(np.array([self.pose, self.pose + 0.1]))

    def update(self, ranges, action, plan):
        self.pose = dead_reckoned(action[None], self.pose)[1]
        return PointsBelief(np.array([self.pose, self.pose + 0.1]))


def follower(**params):
    """A tracker of it that starts at (1, 2, 0) with the first odometry."""
    tracker = Tracker(Follows(), np.random.default_rng(0), **params)
    tracker.initialpose(GaussianPrior(mean=(1.0, 2.0, 0.0), sd_position=0.1))
    return tracker


@pytest.mark.parametrize(
    ("name", "params"),
    [("mcl", {"particles": 200}), ("amcl", {"max_particles": 300, "min_particles": 100})],
)
def test_a_log_fed_message_by_message_gives_the_beliefs_of_its_replay(lap, name, params):
    hall, log = lap
    env = LogEnv(log=log, every=NEAR, map=hall)  # its plan is none of their business
    robot, rng = RobotModel(floor_plan=hall, lidar=env.lidar), np.random.default_rng(5)
    agent, localizer = make_agent("open-loop", robot), make(name, robot, **params)
    run = moments(env, agent, localizer, lambda: start(log), rng, seed=0)
    replayed = [moment.belief.points() for moment in run][1:]
    found = fed(begun(tracker_of(lap, name, **params), log), messages(log))
    assert len(found) == len(replayed) > 10
    for ours, (poses, weights) in zip(found, replayed, strict=True):
        # carried on by nothing, headings wrapped
        np.testing.assert_array_equal(ours.poses[:, :2], poses[:, :2].astype(np.float64))
        np.testing.assert_array_equal(ours.weights, weights)
        apart = np.remainder(ours.poses[:, 2] - poses[:, 2] + np.pi, 2 * np.pi) - np.pi
        np.testing.assert_allclose(apart, 0, atol=1e-12)


def estimates(lap, given, **counted):
    """The last estimate of a tracker that was given messages, if it counted as it should."""
    tracker = begun(tracker_of(lap), lap[1])
    fed(tracker, given)
    assert {name: getattr(tracker.counts, name) for name in counted} == counted
    return tracker.at()


def same(one, other, within=0.0):
    np.testing.assert_allclose(one.poses, other.poses, rtol=0, atol=within)
    np.testing.assert_allclose(one.weights, other.weights, rtol=0, atol=within)


def test_scans_wait_for_late_odometry_and_doubled_messages_change_nothing(lap):
    given = list(messages(lap[1]))
    plain = estimates(lap, given)
    scans_first = sorted(given, key=lambda one: (one[1], one[0] != "scan"))
    same(estimates(lap, scans_first), plain)
    doubled = [one for message in given for one in (message, message)]
    same(estimates(lap, doubled, late_odometry=61, late_scans=61), plain)
    odometry = [one for one in given if one[0] == "odometry"]
    scans = [one for one in given if one[0] == "scan"]
    # 8 scans arrive before any odometry of their time, the last of them first
    held = [one for k in range(0, 61, 8) for one in (*scans[k : k + 8][::-1], *odometry[k : k + 8])]
    same(estimates(lap, held, late_scans=0, crowded_scans=0), plain)


def test_a_late_message_is_left_out_and_a_missing_one_makes_the_next_step_longer(lap):
    given = list(messages(lap[1]))
    fewer = [one for one in given if one[0] == "odometry" or one[1] not in (10.0, 11.0, 30.0)]
    late = [*fewer, *(one for one in given if one[0] == "scan" and one[1] in (10.0, 11.0, 30.0))]
    plain = estimates(lap, fewer)
    same(estimates(lap, late, late_scans=3), plain)
    back = ("odometry", 59.5, (9.0, 9.0, 0.0))  # after that of 60 s
    same(estimates(lap, [*fewer, back], late_odometry=1), plain)


def test_in_a_gap_of_the_odometry_scans_are_left_out_and_the_motion_is_not_lost(lap):
    log = lap[1]
    moved = log.odometry
    tracker = begun(tracker_of(lap, every=ALL), log)
    fed(tracker, [one for one in messages(log) if one[0] == "scan" or not 20 < one[1] < 25])
    assert tracker.counts.scans_without_odometry == 4
    assert tracker.counts.updates == 60 - 4
    assert tracker.at().odometry == pytest.approx(moved[-1], abs=1e-9)


def test_more_than_ten_scans_do_not_wait(lap):
    tracker = begun(tracker_of(lap), lap[1])
    for record in list(lap[1])[:14]:
        tracker.scan(record.time, record.ranges)
    assert tracker.counts.crowded_scans == 4


@pytest.mark.parametrize("earlier", [0.0, 1e6])
def test_odometry_that_jumps_or_begins_anew_moves_the_belief_by_nothing(lap, earlier):
    log = lap[1]
    plain = estimates(lap, messages(log))
    elsewhere = composed(np.tile([7.0, -3.0, 2.0], (len(log), 1)), log.odometry)
    first = [one for one in messages(log) if one[1] <= 30]
    later = replace(log, times=log.times - earlier, odometry=elsewhere)
    given = [*first, *list(messages(later))[len(first) :]]
    # at the jump itself the motion of one message is lost: its scan is used all the same, but if
    # the clock was set back, which is known from the next message on
    jumps = {"clock_resets": int(earlier > 0), "odometry_jumps": int(not earlier)}
    jumps |= {"late_odometry": 0, "late_scans": int(earlier > 0)}
    found = estimates(lap, given, **jumps)
    reference = log.reference[-1]
    for one in (plain, found):
        assert math.hypot(*(np.array(one.pose) - reference)[:2]) < 0.3
    back = composed(np.array([found.map_to_odom]), np.array(found.odometry))[0]
    assert back == pytest.approx(found.pose, abs=1e-9)
    assert found.odometry == pytest.approx(given[-2][2], abs=1e-9)


def test_single_messages_of_long_ago_are_left_out_as_of_a_second_publisher_that_lags(lap):
    log = lap[1]
    plain = estimates(lap, messages(log))
    given = list(messages(log))
    lagging = [("odometry", time - 2.0, value) for kind, time, value in given if kind != "scan"]
    both = [one for k, old in enumerate(lagging) for one in (*given[2 * k : 2 * k + 2], old)]
    same(estimates(lap, both, late_odometry=61, clock_resets=0), plain)


def test_before_a_jump_of_the_odometry_an_estimate_has_that_of_its_time():
    tracker = follower()
    for time, x in ((0.0, 5.0), (0.5, 5.1), (1.0, 0.0), (1.5, 0.1)):
        tracker.odometry(time, (x, 0.0, 0.0))
    assert tracker.counts.odometry_jumps == 1
    assert tracker.at(0.5).odometry == pytest.approx((5.1, 0.0, 0.0))
    assert tracker.at().odometry == pytest.approx((0.1, 0.0, 0.0))
    # of a cloud with two headings the mean moves a little less than the odometry
    before = tracker.at(0.0).map_to_odom
    assert tracker.at(0.5).map_to_odom == pytest.approx(before, abs=1e-3)
    assert tracker.at().map_to_odom[0] - before[0] > 4


def test_after_a_long_stop_what_was_believed_before_is_remembered():
    tracker = follower()
    for step in range(601):
        tracker.odometry(0.1 * step, (0.0, 0.0, 0.0))
        tracker.scan(0.1 * step, np.ones(3, np.float32))
    before = tracker.at(59.9)
    tracker.odometry(60.2, (0.3, 0.0, 0.0))
    assert tracker.scan(60.2, np.ones(3, np.float32))
    same(tracker.at(59.9), before)


def test_a_start_that_waits_begins_by_a_clock_that_was_set_back():
    tracker = Tracker(Follows(), np.random.default_rng(0))
    tracker.odometry(1000.0, (0.0, 0.0, 0.0))
    prior = GaussianPrior(mean=(1.0, 2.0, 0.0), sd_position=0.1)
    assert not tracker.initialpose(prior, 1001.0)
    tracker.odometry(0.0, (0.0, 0.0, 0.0))
    tracker.odometry(0.1, (0.0, 0.0, 0.0))
    assert tracker.counts.clock_resets == 1
    assert tracker.at() is not None


def test_a_jump_at_the_message_that_tells_that_the_clock_was_set_back_is_seen():
    tracker = follower()
    for time, x in ((1000.0, 0.0), (0.0, 0.0), (0.1, 7.0)):
        tracker.odometry(time, (x, 0.0, 0.0))
    assert (tracker.counts.clock_resets, tracker.counts.odometry_jumps) == (1, 1)
    assert tracker.at().pose[0] == pytest.approx(1.0, abs=0.1)


def test_an_estimate_is_carried_on_by_the_odometry_and_looks_back_as_far_as_it_remembers(lap):
    log = lap[1]
    tracker = begun(tracker_of(lap), log)
    fed(tracker, messages(log))
    for time in (52.25, 55.0, 59.75):
        found = tracker.at(time)
        before, after = log.odometry[int(time)], log.odometry[math.ceil(time)]
        x = np.interp(time % 1, [0, 1], [before[0], after[0]])
        assert found.odometry[0] == pytest.approx(x)
        assert found.time == time
    alone = begun(tracker_of(lap), log)
    fed(alone, [one for one in messages(log) if one[1] <= 55])
    same(alone.at(), tracker.at(55.0))  # nothing of what came later
    assert tracker.at(70.0).time == 60.0
    assert tracker.at(40.0) is None


def test_a_start_waits_for_its_odometry_and_a_new_one_begins_anew(lap):
    log = lap[1]
    tracker = tracker_of(lap)
    assert tracker.at() is None
    assert not tracker.initialpose(start(log), log.times[3])
    first = list(messages(log))
    fed(tracker, first[:6])
    assert tracker.at() is None
    assert tracker.counts.scans_before_start == 3
    fed(tracker, first[6:])
    assert tracker.counts.updates > 10
    other = GaussianPrior(mean=(3.0, 1.0, 0.5), sd_position=1e-6, sd_heading=0.0)
    assert tracker.initialpose(other)
    assert tracker.at().pose == pytest.approx((3.0, 1.0, 0.5), abs=1e-4)


def test_pose_and_covariance_are_those_of_the_cloud():
    tracker = Tracker(Follows(), np.random.default_rng(0))
    tracker.odometry(0.0, (5.0, 5.0, 1.0))
    tracker.initialpose(GaussianPrior(mean=(1.0, 2.0, 3.1), sd_position=0.1))
    found = tracker.at()
    poses = np.array([[1.0, 2.0, 3.1], [1.1, 2.1, 3.2]])
    assert found.pose == pytest.approx(best_cluster(poses, np.full(2, 0.5), unit="m").mean)
    np.testing.assert_allclose(found.covariance, np.full((3, 3), 0.0025), rtol=1e-6)
    assert found.quality is None


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"every": (0.1,)}, ("every is (0.1,)", "two numbers")),
        ({"fastest": (1.0, float("nan"))}, ("second of fastest",)),
        ({"memory": 0.0}, ("memory",)),
        ({"unit": "cm"}, ("unit", "cm")),
    ],
)
def test_a_tracker_that_cannot_be_is_refused(given, words):
    with refused(*words):
        Tracker(Follows(), np.random.default_rng(0), **given)


def test_messages_that_are_no_numbers_are_counted_and_of_another_shape_refused():
    tracker = Tracker(Follows(), np.random.default_rng(0))
    assert not tracker.odometry(math.nan, (0, 0, 0))
    assert not tracker.odometry(0.0, (0, math.inf, 0))
    assert not tracker.scan(math.inf, np.ones(3))
    assert tracker.counts.unusable == 3
    with refused("shape (2,)", "(x, y, θ)"):
        tracker.odometry(0.0, (0.0, 1.0))


@pytest.mark.slow
def test_a_million_updates_take_no_more_memory_than_a_hundred_thousand():
    tracker = follower(every=ALL)
    ranges, most = np.ones(60, np.float32), 0
    for step in range(1_000_001):
        angle = 1e-3 * step
        tracker.odometry(0.05 * step, (math.cos(angle), math.sin(angle), angle))
        tracker.scan(0.05 * step, ranges)
        if step == 100_000:
            most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert tracker.counts.updates == 1_000_000
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - most
    # 1 byte an update would be 900 kB; Linux counts in kB, macOS in bytes
    assert grown * (1 if sys.platform == "darwin" else 1024) < 1e6
    off = relative(np.array([tracker.at().pose]), tracker.at().poses[:1])
    assert np.abs(off).max() < 0.2
