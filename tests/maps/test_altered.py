"""Altered maps: inner walls are found, and what is painted or cut out is exact."""

import numpy as np
import pytest
import reference
from grid_cases import grids, in_cells
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from refusals import refused

from deqmcl_gym.maps import GridMap, PolygonMap
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.differences import altered, inner_walls

# 8 m x 6 m, in cells of 0.1 m: a wall from below to above with a door, and a block in a corner
CELLS = np.zeros((60, 80), np.int8)
CELLS[[0, -1]] = CELLS[:, [0, -1]] = 100
CELLS[:, 40:42] = 100
CELLS[20:29, 40:42] = 0
HALL = GridMap(occupancy=CELLS, resolution=0.1)
NO_BOXES = np.empty((0, 4, 2))


def spans(pieces):
    """(low x, low y, high x, high y) of each, sorted and rounded."""
    boxes = [np.append(p.boxes.min(axis=(0, 1)), p.boxes.max(axis=(0, 1))) for p in pieces]
    return sorted(tuple(np.round(box, 6).tolist()) for box in boxes)


def test_a_wall_and_its_door_are_found_and_pieces_are_at_most_2_m_long():
    walls, doors, step = inner_walls(HALL)
    # below the door 0.1 to 2.0 m; above it 2.9 to 5.9 m in two pieces of 1.5 m
    assert spans(walls) == [(4, 0.1, 4.2, 2), (4, 2.9, 4.2, 4.4), (4, 4.4, 4.2, 5.9)]
    assert spans(doors) == [(4, 2, 4.2, 2.9)]
    assert step == 0.1
    assert sorted(piece.length for piece in walls) == pytest.approx([1.5, 1.5, 1.9])


def test_walls_of_a_turned_map_are_found_as_well():
    turned = GridMap(occupancy=CELLS, resolution=0.1, origin=(50.0, -20.0, 0.7))
    walls, doors, _ = inner_walls(turned)
    in_hall = in_cells(turned, np.vstack([p.boxes.reshape(-1, 2) for p in walls])) / 10
    expected = np.vstack([p.boxes.reshape(-1, 2) for p in inner_walls(HALL).walls])
    np.testing.assert_allclose(in_hall, expected, atol=1e-9)
    assert len(doors) == 1


def test_a_map_without_inner_walls_is_refused():
    with refused("has no inner wall along its axes of at most 2 m"):
        inner_walls(GridMap(occupancy=np.zeros((9, 9), int), resolution=0.1))


@settings(max_examples=40, deadline=None)
@given(grids(), st.integers(0, 2**31))
def test_a_cell_is_painted_if_its_centre_is_inside(grid, seed):
    rng = np.random.default_rng(seed)
    rows, columns = grid.occupancy.shape
    size = grid.resolution * max(rows, columns)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 5))
    centre = grid.placed(rng.random((1, 2)) * (columns, rows))
    corners = rng.uniform(0.05, 0.6) * size * np.column_stack([np.cos(angles), np.sin(angles)])
    polygon = centre + corners
    try:
        painted = grid.painted(([polygon], 100))
    except InputError:  # no cell is left free
        assume(False)
    cells = np.argwhere(grid.occupancy > -9)[:, ::-1] + 0.5
    walls, centres = np.hstack([polygon, np.roll(polygon, -1, axis=0)]), grid.placed(cells)
    inside = reference.winding(walls, centres) == 1
    sure = reference.clearance(walls, centres, centres) > 1e-6
    changed = (painted.occupancy != grid.occupancy).ravel()
    if inside.any():
        expected = inside & (grid.occupancy.ravel() != 100)
        np.testing.assert_array_equal(changed[sure], expected[sure])
    else:
        assert changed.sum() <= 1


def test_what_is_put_in_stops_beams_and_what_is_cut_out_lets_them_through():
    box = np.array([(2.0, 2.5), (2.5, 2.5), (2.5, 3.5), (2.0, 3.5)])
    pose = [(1.05, 3.25, 0.0)]
    room = PolygonMap([(0, 0), (10, 0), (10, 6), (0, 6)], unit="m")
    assert altered(room, NO_BOXES, [box]).ranges(pose, [0.0])[0, 0] == pytest.approx(0.95)
    assert altered(room, NO_BOXES, []) is room
    assert altered(HALL, NO_BOXES, [box]).ranges(pose, [0.0])[0, 0] == pytest.approx(0.95)
    gone = np.vstack([piece.boxes for piece in inner_walls(HALL).walls])
    for hall, seen in ((HALL, 2.95), (altered(HALL, gone, []), 6.85)):
        assert hall.ranges(pose, [0.0])[0, 0] == pytest.approx(seen)
