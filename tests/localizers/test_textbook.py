"""grid against a recursion with whole transition matrices; mcl and grid against the textbook."""

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
import reference
from following import STILL, robot_of

import localizers
from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.validation import InputError
from localizers.methods import grid as method
from localizers.methods.grid import PoseGrid

OUTSIDE = -30.0  # of each usable beam
PARTICLES = 25
DRIVEN = [(20.0, 0.0), (20.0, 0.3), (25.0, -0.2), (30.0, 0.0), (15.0, 0.5)]
SEEN = [[270.0], [150.0], [230.0], [200.0], [90.0]]
BLOCK = [(23, 13), (38, 13), (38, 27), (23, 27)]
SMALL = PolygonMap(outer=[(0, 0), (60, 0), (60, 40), (0, 40)], obstacles=[BLOCK])
CELL, HEADINGS = 10.0, 8
ACTIONS = [(12.0, 0.3), (7.0, -0.9), (0.0, 2.0), (9.0, 0.0)]
SCANS = [[20.0, 31.0, 12.0], [15.0, math.nan, 40.0], [33.0, 8.0, -1.0], [10.0, 20.0, 30.0]]


def segments(polygon) -> np.ndarray:
    corners = np.array(polygon)
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def book_log_likelihood(robot, poses: np.ndarray, scan) -> np.ndarray:
    """Log Π over usable beams of (1 - u) N(o; ô, σ²) + u / r_max (section 6.3), (n,)."""
    plan, lidar, beam, measured = robot.floor_plan, robot.lidar, robot.scan, np.array(scan)
    usable = (measured >= 0) & (measured <= lidar.max_range)
    walls = np.vstack([segments(polygon) for polygon in (plan.outer, *plan.obstacles)])
    z = (measured - reference.ranges(walls, poses, lidar.bearings))[:, usable] / beam.sigma
    hit = np.exp(-0.5 * z**2) / (beam.sigma * math.sqrt(2 * math.pi))
    logs = np.log((1 - beam.uniform) * hit + beam.uniform / lidar.max_range).sum(axis=1)
    inside = reference.winding(segments(plan.outer), poses[:, :2]) != 0
    return np.where(inside, logs, OUTSIDE * usable.sum())


def book_mcl(robot, poses: np.ndarray, actions, scans, rng) -> list[tuple]:
    """Table 8.2: the weighted particles of each step, before the low variance sampler (4.4)."""
    motion, n, clouds = robot.motion, len(poses), []
    for (distance, turn), scan in zip(actions, scans, strict=True):
        sd = motion.turn * abs(turn) + motion.drift * abs(distance)
        heading = poses[:, 2] + rng.normal(turn, sd, n)
        driven = rng.normal(distance, motion.drive * abs(distance), n)
        x, y = poses[:, 0] + driven * np.cos(heading), poses[:, 1] + driven * np.sin(heading)
        poses = np.column_stack([x, y, heading])
        weights = np.exp(book_log_likelihood(robot, poses, scan))
        clouds.append((poses, weights))
        pointers = (rng.random() + np.arange(n)) / n * weights.sum()
        poses = poses[np.searchsorted(np.cumsum(weights), pointers).clip(max=n - 1)]
    return clouds


@pytest.fixture(scope="module")
def small() -> localizers.RobotModel:
    lidar = Lidar(beams=3, field_of_view=2.0, max_range=80.0)
    return robot_of(SMALL, lidar, (0.3, 0.4, 0.02), sigma=8.0)


def split(position: float) -> list[tuple[int, float]]:
    below = math.floor(position)
    return [(below, 1 - (position - below)), (below + 1, position - below)]


def normal_nodes(mean: float, sd: float, count: int = 1201) -> list[tuple[float, float]]:
    if sd == 0:
        return [(mean, 1.0)]
    z = np.linspace(-5, 5, count)
    weights = np.exp(-0.5 * z**2)
    return list(zip((mean + sd * z).tolist(), (weights / weights.sum()).tolist(), strict=True))


