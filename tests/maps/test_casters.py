"""The two ways to find the nearest wall: which one a floor plan takes, and that they agree."""

import numpy as np
import pytest
from sample_plans import PLANS, anywhere
from test_ranges import inside_the_outer_wall

from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.maps.casting import (
    MANY_WALLS,
    AllAtOnce,
    CellByCell,
    all_at_once,
    caster_of,
    cell_by_cell,
    cells_of,
)


def test_a_rectangle_counts_as_one_however_many_walls_it_has():
    boxes = [
        [(x, y), (x + 5, y), (x + 5, y + 5), (x, y + 5)]
        for x in range(10, 90, 10)
        for y in range(10, 80, 10)
    ]
    room = [(0, 0), (100, 0), (100, 100), (0, 100)]
    assert 4 * len(boxes) > MANY_WALLS > len(boxes) + 1
    assert isinstance(caster_of(room, boxes, 1.0), AllAtOnce)
    assert all_at_once(room, boxes, 1.0).tries == len(boxes) + 1


@pytest.mark.parametrize(("walls", "kind"), [(191, AllAtOnce), (192, CellByCell)])
def test_walls_that_make_no_rectangle_count_one_each(walls, kind):
    angles = np.arange(walls) * 2 * np.pi / walls + 0.1
    ring = [(100 * x, 100 * y) for x, y in zip(np.cos(angles), np.sin(angles), strict=True)]
    assert all_at_once(ring, (), 1.0).tries == walls
    assert isinstance(caster_of(ring, (), 1.0), kind)


@pytest.mark.parametrize(("walls", "kind"), [(572, AllAtOnce), (580, CellByCell)])
def test_walls_along_the_axes_count_a_third_each(walls, kind):
    steps = [(x, x % 2) for x in range((walls - 2) // 2)]  # a stair of ups and downs
    stair = [corner for x, y in steps for corner in ((x, y), (x + 1, y))]
    ring = [*stair, (len(steps), 100), (0, 100)]
    assert len(all_at_once(ring, (), 1.0).walls.oblique) == 0
    assert isinstance(caster_of(ring, (), 1.0), kind)


def cast(caster, poses: np.ndarray) -> np.ndarray:
    out = np.empty((1, len(poses)), np.float32)
    caster.cast(np.ascontiguousarray(poses.T, np.float32), np.zeros(1, np.float32), out)
    return out[0]


@pytest.mark.parametrize("name", PLANS)
def test_both_casters_see_the_same_but_where_a_beam_grazes_a_corner(name):
    """Away from corners both err by float32 rounding alone.

    At most 3e-3 of these beams differ by more than 1e-3 px: a third of them are aimed at a corner,
    and of those the ones matter whose float32 direction, off by some 1e-7 of a few hundred px,
    falls on either side of it by less than that.
    """
    plan = PLANS[name]
    rng = np.random.default_rng(6)
    poses = np.column_stack([anywhere(plan, 20_000, rng), rng.uniform(-np.pi, np.pi, 20_000)])
    poses = inside_the_outer_wall(plan, poses)
    one, other = (
        cast(maker(plan.outer, plan.obstacles, 1.0), poses) for maker in (all_at_once, cell_by_cell)
    )
    assert np.isfinite([one, other]).all()  # no beam escapes
    assert (np.abs(one - other) > 1e-3).mean() < 3e-3


@pytest.mark.parametrize("name", PLANS)
def test_each_point_of_a_wall_lies_in_a_cell_that_lists_the_wall(name):
    walls = PLANS[name].walls
    cells = cells_of(walls, np.zeros((len(walls), 6), np.float32), 0.05)
    table, columns = cells.table, cells.table.reach.shape[1]
    share = np.random.default_rng(8).random((200, 1, 1))
    points = walls[:, :2] + share * (walls[:, 2:] - walls[:, :2])  # (200, S, 2)
    column, row = np.floor((points - cells.corner) / cells.side).astype(int).transpose(2, 0, 1)
    for cell, wall in zip(
        (row * columns + column).ravel().tolist(),
        np.tile(np.arange(len(walls)), len(points)).tolist(),
        strict=True,
    ):
        assert wall in table.listed[table.first[cell] : table.first[cell + 1]]
        assert table.reach.flat[cell] == 0


def test_a_wall_along_the_border_of_cells_is_not_missed():
    """A grid of squares whose edges fall on multiples of the cell's side."""
    boxes = [
        [(x, y), (x + 10, y), (x + 10, y + 10), (x, y + 10)]
        for x in range(20, 380, 20)
        for y in range(20, 380, 20)
    ]
    plan = PolygonMap([(0, 0), (400, 0), (400, 400), (0, 400)], boxes)
    between = np.arange(15.0, 390.0, 20.0)  # lanes without obstacles
    east = np.column_stack([np.full(between.size, 5.0), between, np.zeros(between.size)])
    assert plan.ranges(east, [0.0])[:, 0] == pytest.approx(np.full(between.size, 395.0), abs=1e-3)
    blocked = east + np.array([0.0, 10.0, 0.0])
    assert plan.ranges(blocked[:-1], [0.0])[:, 0] == pytest.approx(
        np.full(between.size - 1, 15.0), abs=1e-3
    )
