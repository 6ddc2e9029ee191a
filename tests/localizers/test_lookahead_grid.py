"""The table of h against rollouts, and its parts against what they approximate."""

import math
from dataclasses import replace

import numpy as np
import pytest
from following import STILL

import localizers
from deqmcl_gym.maps import PolygonMap
from localizers.inference.belief import ParticleBelief
from localizers.inference.futures import Rollout
from localizers.inference.plan_evidence import Pilots, Tabulated
from localizers.inference.queue import Queue
from localizers.models import lookahead_grid, lookahead_kernels
from localizers.models.lookahead_grid import LEAST, LookaheadGrid
from localizers.models.plan_sensor import FreeSpace

RNG = np.random.default_rng
NOISY = localizers.OdometryMotion(drive=0.2, turn=0.3, drift=0.03)
SMALL = PolygonMap(outer=[(0, 0), (80, 0), (80, 60), (0, 60)])
PLAN = np.array([(8.0, 0.0), (8.0, 0.4), (8.0, 0.0), (8.0, -0.5)])
RADIUS = 5.0


def grid_of(floor_plan, motion, beta: float = 1.0, cell: float = 5.0, **params) -> LookaheadGrid:
    return LookaheadGrid(
        floor_plan=floor_plan, radius=RADIUS, beta=beta, motion=motion, cell=cell, **params
    )


def rolled_out(grid: LookaheadGrid, poses, plan, copies: int, seed: int = 0):
    """Mean and standard error of Π g over rollouts, (n,)."""
    walls = FreeSpace(floor_plan=grid.floor_plan, radius=grid.radius, beta=grid.beta)
    _, log_g = Rollout(grid.motion, walls).futures(poses, plan, copies, RNG(seed))
    products = np.exp(log_g)
    return products.mean(axis=0), products.std(axis=0) / math.sqrt(copies)


def poses_in(grid: LookaheadGrid, n: int, clear: float) -> np.ndarray:
    """Poses with ``clear`` px to spare around the robot, (3, k)."""
    rng = RNG(7)
    x0, y0, x1, y1 = grid.floor_plan.bounds
    poses = rng.uniform((x0, y0, -math.pi), (x1, y1, math.pi), (n, 3)).astype(np.float32)
    return np.ascontiguousarray(poses[grid.floor_plan.free(poses, grid.radius + clear)].T)


@pytest.mark.parametrize("beta", [0.5, 1.0, math.inf])
def test_without_noise_and_on_the_nodes_h_is_the_charge_of_the_one_path(room, beta):
    # Steps of one cell along the axes end on nodes: nothing is interpolated.
    grid = grid_of(room, STILL, beta, cell=10.0, headings=4)
    plan = np.array([(10.0, 0.0), (10.0, math.pi / 2), (20.0, 0.0), (0.0, -math.pi / 2)])
    # of a room of 350 x 300 px, and of the nodes around it
    x, y, quarter = np.meshgrid(np.arange(-10, 361, 10), np.arange(-10, 311, 10), np.arange(4))
    poses = np.stack([x.ravel(), y.ravel(), quarter.ravel() * math.pi / 2]).astype(np.float32)
    # a wall at exactly the radius is left to rounding: stay a hair off the nodes
    expected, _ = rolled_out(grid, poses, plan, copies=1)
    seen = np.exp(grid.log_h(poses, plan))
    assert len(set(expected.round(6))) > 1
    # float32: three roundings a step; cos(π/2) = 4e-8 in the path rolled out
    assert seen == pytest.approx(expected, rel=1e-5, abs=1e-5)


def test_h_is_one_where_nothing_is_charged_and_in_a_wall_every_step_is(room):
    free = grid_of(room, NOISY, beta=0.0)
    # a sum of weights, rounded to float32 eight times a step
    assert np.abs(free.log_h(poses_in(free, 200, 0.0), PLAN)).max() < len(PLAN) * 8 * 2**-23
    away_and_inside = np.array([[50.0, 175.0], [50.0, 150.0], [0.5, 0.5]], dtype=np.float32)
    charged = grid_of(room, NOISY, beta=1.0).log_h(away_and_inside, PLAN / 10)
    assert charged == pytest.approx([0.0, -4.0], abs=1e-5)


@pytest.mark.parametrize("beta", [1.0, 10.0])
def test_on_a_fine_grid_h_agrees_with_rollouts(beta):
    # The rollouts' own error counts five times (false alarm 6e-7 each if normal; fixed seed). What
    # is left is the grid's: interpolation adds at most a quarter of a squared cell, ¼ px², to the
    # (0.2 · 8 px)² = 2.6 px² of each step's noise. 0.03 is the accuracy claimed at such a cell.
    grid = grid_of(SMALL, NOISY, beta, cell=1.0, headings=144)
    poses = poses_in(grid, 400, clear=2.0)
    expected, error = rolled_out(grid, poses, PLAN, copies=4_000)
    seen = np.exp(grid.log_h(poses, PLAN))
    assert (np.abs(seen - expected) < 0.03 + 5 * error).all()
    assert expected.std() > 0.2


