"""Inner walls are found where they are, and altered maps are exact: cells and polygons agree."""

import numpy as np
import pytest
import reference
from grid_cases import grids, in_cells
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from refusals import refused

from deqmcl_gym.maps import GridMap, Office, PolygonMap
from deqmcl_gym.maps.altered import altered, free_area, inner_walls
from deqmcl_gym.validation import InputError

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


@pytest.mark.parametrize("hall", [HALL, PolygonMap.from_grid(HALL)], ids=["cells", "polygons"])
def test_a_wall_and_its_door_are_found_and_pieces_are_at_most_2_m_long(hall):
    walls, doors, step = inner_walls(hall)
    # below the door 0.1 to 2.0 m; above it 2.9 to 5.9 m in two pieces of 1.5 m
    assert spans(walls) == [(4, 0.1, 4.2, 2), (4, 2.9, 4.2, 4.4), (4, 4.4, 4.2, 5.9)]
    assert spans(doors) == [(4, 2, 4.2, 2.9)]
    assert step == (0.1 if hall is HALL else 0.0)
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
        inner_walls(PolygonMap([(0, 0), (9, 0), (9, 9), (0, 9)], unit="m"))


@settings(max_examples=40, deadline=None)
@given(grids(), st.integers(0, 2**31))
def test_a_cell_is_painted_if_its_centre_is_inside(grid, seed):
    rng = np.random.default_rng(seed)
    rows, columns = grid.occupancy.shape
    size = grid.resolution * max(rows, columns)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 5))
    centre = grid.placed(rng.random((1, 2)) * (columns, rows))
    polygon = centre + rng.uniform(0.05, 0.6) * size * np.column_stack(
        [np.cos(angles), np.sin(angles)]
    )
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


@pytest.mark.parametrize("seed", [0, 3])
def test_altered_cells_and_altered_polygons_are_the_same_world(seed):
    office, rng = Office(seed=seed, wings=1), np.random.default_rng(seed)
    grid, polygons = office.grid, office.polygons
    walls, doors, step = inner_walls(grid)
    order = rng.permutation(len(walls))
    gone = [walls[k].boxes for k in order[:12]]
    come = [box for k in order[6:20] for box in walls[k].boxes + 4 * step * walls[k].across]
    come += [box for door in doors[::3] for box in door.boxes]
    cells = altered(grid, np.vstack(gone), come)
    assert isinstance(cells, GridMap)
    lines = altered(polygons, np.vstack(gone), come)
    assert isinstance(lines, PolygonMap)
    x0, y0, x1, y1 = grid.bounds
    points = rng.uniform((x0, y0), (x1, y1), (4000, 2))
    # cells know no rounding; faces are within 1e-5 m of each other
    clear = (cells.distance(points) > 1e-4) & (lines.distance(points) > 1e-4)
    free = cells.free(points)
    np.testing.assert_array_equal(free[clear], lines.free(points)[clear])
    poses = np.column_stack([points, rng.uniform(-np.pi, np.pi, len(points))])[free & clear]
    ours, theirs = (m.ranges(poses, [0.0, 1.0, 2.5]) for m in (cells, lines))
    # a beam that grazes a corner may pass it on one of them: 1e-5 of 12,000 beams is none
    apart = np.abs(ours - theirs) > 2e-3
    assert apart.mean() < 1e-3
    assert (cells.distance(points) - lines.distance(points))[free].max() < 1e-3


def test_what_is_put_in_stops_beams_and_what_is_cut_out_lets_them_through():
    room = PolygonMap([(0, 0), (10, 0), (10, 6), (0, 6)], [[(4, 2), (5, 2), (5, 4), (4, 4)]], "m")
    (piece,) = inner_walls(room).walls
    pose = [(1.0, 3.0, 0.0)]
    assert room.ranges(pose, [0.0])[0, 0] == 3.0
    assert altered(room, piece.boxes, []).ranges(pose, [0.0])[0, 0] == 9.0
    box = np.array([(2.0, 2.5), (2.5, 2.5), (2.5, 3.5), (2.0, 3.5)])
    assert altered(room, NO_BOXES, [box]).ranges(pose, [0.0])[0, 0] == 1.0
    assert altered(room, NO_BOXES, []) is room
    assert free_area(room) == 58.0
    assert free_area(HALL) == pytest.approx(7.8 * 5.8 - 0.2 * (5.8 - 0.9))
