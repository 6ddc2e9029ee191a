"""Worlds that cannot be, and bad calls, are refused in one sentence, and nothing has happened."""

import math
import tracemalloc
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from refusals import refused
from room_cases import PAPER, ROOM_ID, SMALL, WORLD, WRAPPED, calm, drive

from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.envs.belief import BeliefObservation
from deqmcl_gym.envs.vector import RoomVectorEnv
from deqmcl_gym.envs.wrappers import BeamDropout, Kidnap
from deqmcl_gym.maps import Lidar, Office, PolygonMap
from deqmcl_gym.validation import InputError
from deqmcl_gym.world import Lap, MotionNoise, Robot, Start
from localizers import RobotModel, UniformPrior, make

OUTER = PAPER["outer"]
HUGE = {"outer": [[0, 0], [1e5, 0], [1e5, 1e5], [0, 1e5]]}
# A recess at the left, open only at its upper end: the lap's nearest point lies behind a wall.
RECESS = {"outer": OUTER, "obstacles": [[[60, 0], [64, 0], [64, 200], [60, 200]],
                                        *PAPER["obstacles"]]}  # fmt: skip
BESIDE = {"waypoints": [(82, 50), (300, 50), (300, 250), (82, 250)]}
HALL = {"outer": [[0, 0], [300, 0], [300, 300], [0, 300]]}


@pytest.mark.parametrize(
    ("text", "kwargs"),
    [
        ("start.pose is (150, 150, 0), where a robot of radius 8 px touches",
         {"start": {"pose": (150, 150, 0)}}),
        ("90° would be 1.571", {"start": {"pose": (175, 50, 90)}}),
        ("from start.pose (30, 100) to the lap at (82, 100) touches a wall",
         {"floor_plan": RECESS, "lap": BESIDE, "start": {"pose": (30, 100, 0.0)}}),
        ("radius 50 px: give a smaller robot", {"robot": {"radius": 50}}),  # touching collides
        ("the obstacle corner (100, -9) lies on or outside the outer wall",
         {"floor_plan": {"outer": OUTER,
                         "obstacles": [[[100, -9], [200, -9], [200, 99], [100, 99]]]}}),
        ("lap.waypoints has 2 corners", {"lap": {"waypoints": [(50, 50), (300, 50)]}}),
        ("has (50, 50) twice in a row",
         {"lap": {"waypoints": [(50, 50), (300, 50), (300, 250), (50, 50)]}}),
        ("the lap touches a wall between (50, 50) and (300, 250)",
         {"lap": {"waypoints": [(50, 50), (300, 250), (50, 250)]}}),
        ("lap.step is 11, but must be at most 10", {"lap": {"step": 11.0}}),
        ("did you mean 'beams'?", {"lidar": {"beam": 3}}),
        ("lidar.mounting is (6.0, -6.0), 8.485 px from the robot's centre, but its radius is 8",
         {"lidar": {"mounting": (6, -6)}}),
        ("unknown render_mode 'ansi'", {"render_mode": "ansi"}),
        # too large: these would take 10 MB to 100 GB
        ("horizon is 1000000000, but must be a whole number from 1 to", {"horizon": 10**9}),
        ("about 9e+08 steps, but may have at most 100,000", {"lap": {"step": 1e-6}}),
        ("lidar.beams is 1000000", {"lidar": {"beams": 10**6}}),
        ("a picture of the floor plan would have 200016 x 200016 pixels, but may have at most "
         "8,192", {"floor_plan": HUGE, "render_mode": "rgb_array"}),
        ('or "none" for no driver', {"driver": "nobody"}),
        ("give another driver.look_ahead", {"driver": {"look_ahead": 300}}),
        ("does not complete the lap in 408 steps", {"driver": {"look_ahead": 0.3}}),  # overshoots
    ],
)  # fmt: skip
def test_a_world_that_cannot_be_is_refused_in_one_sentence_before_memory_is_taken(text, kwargs):
    tracemalloc.start()
    with refused(text):
        gym.make(ROOM_ID, **kwargs)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # A floor plan's own check of its space and the import of the drawing take 2 to 4 MB.
    assert peak < 8e6


def on_a_route(**kwargs):
    env = RoomEnv(**({"floor_plan": {"office": SMALL}} | WORLD | kwargs))
    env.reset(seed=0)
    return env


def believing(**kwargs):
    env = on_a_route(**kwargs)
    robot = RobotModel(floor_plan=env.floor_plan, lidar=env.lidar, radius=env.radius)
    return BeliefObservation(env, make("mcl", robot), UniformPrior(floor_plan=env.floor_plan))


def begun(**kwargs):
    RoomEnv(**kwargs).reset(seed=0)


