"""What must be the same number for number: members of the family, a room in px and in metres."""

import math
from dataclasses import replace

import numpy as np
import pytest
from following import follow, robot_of, same, small, varied

import localizers
from deqmcl_gym.logs.motion import dead_reckoned
from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.maps.map import scaled
from localizers.models.scan import LidarScan, Scan

PAST, BOTH = range(-6, 1), range(-6, 7)
LAG, WITHOUT_G_AND_FUTURE = {"lag": 5}, {"future": 0, "feasibility": None}
TAKEN = {name: localizers.parameters(name) or () for name in localizers.names()}
CHARGES = {name: [b for b in ("beta", "plan_beta") if b in taken] for name, taken in TAKEN.items()}
M = 0.02  # to the px
STEPS = 48
# float32 weights differ by 1e-6: means are CLOSE until resampling takes another particle, before
# step EARLY never with these seeds; then half a standard deviation is allowed. Of amcl one: where
# KLD-sampling takes a particle more, all later draws are others.
EARLY, CLOSE = 10, 0.001  # steps, px


@pytest.mark.parametrize(
    ("name", "params", "parts", "other", "others", "offsets"),
    [
        ("mcl-smoother", {"lag": 0}, {}, "mcl", {}, PAST),
        *[("mcl-smoother", {"lag": lag}, {}, "mcl", {}, [0]) for lag in (1, 5, 20)],
        *[("mcl-map-smoother", {"lag": lag}, {}, "mcl-map", {}, [0]) for lag in (0, 5)],
        ("deq-mcl", LAG, WITHOUT_G_AND_FUTURE, "mcl-smoother", LAG, BOTH),
        ("deq-mcl", LAG, {"future": 0}, "mcl-map-smoother", LAG, BOTH),
        ("deq-mcl", {"lag": 0}, {}, "mcl-map", {}, BOTH),
        # the past that is kept does not touch the present and the future
        ("deq-mcl", LAG, {"past": 0}, "deq-mcl", LAG, range(7)),
    ],
    ids=str,
)
def test_it_is_the_other_method(make, prior, drive, name, params, parts, other, others, offsets):
    one = follow(varied(make(name, **params), **parts), prior, drive)
    assert same(one, follow(make(other, **others), prior, drive), offsets=offsets)


def test_beta_zero_is_g_one_also_where_the_future_is_redrawn(make, prior, drive):
    actions, scans = drive
    planned = actions + np.array([0.0, 0.1])
    plans = [planned[t:] for t in range(len(actions) + 1)]
    deq = make("deq-mcl", lag=4, beta=0.0)
    free = varied(deq, feasibility=None)
    one, other = (follow(f, prior, (actions, scans), plans=plans) for f in (deq, free))
    assert one[-1].events.replanned_steps > 0
    assert same(one, other, offsets=BOTH)


def test_never_resampled_weights_are_products_of_likelihoods(robot, prior, drive):
    never = localizers.make("mcl-smoother", robot, particles=60, lag=12, ess_threshold=0)
    last = follow(never, prior, drive)[-1]
    scan = LidarScan(floor_plan=robot.floor_plan, lidar=robot.lidar, beam=robot.scan)
    total = np.zeros(60)
    for s, ranges in enumerate(drive[1], start=1):  # each particle's own path
        total += scan.log_likelihood(last.points(s - 12)[0].T.copy(), Scan.of(ranges, 400.0))
    expected = np.exp(total - total.max())
    assert last.points()[1] == pytest.approx(expected / expected.sum(), rel=1e-9)
    assert last.log_evidence == pytest.approx(np.log(np.exp(total).mean()), rel=1e-9)


def test_two_localizers_do_not_disturb_each_other(robot, prior, drive):
    alone = follow(localizers.make("deq-mcl", robot, particles=60, lag=3), prior, drive)
    a, b = (localizers.make("deq-mcl", robot, particles=60, lag=3) for _ in range(2))
    actions, scans = drive
    beliefs = [a.reset(prior, actions, np.random.default_rng(0))]
    b.reset(prior, actions, np.random.default_rng(9))
    for t, (action, scan) in enumerate(zip(actions, scans, strict=True), start=1):
        b.update(scan, action, actions[t:])
        beliefs.append(a.update(scan, action, actions[t:]))
    assert same(alone, beliefs, offsets=BOTH)


