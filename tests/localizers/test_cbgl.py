"""``cbgl``: the error of a pose, the matcher, and the fix from a single scan."""

import math
from dataclasses import replace

import numpy as np
import pytest
from following import STILL, follow, robot_of, same, wrapped

import localizers
from deqmcl_gym.maps import Lidar
from deqmcl_gym.maps.office import Office
from localizers.methods.cbgl import AbsoluteError
from localizers.models.scan import Scan

RNG = np.random.default_rng
STAY = np.zeros(2)
NO_PLAN = np.empty((0, 2))


@pytest.fixture(scope="module")
def office() -> localizers.RobotModel:
    lidar = Lidar(beams=16, field_of_view=2 * math.pi * 15 / 16, max_range=6.0)
    robot = robot_of(Office(seed=3, wings=1, corridors=1).grid, lidar, (0.1, 0.1, 0.05), sigma=0.1)
    return replace(robot, motion=STILL)


@pytest.fixture(scope="module")
def anywhere(office) -> localizers.UniformPrior:
    return localizers.UniformPrior(floor_plan=office.floor_plan, radius=office.radius)


def error_of(robot) -> AbsoluteError:
    return AbsoluteError(floor_plan=robot.floor_plan, lidar=robot.lidar, radius=robot.radius)


def seen_from(robot, pose, missing=()) -> Scan:
    ranges = np.fmin(robot.floor_plan.ranges(pose[None], robot.lidar.bearings)[0], 6.0)
    ranges[list(missing)] = np.nan
    return Scan.of(ranges.astype(np.float64), robot.lidar.max_range)


def test_the_error_is_the_sum_over_usable_beams_and_inf_where_the_robot_does_not_fit(office):
    plan, (low, high) = office.floor_plan, np.reshape(office.floor_plan.bounds, (2, 2))
    places, headings = RNG(0).uniform(low - 1, high + 1, (9000, 2)), RNG(1).normal(size=9000)
    poses = np.column_stack([places, headings])
    poses = poses.astype(np.float32)
    scan = seen_from(office, np.array([*plan.placed([(60, 60)])[0], 0.3]), missing=(2, 5))
    found = error_of(office)(poses.T, scan)
    free = plan.free(poses, office.radius)
    assert 0.1 < free.mean() < 0.9
    assert np.array_equal(np.isinf(found), ~free)
    for i in np.flatnonzero(free)[::200]:
        expected = plan.ranges(poses[i : i + 1], office.lidar.bearings)[0]
        both = zip(scan.ranges, expected, strict=True)
        own = sum(abs(o - min(float(e), 6.0)) for o, e in both if not math.isnan(o))
        assert found[i] == pytest.approx(own, abs=1e-4)  # float32 ranges


def test_matching_never_makes_the_error_larger_and_ends_where_no_small_step_helps(office, anywhere):
    truth = anywhere.sample(1, RNG(1))[0]
    scan, error = seen_from(office, truth), error_of(office)
    begun = np.ascontiguousarray(anywhere.sample(200, RNG(2)).T, np.float32)
    before = begun.copy()
    poses, found = error.matched(begun, scan)
    assert np.array_equal(begun, before)
    assert np.array_equal(found, error(poses, scan))
    assert (found <= error(begun, scan)).all()
    finest = 0.5**6 * np.array([[0.5, 0, 0], [0, 0.5, 0], [0, 0, 0.2]])
    best = np.argsort(found)[:20]
    for step in np.vstack([finest, -finest]):
        ahead, left, turn = step
        x, y, heading = poses[:, best].astype(np.float64)
        cosine, sine = np.cos(heading), np.sin(heading)
        beside = np.array([x + ahead * cosine - left * sine, y + ahead * sine + left * cosine,
                           heading + turn], np.float32)  # fmt: skip
        assert (error(beside, scan) >= found[best] - 1e-4).all()