LOCALIZE, TRACK = "deqmcl_gym/Localize-v0", "deqmcl_gym/Track-v0"
WIDE = {"outer": [[0, 0], [2000, 0], [2000, 2000], [0, 2000]], "unit": "m"}
CLOSED = PAPER | {"obstacles": [[(150, 5), (160, 5), (160, 295), (150, 295)]]}
APART = {"floor_plan": CLOSED, "start": {"pose": (50, 50, 0)}, "route": {"goal": (300, 50)}}
MADE = [
    (RoomEnv, {"changed_walls": {"share": 0.51}}, "changed_walls.share is 0.51"),
    (RoomEnv, {"people": {"number": 1001}}, "people.number is 1001"),
    (RoomEnv, {"glass": {"lost": -0.5}}, "glass.lost is -0.5"),
    (RoomEnv, {"clutter": {"size": (20, 10)}}, "the second of clutter.size is 10"),
    (RoomEnv, {"clutter": {"where": "wall"}}, "did you mean 'walls'?"),
    (RoomEnv, {"clutter": "lots"}, 'or "none" for no clutter'),
    (RoomEnv, {"floor_plan": HALL, "changed_walls": {}}, "give an office or a ROS map"),
    (RoomEnv, {"floor_plan": Office(seed=0).grid}, "lap.waypoints is None, but a lap can only"),
    (on_a_route, {"changed_walls": {"distance": 0.05}}, "whole cells of 0.1 m"),
    (begun, {"clutter": {"size": (300, 300)}}, "give another clutter.where"),
    (begun, {"people": {"number": 9, "radius": 70}}, "there is no room for people.number = 9"),
    (on_a_route, {"route": {"min_length": 20, "max_length": 10}}, "at most route.max_length, 10"),
    (on_a_route, {"route": {"goal": (0.1, 0.1)}}, "the route.goal (0.1, 0.1) is less than 0.3 m"),
    (on_a_route, {"start": {"pose": (0.1, 0.1, 0)}}, "give a place in free space"),
    (on_a_route, {"robot": {"radius": 3.0}}, "no place for a robot that needs 3.05 m"),
    (on_a_route, {"lap": {"waypoints": [(1, 1), (2, 1), (2, 2)]}}, "a route or lap.waypoints"),
    (RoomVectorEnv, {"floor_plan": {"office": {"seeds": [0, 9]}}, "num_envs": 2}, "give a route"),
    (believing, {"floor_plan": {"office": {"seeds": [0, 9]}}}, "take Localize-v0"),
    (lambda pose: Kidnap(RoomEnv(), step=2, pose=pose), {"pose": (150, 150, 0)}, "the pose"),
    (partial(Kidnap, gym.Env()), {"step": 1}, "needs deqmcl_gym/Room-v0"),
    (lambda share: BeamDropout(RoomEnv(), share), {"share": 1.1}, "from 0 to 1"),
    (on_a_route, {"observation": "dict", "horizon": 5, "goal": "left"}, "unknown goal 'left'"),
    (RoomEnv, {"plan": "no"}, "plan is 'no'"),
    (RoomEnv, {"plan": False}, 'part of observation="dict" only'),
    (RoomEnv, {"goal": "relative"}, "take Journey-v1"),
    (begun, {"start": {"pose": (50, 50, 0)}, "route": {"goal": (60, 50)}}, "places farther apart"),
    (begun, APART, "there is no route from (50, 50) to (300, 50)"),
    (on_a_route, {"route": {"min_length": 500, "max_length": 600}}, "no route of 500 to 600 m was"),
    (RoomEnv, {"lidar": {"mounts": [(9.0, 0.0, 0.0)]}}, "a place in lidar.mounts is (9.0, 0.0)"),
    (partial(gym.make_vec, ROOM_ID), {"num_envs": 2, "route": {}}, "horizon=50"),
    (partial(gym.make, TRACK), {"localizer": {"particles": 3}}, "a name, or a mapping with a name"),
    (partial(gym.make, LOCALIZE), {"hold": 0}, "hold is 0"),
    (lambda **far: gym.make(TRACK, **far).reset(seed=0), {"least": 900}, "goal 900 px apart"),
    (partial(gym.make, LOCALIZE, scan="table"), {"floor_plan": WIDE}, "take 6,103 MiB, but may"),
    (RoomVectorEnv, {"num_envs": 0}, "num_envs is 0"),
    (RoomVectorEnv, {"lidr": 1}, "keyword argument 'lidr': did you mean 'lidar'"),
    (RoomVectorEnv, {"autoreset_mode": "samestep"}, "did you mean 'SameStep'"),
]


@pytest.mark.parametrize(("make", "kwargs", "text"), MADE)
def test_what_cannot_be_is_refused_by_name_when_it_is_made(make, kwargs, text):
    with refused(text):
        make(**kwargs)