@pytest.mark.parametrize("name", localizers.names())
def test_read_only_arrays_and_plain_lists_are_the_same(robot, prior, drive, name):
    actions, scans = (array.copy() for array in drive)
    actions.flags.writeable = scans.flags.writeable = False
    one, other = (localizers.make(name, robot, **small(name, 30)) for _ in range(2))
    lists = [actions[t:].tolist() for t in range(len(actions) + 1)]
    beliefs = follow(one, prior, (actions, scans))
    assert same(beliefs, follow(other, prior, (actions.tolist(), scans.tolist()), plans=lists))
    counts = {"dead-reckoning": {1}, "ekf": {512}, "grid": range(1, 9 * 10 * 12 + 1)}
    assert {len(belief.points()[0]) for belief in beliefs} <= set(counts.get(name, {30}))


def test_the_mean_pose_is_weighted_and_its_heading_a_mean_of_directions():
    poses = np.array([(1, 5, np.radians(179)), (3, 7, np.radians(-179))])
    x, y, heading = localizers.mean_pose(poses, np.array([0.75, 0.25]))
    assert (x, y) == (1.5, 5.5)
    s, c = np.sin(np.radians(179)), np.cos(np.radians(179))
    assert heading == pytest.approx(np.arctan2(0.5 * s, c))


@pytest.mark.parametrize("name", [name for name, charges in CHARGES.items() if charges])
def test_a_method_that_is_given_no_beta_has_that_of_the_robot(robot, prior, drive, name):
    some = {"start_draws": 4} if "start_draws" in localizers.parameters(name) else {}

    def run(assumed, **given):
        robots_own = replace(robot, beta=assumed)
        made = localizers.make(name, robots_own, **small(name, 60), **some, **given)
        return follow(made, prior, drive)

    mild, strict = (dict.fromkeys(CHARGES[name], beta) for beta in (0.7, 10.0))
    assert same(run(0.7), run(10.0, **mild))
    assert same(run(10.0), run(0.7, **strict))  # a β that is given is taken as it is
    assert not same(run(0.7), run(10.0))


def test_all_methods_start_from_the_same_cloud(robot, prior):
    clouds = [
        localizers.make(name, robot, particles=60).reset(prior, [], np.random.default_rng(3))
        for name in ("mcl", "mcl-map", "mcl-smoother", "deq-mcl")
    ]
    assert all(same([cloud], [clouds[0]]) for cloud in clouds)


@pytest.fixture(scope="module")
def lap(room):
    """A robot, a prior, actions round the block and what is seen on the way, in px."""
    lidar = Lidar(beams=4, field_of_view=2 * math.pi, max_range=400.0, sigma=10.0)
    robot = robot_of(room, lidar, (0.1, 0.1, 0.005), sigma=20.0)
    prior = localizers.GaussianPrior(mean=(50.0, 50.0, 0.0))
    actions = []
    for length in (250, 200, 250, 200):
        actions += [(20.0, 0.0)] * (length // 20 - 1)
        actions += [(length % 20 + 20.0, 0.0), (0.0, math.pi / 2)]
    poses = dead_reckoned(actions, prior.mean)
    exact = room.ranges(poses[1:], robot.lidar.bearings)
    scans = exact + np.random.default_rng(0).normal(0, 10.0, exact.shape)
    assert len(actions) == STEPS
    return robot, prior, np.array(actions), np.clip(scans, 0, 400).astype(np.float64)


def in_metres(robot, prior, actions, scans):
    plan = robot.floor_plan
    walls = [[(x * M, y * M) for x, y in polygon] for polygon in (plan.outer, *plan.obstacles)]
    there = localizers.RobotModel(
        floor_plan=PolygonMap(outer=walls[0], obstacles=walls[1:], unit="m"),
        lidar=scaled(robot.lidar, M),
        motion=scaled(robot.motion, M),
        scan=scaled(robot.scan, M),
    )
    assert there.radius == pytest.approx(8 * M)
    return there, scaled(prior, M), actions * (M, 1), scans * M


def history(name, robot, prior, actions, scans):
    """Beliefs along the lap, as mean positions and standard deviations at each step, (2,) each."""
    localizer = localizers.make(name, robot)
    for belief in follow(localizer, prior, (actions, scans)):
        poses, weights = belief.points()
        mean = np.array(localizers.mean_pose(poses, weights))[:2]
        yield mean, np.sqrt(weights @ np.square(poses[:, :2] - mean))


@pytest.mark.parametrize("name", localizers.names())
def test_a_room_in_metres_is_the_same_room(lap, name):
    others = 1.0 if name == "amcl" else 0.5
    runs = zip(history(name, *lap), history(name, *in_metres(*lap)), strict=True)
    for t, ((mean, spread), (in_m, _)) in enumerate(runs):
        allowed = CLOSE if t < EARLY else CLOSE + others * spread
        assert (np.abs(in_m / M - mean) <= allowed).all(), t
