"""RoomEnv in a map of cells: contact rule, plan, frames and arguments as among polygons."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from room_trace import ROOM_ID
from side_by_side import both, run_beside

from deqmcl_gym import GridMap
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.world.drawing import BLACK, PALE, Drawing, View

WAYPOINTS = ((1.0, 1.0), (3.4, 1.0), (3.4, 2.4), (1.0, 2.4))


def hall(scale=1) -> np.ndarray:
    """Cells of 5 cm: a hall of 4.4 by 3.4 m with a pillar, around which the lap goes."""
    cells = np.pad(np.zeros((66, 86), np.int8), 1, constant_values=100)
    cells[28:40, 28:60] = 100
    cells[55:, 75:] = -1
    return np.kron(cells, np.ones((scale, scale), np.int8))


def test_a_beam_through_transparent_cells_and_out_of_the_map_reads_its_limit():
    cells, pose = hall(), (4.0, 1.0, math.pi / 2)  # towards the unknown corner
    cells[-1, 75:] = -1
    found = {}
    for unknown in ("obstacle", "transparent"):
        grid = GridMap(occupancy=cells, resolution=0.05, unknown=unknown)
        env = RoomEnv(
            floor_plan=grid, lap={"waypoints": WAYPOINTS}, start={"pose": pose},
            lidar={"beams": 1, "sigma": 1e-9, "max_range": 8.0},
        )  # fmt: skip
        found[unknown] = env.reset(seed=0)[0][0]
    assert found == {"obstacle": pytest.approx(55 * 0.05 - 1.0), "transparent": 8.0}


@pytest.mark.parametrize(("yaw", "unknown"), [(0.0, "obstacle"), (0.6, "transparent")])
def test_many_rooms_in_it_are_as_many_single_ones(yaw, unknown):
    grid = GridMap(occupancy=hall(), resolution=0.05, origin=(0, 0, yaw), unknown=unknown)
    corners = tuple(map(tuple, grid.placed(20 * np.array(WAYPOINTS)).tolist()))
    world = {"lap": {"waypoints": corners}, "robot": {"max_distance": 0.5}}
    envs = both(ROOM_ID, 3, floor_plan=grid, **world)
    contacts, _ = run_beside(envs, steps=300, planned=0.3, seed=1)
    assert contacts > 50


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["obstacle", "transparent"]))
def test_a_step_collides_where_the_map_says_so_and_stops_just_before(seed, unknown):
    """What the map says of drives that end within 1e-6 m of a wall is left to rounding."""
    rng = np.random.default_rng(seed)
    grid = GridMap(occupancy=hall(), resolution=0.05, unknown=unknown)
    still = {"drive": 0.0, "turn": 0.0, "drift": 0.0}
    robot = {"max_distance": 1.0, "max_turn": math.pi}
    env = RoomEnv(floor_plan=grid, lap={"waypoints": WAYPOINTS}, noise=still, robot=robot)
    env.reset(seed=0)
    radius, hits = env.world.robot.radius, 0
    for _ in range(60):
        x, y, heading = env.pose
        distance, turn = rng.uniform(0, 1), rng.uniform(-3, 3)
        angle = heading + np.float64(np.float32(turn))
        driven = np.float64(np.float32(distance))
        end = (x + driven * math.cos(angle), y + driven * math.sin(angle))
        sure = [grid.collides([(x, y)], [end], radius + by)[0] for by in (-1e-6, 1e-6)]
        _, _, ended, _, info = env.step([distance, turn])
        if sure[0] == sure[1]:
            assert info["collided"] == sure[0]
        hits += info["collided"]
        assert grid.free([env.pose], radius)[0]
        if info["collided"]:
            assert grid.distance([env.pose])[0] <= radius + 2e-5 + 1e-6  # the skin
            assert math.dist((x, y), env.pose[:2]) <= distance + 1e-9
        else:
            assert env.pose[:2] == pytest.approx(end, abs=1e-12)
        if ended:
            env.reset()
    assert hits


@pytest.mark.parametrize(("scale", "yaw"), [(1, 0.0), (30, 0.0), (3, 0.7)])
def test_a_frame_has_a_sensible_size_however_many_cells_there_are(scale, yaw):
    grid = GridMap(occupancy=hall(scale=scale), resolution=0.05, origin=(0, 0, yaw))
    image = Drawing(View(grid)).image
    assert 200 < max(image.shape) <= 980
    assert image.shape[0] % 2 == image.shape[1] % 2 == 0
    places = {(44, 10): (255,) * 3, (44, 34): BLACK, (80, 60): PALE, (87.5, 30): BLACK}
    pixels = View(grid).pixels(grid.placed(scale * np.array(list(places))))
    for (column, row), color in zip(np.rint(pixels).astype(int), places.values(), strict=True):
        assert tuple(image[row, column]) == color


def test_free_space_seen_by_single_rays_stays_free_in_a_small_picture():
    """Rays a cell wide, 3 apart, in unknown space: each pixel has 7 cells, so a free one."""
    cells = np.full((3000, 3000), -1, np.int8)
    cells[:, ::3] = 0
    cells[1000:1002] = 100
    view = View(GridMap(occupancy=cells, resolution=0.05))
    image = Drawing(view).image[view.margin : -view.margin, view.margin : -view.margin, 0]
    walls = (image == BLACK[0]).mean(axis=1)
    assert set(walls) == {0.0, 1.0}
    assert (image[walls == 0] == 255).all()
