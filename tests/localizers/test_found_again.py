"""A tracker says that it is lost, finds itself again, and gives up no belief that may be right."""

import math
from dataclasses import replace

import numpy as np
import pytest
from believing import Believes
from refusals import refused

import localizers
from deqmcl_gym import GridMap, Lidar
from deqmcl_gym.logs.motion import composed, dead_reckoned, relative
from localizers import GaussianPrior, PointsBelief, Relocalization, RobotModel, Tracker, make

LIDAR = Lidar(beams=60, field_of_view=math.pi, max_range=8.0)
CORNERS = [(1.0, 1.0), (10.0, 1.2), (11.0, 7.8), (6.5, 7.0), (6.2, 3.0), (1.2, 3.5), (1.5, 8.0)]
WALLS = (  # in cells: low, left, height, width
    *((40, 40, 8, 60), (30, 150, 80, 6), (110, 60, 6, 50), (90, 160, 6, 40), (130, 10, 20, 6)),
    *((50, 215, 30, 25), (0, 70, 8, 12), (0, 130, 8, 12), (170, 90, 8, 12), (172, 170, 8, 12)),
)
STEP = 0.2  # s


def hall():
    """12 m × 9 m with walls and pillars in it."""
    cells = np.zeros((180, 240), np.int8)
    for low, left, height, width in WALLS:
        cells[low : low + height, left : left + width] = 100
    return GridMap(occupancy=np.pad(cells, 1, constant_values=100), resolution=0.05)


@pytest.fixture(scope="module")
def drive():
    """Increments, true poses and scans of a robot that goes around the corners, 0.2 s apart."""
    rng, here, increments = np.random.default_rng(3), np.array([*CORNERS[0], 0.0]), []
    for corner in [*CORNERS[1:], *CORNERS[-2::-1]]:
        far = math.hypot(*(corner - here[:2]))
        turn = math.remainder(math.atan2(*(corner - here[:2])[::-1]) - here[2], 2 * math.pi)
        turns = math.ceil(abs(turn) / 0.3)
        increments += [(0.0, turn / turns)] * turns + [(0.2, 0.0)] * int(far / 0.2)
        here = dead_reckoned(increments, [*CORNERS[0], 0.0])[-1]
    truth = dead_reckoned(increments, [*CORNERS[0], 0.0])
    noisy = np.array(increments) * (1 + 0.03 * rng.standard_normal((len(increments), 2)))
    ranges = LIDAR.ranges(hall(), truth.T.astype(np.float32))
    ranges = ranges + 0.02 * rng.standard_normal(ranges.shape)
    return dead_reckoned(noisy), truth, np.where(ranges < 8, ranges, np.inf).astype(np.float32)


def tracker(seed=0, floor_plan=None, recovery=Relocalization(poses=20_000), **params):  # noqa: B008
    plan, scan = floor_plan or hall(), localizers.GaussianUniform(sigma=0.1, power=0.3)
    robot = RobotModel(floor_plan=plan, lidar=LIDAR, scan=scan)
    localizer = make("mcl", robot, particles=300)
    return Tracker(localizer, np.random.default_rng(seed), recovery=recovery, **params)


def fed(tracker, odometry, ranges, start, late=0.0):
    """Every estimate of a tracker that is fed with a way."""
    prior = GaussianPrior(mean=tuple(start), sd_position=0.1, sd_heading=0.05)
    tracker.initialpose(prior, 0.0)
    said = []
    for step, (pose, scan) in enumerate(zip(odometry, ranges, strict=True)):
        tracker.odometry(STEP * step, pose)
        tracker.scan(STEP * step + late, scan)
        said.append(tracker.at())
    return said


def off(estimate, truth):
    return math.hypot(*(np.array(estimate.pose) - truth)[:2])