def test_one_scan_without_noise_finds_the_robot_in_a_building(office, anywhere):
    found = 0
    for world in range(10):
        truth = anywhere.sample(1, RNG((5, world)))[0]
        localizer = localizers.make("cbgl", office, particles=200, poses=20_000)
        localizer.reset(anywhere, NO_PLAN, RNG(world))
        belief = localizer.update(seen_from(office, truth).ranges, STAY, NO_PLAN)
        x, y, heading = localizers.mean_pose(*belief.points())
        near = math.hypot(x - truth[0], y - truth[1]) < 0.1
        found += near and abs(wrapped(heading - truth[2])) < 0.1
    assert found >= 7  # rooms may be alike; a pose so near the truth is drawn once in 10⁵ draws


def test_until_a_scan_has_a_usable_beam_the_belief_is_of_moved_hypotheses(office, anywhere):
    localizer = localizers.make("cbgl", office, particles=50, poses=700)
    start = localizer.reset(anywhere, NO_PLAN, RNG(0)).points()[0]
    blind = localizer.update(np.full(16, np.nan), [0.5, 0.1], NO_PLAN)
    moved = office.motion.sample(np.ascontiguousarray(start.T), np.array([0.5, 0.0, 0.1]), RNG(0))
    assert np.array_equal(blind.points()[0], moved.T)
    assert blind.events.blind_scans == 1
    sees = localizer.update(np.full(16, 2.0), STAY, NO_PLAN)
    assert len(sees.points()[0]) == 50


def test_after_the_fix_it_is_the_tracker(office, anywhere):
    localizer = localizers.make("cbgl", office, particles=80, poses=2000)
    scan = seen_from(office, anywhere.sample(1, RNG(1))[0]).ranges
    beliefs = follow(localizer, anywhere, (np.tile([0.1, 0.0], (4, 1)), np.tile(scan, (4, 1))))
    tracker, rng = localizer.filter.tracker, RNG(0)
    belief = localizer.filter.initial(anywhere, np.empty((0, 3)), rng)
    told = Scan.of(scan, office.lidar.max_range)
    for step in range(1, 5):
        advance = (localizer.filter if step == 1 else tracker).step
        belief = advance(belief, told, np.array([0.1, 0.0, 0.0]), np.empty((0, 3)), rng)
        assert same([belief], [beliefs[step]], offsets=(0,))


def test_the_fix_is_weighed_by_the_scan_and_its_evidence_is_of_the_hypotheses(office, anywhere):
    scan = seen_from(office, anywhere.sample(1, RNG(1))[0])
    fix = localizers.make("cbgl", office, particles=90, poses=256, matched=5, modes=3).filter
    rng = RNG(0)
    start = fix.initial(anywhere, np.empty((0, 3)), rng)
    belief = fix.step(start, scan, np.zeros(3), np.empty((0, 3)), rng)
    model = office.scan_model()
    weights = np.exp(model.log_likelihood(belief.present, scan))
    assert belief.weights == pytest.approx(weights / weights.sum(), rel=1e-9)
    before = np.exp(model.log_likelihood(start.present, scan)).mean()
    assert belief.scan_log_evidence == pytest.approx(math.log(before), rel=1e-9)
    centres = fix.fixes(start.present, scan)
    for mode in range(3):  # a third of the particles around each: 30 of sd 0.25 m and 0.1 rad
        off = belief.present[:, mode::3] - centres[:, mode : mode + 1]
        assert np.sqrt(np.square(off).mean(axis=1)) == pytest.approx([0.25, 0.25, 0.1], rel=0.5)


def test_from_a_known_start_it_looks_only_there(office, anywhere):
    truth, other = anywhere.sample(2, RNG(1))
    known = localizers.GaussianPrior(mean=tuple(truth), sd_position=0.2, sd_heading=0.1)
    localizer = localizers.make("cbgl", office, particles=100, poses=500)
    localizer.reset(known, NO_PLAN, RNG(0))
    belief = localizer.update(seen_from(office, other).ranges, STAY, NO_PLAN)
    x, y, _ = localizers.mean_pose(*belief.points())
    assert math.hypot(x - truth[0], y - truth[1]) < 2.0 < math.hypot(*(truth - other)[:2])
