"""Turn, then drive straight; stop at the first contact; drive away again."""

import math

import numpy as np
import pymunk
import pytest
import reference
from room_cases import PAPER, SEVERAL, SPIKE, STILL, calm, drive, poses_of, wrapped

from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.world.physics import SKIN, Physics, Walls

# float64 coordinates below 500 px have ulps of 6e-14; a contact takes some dozen operations.
EXACT = 1e-10
# PolygonMap computes in float32: coordinates to 3e-5 px, a clearance by a handful of operations.
BAND = 1e-3

# A robot with long arms: steps up to 60 px meet walls often, and reach past obstacle corners.
LONG = {"max_distance": 60.0, "max_turn": math.pi}


def test_noise_free_motion_is_turn_then_drive():
    env = calm(ends_at_goal=False)
    agent = np.random.default_rng(0)
    commands = np.float32(np.column_stack([agent.uniform(0, 3, 150), agent.uniform(0, 0.7, 150)]))
    x, y, heading = env.pose
    for (distance, turn), pose in zip(commands.tolist(), poses_of(env, commands), strict=True):
        heading += turn
        x, y = x + distance * math.cos(heading), y + distance * math.sin(heading)
        # 150 steps of a few ulps each; it goes round in circles, headings grow up
        # to 105 rad before they are wrapped
        np.testing.assert_allclose(pose[:2], (x, y), rtol=0, atol=150 * EXACT)
        assert abs(math.remainder(pose[2] - heading, 2 * math.pi)) < 150 * EXACT
        assert -math.pi <= pose[2] < math.pi


def test_a_step_into_a_wall_stops_at_contact_and_says_so():
    env = calm(start={"pose": (330, 50, 0.0)}, ends_at_goal=False)
    free, stopped = drive(env, [(10, 0), (10, 0)])
    assert not free[4]["collided"]
    assert stopped[4]["collided"]
    # The wall is x = 350, the radius 8.
    np.testing.assert_allclose(stopped[4]["truth"], (342 - SKIN, 50, 0), rtol=0, atol=EXACT)


def test_a_slanting_contact_stops_on_the_straight_line_without_sliding():
    turn = 0.5
    env = calm(start={"pose": (330, 50, 0.0)}, robot=LONG, ends_at_goal=False)
    x, y, heading = drive(env, [(60, turn)])[0][4]["truth"]
    assert heading == turn  # exact in float32
    way = 12 / math.cos(turn) - SKIN  # the centre goes from x = 330 to x = 342
    expected = (330 + way * math.cos(turn), 50 + way * math.sin(turn))
    np.testing.assert_allclose((x, y), expected, rtol=0, atol=EXACT)
    again = drive(env, [(60, 0)])[0][4]
    assert again["collided"]
    # It may use up what is left of the skin, along its heading, and no more.
    assert np.hypot(*(again["truth"][:2] - (x, y))) <= SKIN


def test_contact_is_found_on_the_way_not_only_at_its_end():
    # Past the corner (100, 100) at 7 px from it, towards the lower right, 30 px before to 30 px
    # behind: both ends are clear of the walls, but √(8² - 7²) px before the nearest point the disc
    # of radius 8 touches the corner (left of and below it there, so no wall's side comes first).
    s = math.sqrt(0.5)
    start = (100 - 7 * s - 30 * s, 100 - 7 * s + 30 * s, -math.pi / 4)
    env = calm(start={"pose": start}, robot=LONG, ends_at_goal=False)
    end = np.array(start[:2]) + 60 * s * np.array([1, -1])
    assert env.floor_plan.free([start[:2], end], 8.0).all()
    info = drive(env, [(60, 0)])[0][4]
    assert info["collided"]
    way = 30 - math.sqrt(8**2 - 7**2) - SKIN
    expected = (start[0] + way * s, start[1] - way * s)
    np.testing.assert_allclose(info["truth"][:2], expected, rtol=0, atol=EXACT)


def test_a_wall_is_met_by_the_rim_even_if_the_centre_stays_clear_of_it():
    # Straight at the wall x = 0, but the centre never reaches it: from 12 to 6 px is too near.
    env = calm(start={"pose": (12, 150, math.pi)}, ends_at_goal=False)
    info = drive(env, [(6, 0)])[0][4]
    assert info["collided"]
    np.testing.assert_allclose(info["truth"][:2], (8 + SKIN, 150), rtol=0, atol=EXACT)


