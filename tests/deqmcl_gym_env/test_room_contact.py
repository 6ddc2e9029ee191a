"""Turn, then drive straight; stop at the first contact; among polygons and in cells."""

import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from room_cases import PAPER, ROOM_ID, SEVERAL, SPIKE, STILL, hall, wrapped
from side_by_side import both, run_beside

from deqmcl_gym import GridMap
from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.world import SKIN

# float64 coordinates below 500 px have ulps of 6e-14; a contact takes some dozen operations.
EXACT = 1e-10
# PolygonMap computes in float32: coordinates to 3e-5 px, a clearance by a handful of operations.
BAND = 1e-3
LONG = {"max_distance": 60.0, "max_turn": math.pi}  # steps that reach past obstacle corners
WAYPOINTS = ((1.0, 1.0), (3.4, 1.0), (3.4, 2.4), (1.0, 2.4))


def random_drives(floor_plan: dict, radius: float, n: int, noise: dict):
    """Random steps of 0 to 60 px: poses before and after, and whether each collided."""
    # a lap of 0.2 px steps: long enough for n steps in one episode
    how = {"lap": {"step": 0.2}, "ends_at_goal": False, "horizon": 1}
    env = RoomEnv(floor_plan=floor_plan, robot=LONG | {"radius": radius}, noise=noise, **how)
    _, info = env.reset(seed=4)
    agent = np.random.default_rng(5)
    drawn = np.column_stack([agent.uniform(0, 60, n), agent.uniform(-math.pi, math.pi, n)])
    commands = np.float32(drawn).clip(env.action_space.low, env.action_space.high)
    infos = [info] + [env.step(command)[4] for command in commands]
    poses = np.array([info["truth"] for info in infos])
    return poses, commands, np.array([bool(info["collided"]) for info in infos[1:]])


@pytest.mark.parametrize("radius", [8.0, 1.0])
@pytest.mark.parametrize("plan", [PAPER, SEVERAL, SPIKE], ids=["paper", "several", "spike"])
def test_collided_says_what_the_reference_and_the_floor_plan_say(plan, radius):
    poses, commands, collided = random_drives(plan, radius, 3000, STILL)
    walls = PolygonMap(**plan)
    headings = wrapped(poses[:-1, 2] + commands[:, 1])
    starts = poses[:-1, :2]
    directions = np.column_stack([np.cos(headings), np.sin(headings)])
    ends = starts + commands[:, :1] * directions  # where each step was to lead
    clearance = reference.clearance(walls.walls, starts, ends)
    assert 0.1 < collided.mean() < 0.9  # both answers occur
    np.testing.assert_array_equal(collided, clearance <= radius)
    clear_cut = np.abs(clearance - radius) > BAND
    # Excused are robots at a wall (within the skin) that drive off, and next to nothing else.
    assert clear_cut.mean() > 0.5
    found = walls.collides(starts, ends, radius)
    np.testing.assert_array_equal(found[clear_cut], collided[clear_cut])
    assert np.abs(wrapped(poses[1:, 2] - headings)).max() < EXACT
    # Free steps end where they were to; stopped ones on the way there, less than the way.
    way = np.linalg.norm(poses[1:, :2] - starts, axis=1)
    straight = starts + way[:, None] * directions
    np.testing.assert_allclose(poses[1:, :2], straight, rtol=0, atol=EXACT)
    np.testing.assert_allclose(way[~collided], commands[~collided, 0], rtol=0, atol=EXACT)
    assert (way[collided] < commands[collided, 0]).all()
    # A stopped robot stands at the contact: nearer than SKIN or, if it started there, not moved.
    gap = reference.clearance(walls.walls, poses[1:], poses[1:]) - radius
    assert gap[collided].max() <= SKIN + EXACT


@pytest.mark.parametrize("plan", [PAPER, SEVERAL, SPIKE], ids=["paper", "several", "spike"])
def test_the_robot_never_overlaps_a_wall_on_thousands_of_noisy_steps(plan):
    noise = {"drive": 0.3, "turn": 0.3, "drift": 0.01}
    poses, _, _ = random_drives(plan, 8.0, 4000, noise)
    walls = PolygonMap(**plan).walls
    assert reference.clearance(walls, poses[:-1], poses[1:]).min() > 8.0  # on the way, too
    assert (reference.winding(walls, poses) == 1).all()  # inside the room, in no obstacle


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
    robot = {"max_distance": 1.0, "max_turn": math.pi}
    env = RoomEnv(floor_plan=grid, lap={"waypoints": WAYPOINTS}, noise=STILL, robot=robot)
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