@pytest.mark.parametrize(("i", "j"), [(30, 160), (125, 240), (215, 45)])
def test_a_robot_that_is_carried_away_says_so_and_is_found_again(drive, i, j):
    odometry, truth, ranges = drive
    moved = relative(odometry[[j]].repeat(len(odometry) - j, axis=0), odometry[j:])
    glued = np.vstack([odometry[:i], composed(odometry[[i]].repeat(len(moved), axis=0), moved)])
    there, seen = np.vstack([truth[:i], truth[j:]]), np.vstack([ranges[:i], ranges[j:]])
    alone, watched = tracker(recovery=None), tracker()
    lost = fed(alone, glued[: i + 60], seen[: i + 60], truth[0])
    assert lost[-1].lost
    assert off(lost[-1], there[i + 59]) > 1
    assert not any(one.lost for one in lost[:i])
    found = fed(watched, glued[: i + 120], seen[: i + 120], truth[0])
    assert watched.counts.recoveries >= 1
    assert max(off(*both) for both in zip(found[i + 90 :], there[i + 90 :], strict=False)) < 0.3
    assert not found[-1].lost


def test_a_wrong_initial_pose_is_mended(drive):
    odometry, truth, ranges = drive
    watched = tracker()
    said = fed(watched, odometry[:110], ranges[:110], truth[0] + [4.0, 3.0, 1.0])
    assert off(said[10], truth[10]) > 1
    assert watched.counts.recoveries >= 1
    assert off(said[-1], truth[109]) < 0.3


def test_a_belief_that_is_right_is_left_alone_bit_for_bit(drive):
    odometry, truth, ranges = drive
    watched = tracker()
    ours = fed(watched, odometry, ranges, truth[0])
    alone = fed(tracker(recovery=None), odometry, ranges, truth[0])
    assert watched.counts.recoveries == watched.counts.misdated_scans == 0
    assert not any(one.lost for one in ours)
    np.testing.assert_array_equal(ours[-1].poses, alone[-1].poses)


def test_where_the_map_is_wrong_no_belief_within_a_metre_is_replaced(drive):
    odometry, truth, ranges = drive
    cells = hall().occupancy.copy()
    cells[20:100, 100:160] = 0  # the map lacks the walls in the middle, and has others
    cells[70:74, 90:150] = cells[100:104, 100:150] = 100
    watched = tracker(floor_plan=replace(hall(), occupancy=cells))
    said = fed(watched, odometry, ranges, truth[0])
    away = np.array([off(*both) for both in zip(said, truth, strict=True)])
    begun = [k for k, one in enumerate(said) if one.agreement is None][5:]
    replaced = [k for k in begun if said[k - 1].agreement is not None]
    assert len(replaced) == watched.counts.recoveries > 0
    for k in replaced:
        assert away[k - 1] > 1
        assert away[k] < 0.3
    doubted = [k for k, one in enumerate(said) if (one.agreement or 1.0) < 0.8]
    assert sum(away[k] < 0.3 for k in doubted) > 10


def test_a_frozen_lidar_is_counted_and_says_nothing(drive):
    odometry, truth, ranges = drive
    stuck, blind = ranges[:80].copy(), ranges[:80].copy()
    stuck[30:55], blind[31:55] = ranges[30], np.nan
    frozen, unseen = tracker(), tracker()
    ours = fed(frozen, odometry[:80], stuck, truth[0])
    theirs = fed(unseen, odometry[:80], blind, truth[0])
    assert 10 < frozen.counts.frozen_scans < 25
    assert unseen.counts.frozen_scans == frozen.counts.recoveries == 0
    np.testing.assert_array_equal(ours[-1].poses, theirs[-1].poses)
    assert off(ours[-1], truth[79]) < 0.3


def test_scans_that_are_stamped_late_are_noticed(drive):
    odometry, truth, ranges = drive
    late = tracker()
    fed(late, odometry, ranges, truth[0], late=0.4)
    assert late.stamps_late_by == pytest.approx(0.4, abs=0.11)
    assert late.counts.misdated_scans > 0


def test_without_a_map_nothing_is_said_and_recovery_is_refused(drive):
    odometry, truth, ranges = drive
    plain = Believes(PointsBelief([(1.0, 1.0, 0.0)]))  # does not say for which robot it was made
    said = fed(Tracker(plain, np.random.default_rng(0)), odometry[:20], ranges[:20], truth[0])
    assert said[-1].agreement is None
    assert not said[-1].lost
    with refused("does not say for which robot"):
        Tracker(plain, np.random.default_rng(0), recovery=Relocalization())
    with refused("recovery.least"):
        Relocalization(least=1.5)
    with refused("lost_below"):
        tracker(lost_below=-0.1)