def transition(action, motion) -> np.ndarray:
    """Whole matrix (cells after, cells before), cell by cell: turn, then drive."""
    distance, turn = action
    sd_turn = motion.turn * abs(turn) + motion.drift * abs(distance)
    step, rows, columns = 2 * math.pi / HEADINGS, 4, 6
    turns = np.zeros((HEADINGS, HEADINGS))
    for h in range(HEADINGS):
        for angle, weight in normal_nodes(turn, sd_turn):
            for to, share in split(h + angle / step):
                turns[to % HEADINGS, h] += weight * share
    matrix = np.zeros((HEADINGS * rows * columns,) * 2)
    for h in range(HEADINGS):
        heading = -math.pi + h * step
        moves = np.zeros((21, 21))  # by (rows, columns), 10: none
        for d, weight in normal_nodes(distance, motion.drive * abs(distance)):
            for down, share in split(d * math.sin(heading) / CELL):
                for right, other in split(d * math.cos(heading) / CELL):
                    moves[10 + down, 10 + right] += weight * share * other
        for row in range(rows):
            for column in range(columns):
                for down, right in zip(*np.nonzero(moves), strict=True):
                    y, x = row + down - 10, column + right - 10
                    if 0 <= y < rows and 0 <= x < columns:
                        after = (h * rows + y) * columns + x
                        for before in range(HEADINGS):
                            here = (before * rows + row) * columns + column
                            matrix[after, here] += moves[down, right] * turns[h, before]
    return matrix


def test_the_grid_is_bayes_rule_with_whole_transition_matrices(small):
    prior = localizers.GaussianPrior(mean=(15, 12, 0.4), sd_position=9.0, sd_heading=0.8)
    localizer = localizers.make("grid", small, cell=CELL, headings=HEADINGS)
    belief = localizer.reset(prior, [], np.random.default_rng(0))
    mass = belief.mass.ravel()
    poses = belief.grid.centres().T.astype(float)
    for action, scan in zip(ACTIONS, SCANS, strict=True):
        likelihood = np.exp(book_log_likelihood(small, poses, scan))
        mass = likelihood * (transition(action, small.motion) @ mass)
        mass /= mass.sum()
        belief = localizer.update(scan, action, [])
        # Linear shares have kinks of slope 2 per cell, which the trapezoidal rule at steps h of
        # an eighth of a standard deviation s misses by h² / 8 · 2 · 0.4 / s = 1.6e-3 s at most, s
        # in cells: here below 0.05 … 0.6, so 1e-3 per step and axis, 4 steps x 3 axes. A ray that
        # passes a corner may take the other wall in float32: none here does.
        assert np.abs(belief.mass.ravel() - mass).max() < 1.2e-2 * mass.max()


def test_a_single_pose_goes_into_its_cell():
    grid = PoseGrid(bounds=(0, 0, 200, 200), cell=5.0, headings=72)
    single = localizers.GaussianPrior(mean=(103, 90, 1.0), sd_position=0.0, sd_heading=0.0)
    mass = method.prior_mass(grid, single)
    cell, axes = np.unravel_index(mass.argmax(), mass.shape), grid.axes
    assert mass[cell] == 1.0
    apart = np.abs([axis[k] for axis, k in zip(axes, cell, strict=True)] - np.array([1.0, 90, 103]))
    assert (apart <= (grid.heading_step / 2, 2.5, 2.5)).all()


def test_a_cell_of_one_standard_deviation_gets_the_integral_of_the_prior_over_it():
    cells = PoseGrid(bounds=(0, 0, 120, 120), cell=10.0, headings=36)
    mean = (63.0, 58.0, 1.0)
    prior = localizers.GaussianPrior(mean=mean, sd_position=10.0, sd_heading=cells.heading_step)
    centres = cells.centres().T.astype(float)
    exact = np.ones(len(centres))
    for axis, width in enumerate((10.0, 10.0, cells.heading_step)):
        z = (centres[:, axis] - mean[axis]) / width
        z = (z + 18) % 36 - 18 if axis == 2 else z
        exact *= [NormalDist().cdf(one + 0.5) - NormalDist().cdf(one - 0.5) for one in z]
    off = np.abs(method.prior_mass(cells, prior).reshape(-1) - exact)
    # two midpoints of h = ½ sd: f'' h² / 24 is 1 % of the density at its top, on each of three axes
    assert off.max() < 0.035 * exact.max()


