"""Turn, then drive straight; stop at the first contact; drive away again."""

import math

import numpy as np
import pytest
import reference
from room_cases import PAPER, SEVERAL, SPIKE, STILL, calm, drive, wrapped

from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.world.config import SKIN

# float64 coordinates below 500 px have ulps of 6e-14; a contact takes some dozen operations.
EXACT = 1e-10
# PolygonMap computes in float32: coordinates to 3e-5 px, a clearance by a handful of operations.
BAND = 1e-3

# A robot with long arms: steps up to 60 px meet walls often, and reach past obstacle corners.
LONG = {"max_distance": 60.0, "max_turn": math.pi}

# Past the corner (100, 100) at 7 px from it, towards the lower right, from 30 px before to 30 px
# behind: both ends are clear, but √(8² - 7²) px before the nearest point the disc touches the
# corner (left of and below it there, so no wall's side comes first).
S = math.sqrt(0.5)
PAST_A_CORNER = (100 - 7 * S - 30 * S, 100 - 7 * S + 30 * S, -math.pi / 4)


@pytest.mark.parametrize(
    ("start", "command", "way"),
    [
        ((330, 50, 0.0), (20, 0.0), 12),  # the wall is x = 350, the radius 8
        ((330, 50, 0.0), (60, 0.5), 12 / math.cos(0.5)),  # no sliding along it
        (PAST_A_CORNER, (60, 0.0), 30 - math.sqrt(8**2 - 7**2)),
        ((12, 150, math.pi), (6, 0.0), 4),  # the centre stays clear of the wall
    ],
)
def test_a_drive_stops_on_its_straight_line_just_before_the_first_contact(start, command, way):
    env = calm(start={"pose": start}, robot=LONG, ends_at_goal=False)
    info = drive(env, [command])[0][4]
    heading = start[2] + command[1]
    way -= SKIN
    expected = (start[0] + way * math.cos(heading), start[1] + way * math.sin(heading))
    assert info["collided"]
    np.testing.assert_allclose(info["truth"][:2], expected, rtol=0, atol=EXACT)
    assert abs(wrapped(info["truth"][2] - heading)) < EXACT


def test_a_stopped_robot_stays_within_the_skin_and_can_turn_and_drive_away():
    env = calm(start={"pose": (340, 50, 0.0)}, robot=LONG, ends_at_goal=False)
    infos = [said[4] for said in drive(env, [(60, 0), (60, 0), (0, math.pi), (20, 0)])]
    assert [info["collided"] for info in infos] == [True, True, False, False]
    first, (x, y, _), turned, away = (info["truth"] for info in infos)
    # It may use up what is left of the skin, and no more.
    assert math.dist(first[:2], (x, y)) <= SKIN
    np.testing.assert_array_equal(turned[:2], (x, y))
    # π in float32 is off by 9e-8 rad: 2e-6 px over 20 px
    np.testing.assert_allclose(away[:2], (x - 20, y), rtol=0, atol=2e-6)


def test_a_tip_of_the_outer_wall_is_met_from_beside_it():
    # It starts nearer than its radius to the line of the spike's upper side, and leaves that strip
    # again behind the tip, which its centre passes at 5 px.
    start = (298.0, 153.0, 0.15)
    env = calm(floor_plan=SPIKE, start={"pose": start}, robot=LONG, ends_at_goal=False)
    info = drive(env, [(24, 0)])[0][4]
    assert info["collided"]
    assert 8 < math.dist(info["truth"][:2], (310, 150)) <= 8 + SKIN


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
