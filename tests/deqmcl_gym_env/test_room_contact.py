"""Turn, then drive straight; stop at the first contact; drive away again."""

import math

import numpy as np
import pytest
import reference
from room_cases import PAPER, SEVERAL, SPIKE, STILL, wrapped

from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.world.config import SKIN

# float64 coordinates below 500 px have ulps of 6e-14; a contact takes some dozen operations.
EXACT = 1e-10
# PolygonMap computes in float32: coordinates to 3e-5 px, a clearance by a handful of operations.
BAND = 1e-3
LONG = {"max_distance": 60.0, "max_turn": math.pi}  # steps that reach past obstacle corners


def random_drives(floor_plan: dict, radius: float, n: int, noise: dict):
    """Random steps of 0 to 60 px: poses before and after, and whether each collided."""
    robot = LONG | {"radius": radius}
    # a lap of 0.2 px steps: long enough for n steps in one episode
    env = RoomEnv(
        floor_plan=floor_plan, robot=robot, noise=noise, lap={"step": 0.2}, ends_at_goal=False,
        horizon=1,
    )  # fmt: skip
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