def test_the_number_of_points_is_bounded_and_their_moments_stay(robot):
    wide = localizers.GaussianPrior(mean=(175, 50, 0.0), sd_position=80.0, sd_heading=1.0)
    belief = localizers.make("grid", robot).reset(wide, [], np.random.default_rng(0))
    poses, weights = belief.points()
    assert (belief.mass > method.LEAST_SHARE * belief.mass.max()).sum() > method.MOST_POINTS
    assert len(weights) <= method.MOST_POINTS
    assert weights.sum() == pytest.approx(1.0)
    headings, ys, xs = belief.grid.axes
    # one pointer stands for 1 / 20,000 of the mass: what it stands for lies within a row of cells,
    # so the mean is off by less than the room's width times rows cut / pointers
    for axis, centres, others in ((0, xs, (0, 1)), (1, ys, (0, 2)), (2, headings, (1, 2))):
        exact = (belief.mass.sum(axis=others) * centres).sum()
        width = centres[-1] - centres[0]
        assert abs((poses[:, axis] * weights).sum() - exact) < 0.005 * width


def test_driving_out_of_the_map_is_a_counted_collapse(robot, prior):
    localizer = localizers.make("grid", replace(robot, motion=STILL), cell=25.0, headings=12)
    before = localizer.reset(prior, [], np.random.default_rng(0))
    belief = localizer.update([math.nan], [1e9, 0.0], [])
    assert belief.events.weight_collapses == 1
    assert belief.mass == pytest.approx(before.mass)


def test_a_prior_that_is_nowhere_on_the_map_is_refused(robot):
    away = localizers.GaussianPrior(mean=(-1e6, 0, 0), sd_position=1.0)
    with pytest.raises(InputError, match="must lie on the floor plan"):
        localizers.make("grid", robot, cell=25.0).reset(away, [], np.random.default_rng(0))


def test_a_prior_that_underflows_far_away_is_taken_where_numpy_raises(robot):
    grid = localizers.make("grid", robot, cell=10.0)
    for sd in (6.0, 8.0, 10.0, 12.0):
        prior = localizers.GaussianPrior(mean=(175, 50, 0), sd_position=sd, sd_heading=0.1)
        with np.errstate(all="raise"):
            belief = grid.reset(prior, [], np.random.default_rng(0))
        assert belief.points()[1].sum() == pytest.approx(1)


def summary(poses: np.ndarray, weights: np.ndarray) -> list[float]:
    """Estimates (x, y, cos, sin), spread and effective sample size of one cloud."""
    w = weights / weights.sum()
    x, y, heading = poses.T
    mean = [w @ x, w @ y, w @ np.cos(heading), w @ np.sin(heading)]
    return [*mean, w @ (x - w @ x) ** 2, 1 / (w @ w)]


def ours(robot: localizers.RobotModel, prior) -> np.ndarray:
    """(filters, steps, 6)."""
    localizer, rows = localizers.make("mcl", robot, particles=PARTICLES), []
    for seed in range(1_200):
        localizer.reset(prior, [], np.random.default_rng(seed))
        seen = zip(DRIVEN, SEEN, strict=True)
        beliefs = [localizer.update(scan, action, []) for action, scan in seen]
        rows.append([summary(*belief.points()) for belief in beliefs])
    return np.array(rows)


def theirs(robot: localizers.RobotModel, prior, filters: int) -> np.ndarray:
    rows, sds = [], [prior.sd_position, prior.sd_position, prior.sd_heading]
    for seed in range(filters):
        rng = np.random.default_rng((1, seed))
        start = rng.normal(prior.mean, sds, (PARTICLES, 3))
        rows.append([summary(*cloud) for cloud in book_mcl(robot, start, DRIVEN, SEEN, rng)])
    return np.array(rows)


def test_mcl_has_the_textbooks_means_over_many_filters(robot, prior):
    # Both are the same algorithm with the same resampling scheme, so the two laws are equal but
    # for float32: no allowance. 30 statistics; |z| > 5 fails: false alarms 2e-5 altogether.
    a, b = ours(robot, prior), theirs(robot, prior, 500)
    error = np.sqrt(a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b))
    assert np.abs((a.mean(axis=0) - b.mean(axis=0)) / error).max() < 5