@pytest.mark.parametrize(
    "parts",
    [
        {"noise": MotionNoise(drive=0, turn=0, drift=0)},
        {"lidar": Lidar(sigma=0, field_of_view=2 * math.pi, beams=8)},
        {"robot": Robot(max_turn=math.pi, radius=0)},
        {"robot": Robot(radius=49.9)},  # of 50 px to the walls
        {"lidar": Lidar(mounting=(0, -8))},
        {"start": Start(pose=(175, 50, -2 * math.pi))},
        {"floor_plan": RECESS, "lap": BESIDE, "start": Start(pose=(30, 240, 0.0))},
        {"lap": Lap(turn=math.pi / 4)},
    ],
)
def test_what_just_fits_is_fine(parts):
    env = RoomEnv(**parts)
    env.reset(seed=0)
    assert not env.step(env.plan[0])[4]["collided"]


BAD_ACTIONS = {
    "None": None,
    "word": "drive",
    "a batch of one": np.zeros((1, 2), np.float32),
    "NaN": [np.nan, 0.0],
    "beyond float32": [1e300, 0.0],
    "backwards": [-0.01, 0.0],
    "too far": [10.01, 0.0],
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", BAD_ACTIONS)
@pytest.mark.parametrize("wrap", WRAPPED)
def test_a_bad_action_is_refused_and_leaves_no_trace(wrap, name):
    env, other = (WRAPPED[wrap](RoomEnv(lidar={"beams": 3})) for _ in range(2))
    for one in (env, other):
        one.reset(seed=9)
        drive(one, np.zeros((1, 2)))  # the next step is the wrappers'
    with pytest.raises(InputError, match=r"the action is .*, but must be two numbers") as caught:
        env.step(BAD_ACTIONS[name])
    assert len(str(caught.value).splitlines()) == 1
    for _ in range(10):
        action = np.float32([1.0, 0.2])
        np.testing.assert_equal(env.step(action), other.step(action))


@pytest.mark.parametrize("action", [[5, 0], (10.0, 0.0), np.array([0.0, -math.pi / 4])])
def test_two_real_numbers_of_any_kind_within_the_space_are_an_action(action):
    info = calm().step(action)[4]
    assert info["command"].dtype == np.float32
    np.testing.assert_array_equal(info["command"], np.float32(action))


def test_no_step_follows_the_end_until_reset():
    env = calm(ends_at_goal=False)
    drive(env, np.zeros((204, 2)))
    pose = env.pose
    for _ in range(2):
        with pytest.raises(RuntimeError, match=r"the episode has ended: call reset\(\)"):
            env.step(np.zeros(2, np.float32))
    assert env.pose == pose
    assert env.elapsed_steps == 204
    env.reset()
    assert env.step(env.plan[0])[2] is False


@pytest.mark.parametrize("seed", [2**63, np.uint32(5)])
def test_whole_numbers_of_any_size_and_kind_are_seeds(seed):
    one, two = RoomEnv(), RoomEnv()
    np.testing.assert_equal(one.reset(seed=seed, options={}), two.reset(seed=int(seed)))


BAD_RESETS = {
    "seed is -1, but must be a whole number of 0 or more": {"seed": -1},
    "options is 5, but must be None": {"seed": 1, "options": 5},
    r"none of 1000 starts drawn around \(175, 50\) is free": {"seed": 3},
    "none of 1000 starts .* is free": {},  # in the next episode
}


@pytest.mark.parametrize("text", BAD_RESETS)
def test_a_refused_reset_leaves_the_episode_and_all_random_streams_as_they_were(text, monkeypatch):
    env, other = (RoomEnv(preset="matched", lidar={"beams": 3}) for _ in range(2))
    for one in (env, other):
        one.reset(seed=9)
        drive(one, one.plan[:5])
    rng = env.np_random.bit_generator.state
    with monkeypatch.context() as patched:
        if "none of" in text:
            patched.setattr(PolygonMap, "free", lambda *_: np.array([False]))
        with pytest.raises(InputError, match=text):
            env.reset(**BAD_RESETS[text])
    assert env.pose == other.pose
    assert env.elapsed_steps == 5
    assert (env.np_random_seed, env.np_random.bit_generator.state) == (9, rng)
    for action in env.plan[5:15]:
        np.testing.assert_equal(env.step(action), other.step(action))
    np.testing.assert_equal(env.reset(), other.reset())  # the next episode of the same seed


@pytest.mark.parametrize("pose", [(150, 150, 0), (5, 50, 0), (400, 50, 0), (np.nan, 50, 0), (1, 2)])
def test_the_robot_is_only_put_where_it_fits(pose):
    env = calm()
    before = env.pose
    with pytest.raises(InputError, match="the pose"):
        env.place(pose)
    assert env.pose == before