def test_pilots_agree_with_the_table_as_they_grow_in_number():
    grid = grid_of(SMALL, NOISY, cell=1.0, headings=144)
    rollout = Rollout(NOISY, FreeSpace(floor_plan=SMALL, radius=RADIUS, beta=1.0))
    poses = poses_in(grid, 400, clear=2.0)
    belief = ParticleBelief(Queue((poses,)), np.zeros(poses.shape[1]), np.empty((0, 2)))
    h = np.exp(Tabulated(table=grid, steps=4)(belief, PLAN, RNG(0)).log_h)
    off = []
    for pilots in (1, 16, 256):
        seen = Pilots(rollout=rollout, steps=4, pilots=pilots)(belief, PLAN, RNG(0))
        off.append(np.sqrt(np.square(np.exp(seen.log_h) - h).mean()))
    # As 1 / √K, a quarter, until the grid's own error shows, which is below 0.03.
    assert off[1] < off[0] / 3
    assert off[2] < 0.03


@pytest.mark.parametrize(("turn", "sd"), [(0.0, 0.25), (0.26, 0.08), (-0.5, 0.003), (0.3, 0.0)])
def test_the_turn_keeps_its_mean_and_widens_by_at_most_a_quarter_of_a_spacing_squared(turn, sd):
    first, weights = lookahead_grid._turn_weights(turn, sd, 72)
    spacing = 2 * math.pi / 72
    at = (first + np.arange(weights.size)) * spacing
    mean = (weights * at).sum()
    variance = (weights * (at - mean) ** 2).sum()
    assert weights.sum() == pytest.approx(1.0, abs=1e-6)
    assert mean == pytest.approx(turn, abs=1e-6)
    assert sd**2 - 1e-4 * sd**2 - 1e-9 <= variance <= sd**2 + spacing**2 / 4 + 1e-9


def test_the_heading_is_wrapped_and_a_pose_off_the_grid_counts_as_the_nearest_on_it(room):
    grid = grid_of(room, NOISY)
    poses = np.array([[-5.0, 50.0, 50.0], [150.0, 30.0, 30.0], [0.1, -3.1, 2.0]], np.float32)
    turned = poses + np.float32([[0.0], [0.0], [2 * math.pi]])
    # the turn itself is rounded to 5e-7 rad; h changes by less than 10 per rad
    assert grid.log_h(turned, PLAN) == pytest.approx(grid.log_h(poses, PLAN), abs=1e-5)
    far = poses - np.float32([[295.0], [0.0], [0.0]])
    assert grid.log_h(far, PLAN)[0] == grid.log_h(poses, PLAN)[0]


def test_where_no_future_is_feasible_h_is_the_least_positive_and_the_same_for_all(room):
    grid = grid_of(room, NOISY, beta=math.inf)
    inside = np.array([[170.0, 180.0], [150.0, 140.0], [0.1, 2.0]], dtype=np.float32)
    assert grid.log_h(inside, PLAN) == pytest.approx(math.log(LEAST), abs=1e-5)


@pytest.mark.parametrize("action", [(1e7, 0.0), (-1e7, 1e7), (1e-9, -1e7), (0.0, 0.0)])
def test_an_action_of_any_size_is_tabulated(room, action):
    grid = grid_of(room, NOISY, cell=10.0, headings=36)
    log_h = grid.log_h(poses_in(grid, 50, 0.0), np.array([action, (8.0, 0.0)]))
    assert np.isfinite(log_h).all()
    assert (log_h < 1e-5).all()
    leaves = abs(action[0]) > 1
    assert (log_h < -0.9).all() if leaves else (log_h > -0.9).any()


@pytest.mark.parametrize("at", [(50.0, 150.0), (175.0, 20.0), (400.0, -50.0)])
@pytest.mark.parametrize("spread", [0.5, 25.0, 300.0])
def test_a_table_of_the_nodes_asked_for_has_the_bits_of_the_whole_one(room, at, spread):
    rng = RNG(1)
    grid, plan = grid_of(room, NOISY, cell=10.0, headings=36), np.tile(PLAN, (2, 1))
    xy = rng.normal(np.array(at)[:, None], spread, (2, 50))
    poses = np.vstack([xy, rng.normal(-3.0, spread / 100, 50)]).astype(np.float32)
    parts = []
    for asked in (grid.around(poses), None):
        table, out = grid.table(plan, asked), np.empty(50)
        lookahead_kernels.log_interpolated(
            table.h, poses, (*grid.origin, grid.cell), grid.shape[1:], table.corner, out
        )
        parts.append(out)
    assert parts[0].tolist() == parts[1].tolist()
    assert spread > 100 or grid.table(plan, grid.around(poses)).h.size < table.h.size / 2


def test_a_window_asked_for_again_is_tabulated_whole_once_for_all_localizers_of_an_equal_robot(
    robot, room, prior, drive, monkeypatch
):
    whole = []
    table = LookaheadGrid.table

    def counting(self, window, asked=None):
        whole.extend([window.tobytes()] if asked is None else [])
        return table(self, window, asked)

    monkeypatch.setattr(LookaheadGrid, "table", counting)
    lookahead_grid._tables.cache_clear()
    same_room = PolygonMap(outer=room.outer, obstacles=room.obstacles)
    for plan in (room, same_room, room):
        localizer = localizers.make("mcl-h", replace(robot, floor_plan=plan), particles=10, lag=3)
        localizer.reset(prior, drive[0], RNG(0))
        localizer.update(drive[1][0], drive[0][0], drive[0][1:])
        localizer.update(drive[1][1], drive[0][1], drive[0][2:])
    assert len(whole) == len(set(whole)) == 1  # the drive begins with equal steps: one window
