"""What others compute is what ours do, so that the ratios compare like with like."""

import math

import numpy as np
import pytest
import reference

from benchmarks.studies.speed import numpy_baseline, peers
from benchmarks.studies.speed.numpy_baseline import NumpyModels
from benchmarks.studies.speed.rays import bearings_of, pymunk_queries
from benchmarks.studies.speed.work import fan, free_poses, pillared_room, recorded_lap
from deqmcl_gym.world.presets import PAPER_ROOM
from localizers import make
from localizers.inference.resampling import systematic
from localizers.models import motion as kernels
from localizers.models.scan import LidarScan, Scan

SINGLE = 2e-6  # rad: θ + b, sine and cosine in float32, |θ + b| ≤ 2π, are off by less
PARTICLES, RUNS, STEPS = 500, 12, 30


def numpy_ranges(caster, poses, beams):
    return caster(PAPER_ROOM)(np.ascontiguousarray(poses.T), bearings_of(beams)).T


def pymunk_ranges(poses, beams):
    return np.reshape(pymunk_queries(poses, bearings_of(beams))(), (len(poses), beams))


def navground_ranges(poses, beams):
    pytest.importorskip("navground.core")
    ranges = peers.navground(PAPER_ROOM, beams)
    return np.array([ranges(pose) for pose in poses.tolist()])


@pytest.mark.parametrize(
    ("cast", "beams", "turn", "slack"),
    [  # px: a product, a quotient and differences of coordinates to 350 or, the last two, to 1,000
        (lambda *rays: numpy_ranges(numpy_baseline.segments, *rays), 16, SINGLE, 5e-4),
        (lambda *rays: numpy_ranges(numpy_baseline.slabs, *rays), 16, SINGLE, 5e-4),
        (pymunk_ranges, 16, SINGLE, 1e-3),
        # it adds up the step between beams: each sum below 2π is off by 2.4e-7 rad at most
        (navground_ranges, 16, SINGLE + 16 * 2.4e-7, 1e-3),
        (navground_ranges, 360, SINGLE + 360 * 2.4e-7, 1e-3),
    ],
    ids=["NumPy", "NumPy slabs", "pymunk", "navground 16", "navground 360"],
)
def test_ranges_are_exact_within_a_turn_that_float32_cannot_resolve(cast, beams, turn, slack):
    poses = free_poses(PAPER_ROOM, 3_000)  # the NumPy baseline takes them in several blocks
    bearings = bearings_of(beams)
    around = [reference.ranges(PAPER_ROOM.walls, poses, bearings + s * turn) for s in (-1, 0, 1)]
    low, high = np.min(around, axis=0), np.max(around, axis=0)
    seen = cast(poses, beams)
    assert ((seen >= low - slack) & (seen <= high + slack)).all()
    assert np.median(high - low) < 0.02  # the bracket is narrow: the test can fail


def test_raycast2d_hits_pixels_that_the_same_beams_meet():
    pytest.importorskip("raycast2D")
    hits_at = peers.raycast2d(PAPER_ROOM, 16)
    poses, bearings = free_poses(PAPER_ROOM, 200, radius=2.0), fan(16).bearings
    poses[:, :2] = np.floor(poses[:, :2]) + 0.5  # pixels' centres: where it starts from
    for pose in poses:
        hits = hits_at(pose.tolist()) + 0.5
        # a wall within 1.5 px (a pixel's diagonal) of every hit
        points = np.column_stack([hits, np.zeros(len(hits))])
        assert (reference.clearance(PAPER_ROOM.walls, points, points) <= 1.5).all()
        # and it lies on the beam: ends rounded by half a pixel at 500 px, lines by half a pixel
        to_hit = hits - pose[:2]
        directions = pose[2] + bearings
        across = to_hit[:, 1] * np.cos(directions) - to_hit[:, 0] * np.sin(directions)
        assert (np.abs(across) <= 1.5).all()


@pytest.mark.parametrize("segments", [8, 16, 64, 512])
def test_the_pillared_room_has_as_many_walls_as_asked_for_and_pillars_apart(segments):
    room = pillared_room(segments)
    assert len(room.walls) == segments
    assert room.free(free_poses(room, 100)).all()
    corners = np.array(room.obstacles).reshape(-1, 2)
    assert ((corners > 0) & (corners < 400)).all()


def our_mcl(robot, particles, prior, rng):
    localizer = make("mcl", robot, particles=particles)
    localizer.reset(prior, recorded_lap().first, rng)
    return lambda *step: localizer.update(*step).points()