def test_a_stopped_robot_can_turn_and_drive_away():
    env = calm(start={"pose": (340, 50, 0.0)}, robot=LONG, ends_at_goal=False)
    assert drive(env, [(60, 0)])[0][4]["collided"]
    before = env.pose
    turned, away = drive(env, [(0, math.pi), (20, 0)])
    assert not turned[4]["collided"]
    assert not away[4]["collided"]
    np.testing.assert_array_equal(turned[4]["truth"][:2], before[:2])
    # π in float32 is off by 9e-8 rad: 2e-6 px over 20 px
    np.testing.assert_allclose(away[4]["truth"][:2], (before[0] - 20, before[1]), rtol=0, atol=2e-6)


def test_a_turn_on_the_spot_never_collides():
    env = calm(start={"pose": (340, 50, 0.0)}, ends_at_goal=False)
    drive(env, [(10, 0)])
    assert not any(said[4]["collided"] for said in drive(env, [(0, 0.7)] * 20))


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
    commands = np.float32(
        np.column_stack([agent.uniform(0, 60, n), agent.uniform(-math.pi, math.pi, n)])
    ).clip(env.action_space.low, env.action_space.high)
    infos = [info] + [env.step(command)[4] for command in commands]
    poses = np.array([info["truth"] for info in infos])
    return poses, commands, np.array([info["collided"] for info in infos[1:]])


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
    np.testing.assert_array_equal(
        walls.collides(starts, ends, radius)[clear_cut], collided[clear_cut]
    )
    # Free steps end where they were to; stopped ones on the way there, less than the way.
    way = np.linalg.norm(poses[1:, :2] - starts, axis=1)
    np.testing.assert_allclose(
        poses[1:, :2], starts + way[:, None] * directions, rtol=0, atol=EXACT
    )
    np.testing.assert_allclose(way[~collided], commands[~collided, 0], rtol=0, atol=EXACT)
    assert (way[collided] < commands[collided, 0]).all()
    # A stopped robot stands at the contact: nearer than SKIN or, if it started there, not moved.
    gap = reference.clearance(walls.walls, poses[1:], poses[1:]) - radius
    assert gap[collided].max() <= SKIN + EXACT


def swept(walls: list[pymunk.Shape], radius: float, start, distance: float, heading: float):
    """Where a drive ends and whether it is stopped, sweeping a disc at each thin wall in turn."""
    x, y = start
    end = (x + distance * math.cos(heading), y + distance * math.sin(heading))
    if any(wall.point_query((x, y)).distance < radius for wall in walls):
        return start, True
    met = [wall.segment_query((x, y), end, radius) for wall in walls]
    first = min((contact.alpha for contact in met if contact is not None), default=None)
    if first is None:
        return end, False
    share = max(first - SKIN / abs(distance), 0.0)
    return (x + share * (end[0] - x), y + share * (end[1] - y)), True


@pytest.mark.parametrize("radius", [8.0, 0.0])
@pytest.mark.parametrize("plan", [PAPER, SEVERAL, SPIKE], ids=["paper", "several", "spike"])
def test_a_point_among_grown_walls_drives_like_a_disc_among_thin_ones(plan, radius):
    floor_plan = PolygonMap(**plan)
    thin = Walls(floor_plan, 0.0).space.shapes
    physics = Physics(Walls(floor_plan, radius), (50.0, 50.0))
    agent = np.random.default_rng(11)
    stopped = 0
    for i in range(10_000):
        if i % 20 == 0:  # anywhere, also where it overlaps a wall
            physics.place(tuple(agent.uniform((0, 0), floor_plan.bounds[2:]).tolist()))
        heading = agent.uniform(-math.pi, math.pi) if i % 4 else agent.integers(8) * math.pi / 4
        distance = agent.uniform(*((-5, 5), (0, 10), (0, 60))[i % 3])
        position, collided = swept(thin, radius, physics.position, distance, heading)
        assert physics.drive(distance, heading) == collided
        assert math.dist(physics.position, position) < EXACT
        stopped += collided
    assert 0.1 < stopped / 10_000 < 0.9  # both answers occur


@pytest.mark.parametrize("plan", [PAPER, SEVERAL, SPIKE], ids=["paper", "several", "spike"])
def test_the_robot_never_overlaps_a_wall_on_thousands_of_noisy_steps(plan):
    noise = {"drive": 0.3, "turn": 0.3, "drift": 0.01}
    poses, _, _ = random_drives(plan, 8.0, 4000, noise)
    walls = PolygonMap(**plan).walls
    assert reference.clearance(walls, poses[:-1], poses[1:]).min() > 8.0  # on the way, too
    assert (reference.winding(walls, poses) == 1).all()  # inside the room, in no obstacle