def estimates(mcl):
    """Mean (x, y, cos θ, sin θ) at the end of each of some runs along the lap."""
    lap, ends = recorded_lap(), []
    for seed in range(RUNS):
        np.random.seed(seed)  # noqa: NPY002 (peers draw from the global generator)
        update = mcl(lap.robot, PARTICLES, lap.prior, np.random.default_rng(seed))
        for step in lap.steps[:STEPS]:
            poses, weights = update(*step)
        x, y, heading = np.asarray(poses, dtype=float).T
        ends.append(np.average([x, y, np.cos(heading), np.sin(heading)], axis=1, weights=weights))
    return np.array(ends)


@pytest.fixture(scope="module")
def ours():
    return estimates(our_mcl)


@pytest.mark.parametrize("name", ["numpy_baseline", "particles", "pfilter", "stonesoup"])
def test_estimates_are_ours_within_their_scatter(name, ours):
    filtering = numpy_baseline.mcl
    if name != "numpy_baseline":
        pytest.importorskip(name)
        filtering = getattr(peers, name)
    theirs = estimates(filtering)
    error = np.sqrt((ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / RUNS)
    # Welch's t with some 15 to 22 degrees of freedom; |t| > 5 in 4 components: below 1 in 1,000
    assert (np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) < 5 * error).all()
    assert error[:2].max() < 2.0  # px: agreement means something


def test_log_likelihoods_are_ours_at_the_same_ranges_and_outside():
    lap, poses = recorded_lap(), free_poses(PAPER_ROOM, 3_000)
    measured = lap.steps[7][0]
    states = np.ascontiguousarray(poses.T)
    scan = LidarScan(floor_plan=PAPER_ROOM, lidar=lap.robot.lidar, beam=lap.robot.scan)
    expected = numpy_baseline.segments(PAPER_ROOM)(states, bearings_of(16))
    ours = scan.weighed(measured.astype(float), expected)
    models = NumpyModels(lap.robot)
    seen = models.log_likelihood(states, measured)
    assert np.abs(seen - ours).max() < 16 * 1e-5  # z²/2 ≤ 10 where the hit counts, in float32
    assert ours.std() > 1
    states[0] -= 400
    outside = models.log_likelihood(states, measured)
    seen = Scan.of(measured.astype(float), lap.robot.lidar.max_range)
    assert outside.tolist() == scan.log_likelihood(states, seen).tolist()


class Drawn:
    """The normal numbers that ``OdometryMotion`` makes of a seed, as NumPy's generator's."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)

    def standard_normal(self, size, dtype):
        out = np.empty(size, dtype)
        kernels.normal_pairs(self.rng.random(size[1]), 0.0, 1.0, 0.0, 1.0, out[0], out[1])
        return out


@pytest.mark.parametrize("action", [(5.0, 0.0), (0.0, 0.26), (-3.0, 3.0)])
def test_steps_are_those_of_the_motion_model_from_the_same_normal_numbers(action):
    robot = recorded_lap().robot
    states = np.ascontiguousarray(free_poses(PAPER_ROOM, 1_000).T)
    ours = robot.motion.sample(states, np.array(action), np.random.default_rng(3))
    apart = ours - NumpyModels(robot).moved(states, np.array(action), Drawn(3))
    apart[2] -= 2 * np.pi * np.rint(apart[2] / (2 * np.pi))
    assert np.abs(apart).max() < 2e-4  # float32 of coordinates up to 350 and of angles up to 6


@pytest.mark.parametrize("n", [1, 7, 1000])
def test_systematic_resampling_takes_the_same_ancestors(n):
    weights = np.random.default_rng(n).exponential(size=n) ** 6
    weights /= weights.sum()
    for seed in range(20):
        ours = systematic(weights, np.random.default_rng(seed))
        seen = numpy_baseline.systematic(weights, np.random.default_rng(seed))
        assert (ours == seen).all()


def test_the_recorded_lap_ends_where_it_starts():
    lap = recorded_lap()
    x, y, heading = lap.prior.mean
    for _, (distance, turn), _ in lap.steps:
        heading += turn
        x, y = x + distance * math.cos(heading), y + distance * math.sin(heading)
    assert math.hypot(x - lap.prior.mean[0], y - lap.prior.mean[1]) < 1e-2
    assert abs(heading - lap.prior.mean[2] - 2 * math.pi) < 1e-4
