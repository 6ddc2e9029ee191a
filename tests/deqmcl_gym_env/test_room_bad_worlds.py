"""Worlds that cannot be are refused when they are made, in one sentence that names the field."""

import math
import tracemalloc

import gymnasium as gym
import pytest
from room_cases import PAPER
from room_trace import ROOM_ID

from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps import Lidar
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.config import Lap, MotionNoise, Robot, Start

OUTER = PAPER["outer"]


def refused(text: str, **kwargs) -> str:
    """Make the env by gymnasium; its refusal must be one line and say ``text``."""
    with pytest.raises(InputError) as caught:
        gym.make(ROOM_ID, **kwargs)
    message = str(caught.value)
    assert text in message
    assert len(message.splitlines()) == 1
    assert message.endswith(".")
    return message


@pytest.mark.parametrize(
    ("pose", "text"),
    [
        ((150, 150, 0), "start.pose is (150, 150, 0), where a robot of radius 8 px touches"),
        ((175, 7, 0), "start.pose is (175, 7, 0)"),  # nearer to the wall than the radius
        ((-50, 50, 0), "start.pose is (-50, 50, 0)"),
        ((math.nan, 50, 0), "start.pose is [nan, 50.0, 0.0]"),
        ((175, 50, 90), "90° would be 1.571"),
        ("here", "start.pose is 'here'"),
    ],
)
def test_a_bad_start_pose_is_refused_by_name(pose, text):
    refused(text, start={"pose": pose})


@pytest.mark.parametrize(
    ("part", "field", "value"),
    [
        ("robot", "radius", -0.1), ("robot", "max_distance", 0), ("robot", "max_turn", 3.2),
        ("noise", "drive", -0.1), ("noise", "turn", math.nan), ("noise", "drift", math.inf),
        ("start", "sd_position", "1"), ("start", "sd_heading", True), ("lidar", "beams", 0),
        ("lidar", "field_of_view", 6.3), ("lidar", "max_range", 0), ("lidar", "sigma", -0.1),
        ("lap", "step", 0), ("lap", "turn", 3.2),
    ],
)  # fmt: skip
def test_a_size_just_outside_its_range_or_none_at_all_is_refused_by_name(part, field, value):
    refused(f"{part}.{field} is {value!r}", **{part: {field: value}})


@pytest.mark.parametrize(
    "parts",
    [
        {"noise": MotionNoise(drive=0, turn=0, drift=0)},
        {"lidar": Lidar(sigma=0, field_of_view=2 * math.pi, beams=8)},
        {"robot": Robot(max_turn=math.pi, radius=0)},
        {"start": Start(pose=(175, 50, -2 * math.pi))},
        {"lap": Lap(turn=math.pi / 4)},
    ],
)
def test_sizes_at_the_end_of_their_range_are_fine(parts):
    env = RoomEnv(**parts)
    env.reset(seed=0)
    assert not env.step(env.plan[0])[4]["collided"]


def test_a_robot_wider_than_the_passage_is_refused():
    refused("radius 50 px: give a smaller robot", robot={"radius": 50})
    refused("radius 1000 px", robot={"radius": 1000})


@pytest.mark.parametrize(
    ("floor_plan", "text"),
    [
        ({"outer": []}, "the outer wall"),
        ({"obstacles": []}, "the outer wall is None"),
        ({"outer": OUTER, "obstacles": [[[100, -9], [200, -9], [200, 99], [100, 99]]]},
         "the obstacle corner (100, -9) lies on or outside the outer wall"),
        ({"outer": OUTER, "walls": []}, "unknown key in floor_plan 'walls'"),
        ([OUTER], "floor_plan is"),
    ],
)  # fmt: skip
def test_a_bad_floor_plan_is_refused(floor_plan, text):
    refused(text, floor_plan=floor_plan)


@pytest.mark.parametrize(
    ("waypoints", "text"),
    [
        ([(50, 50), (300, 50)], "lap.waypoints has 2 corners"),
        ([(50, 50), (300, 50), (300, math.nan)], "lap.waypoints is"),
        ([(50, 50), (300, 50), (300, 250), (50, 50)], "has (50, 50) twice in a row"),
        ([(50, 50), (300, 50), (300, 50), (50, 250)], "has (300, 50) twice in a row"),
        ([(50, 50), (300, 250), (50, 250)], "the lap touches a wall between (50, 50)"),
        ([(50, 50), (400, 50), (50, 250)], "the lap touches a wall between (50, 50)"),
    ],
)
def test_bad_waypoints_are_refused(waypoints, text):
    refused(text, lap={"waypoints": waypoints})


def test_a_lap_the_robot_cannot_do_is_refused():
    refused("lap.step is 11, but the robot can do at most 10", lap={"step": 11.0})
    refused("lap.turn is 1, but the robot can do at most 0.785398", lap={"turn": 1.0})


@pytest.mark.parametrize(
    ("kwargs", "nearest"),
    [
        ({"preset": "papr"}, "'paper'"),
        ({"lidar": {"beam": 3}}, "'beams'"),
        ({"robot": {"radios": 3}}, "'radius'"),
        ({"noise": {"drives": 3}}, "'drive'"),
        ({"start": {"sd_positions": 3}}, "'sd_position'"),
        ({"lap": {"waypoint": 3}}, "'waypoints'"),
        ({"floor_plan": {"outter": OUTER}}, "'outer'"),
    ],
)
def test_an_unknown_name_is_answered_with_the_nearest_one(kwargs, nearest):
    refused(f"did you mean {nearest}?", **kwargs)


def test_a_part_of_the_wrong_kind_is_refused():
    refused("lidar is 3, but must be a Lidar or a mapping of beams", lidar=3)
    refused("robot is ", robot=Lidar())


@pytest.mark.parametrize("horizon", [0, -1, 1.5, "all", True])
def test_a_horizon_without_a_plan_is_refused(horizon):
    refused("horizon is ", horizon=horizon)


SIZES = {
    "horizon": ({"horizon": 10**9}, "horizon is 1000000000, but must be a whole number from 1 to"),
    "lap.step": ({"lap": {"step": 1e-6}}, "about 9e+08 steps, but a plan may have at most 100,000"),
    "lap.step, endless": ({"lap": {"step": 5e-324}}, "about inf steps"),
    "lap.turn": ({"lap": {"turn": 1e-7}}, "about 6.28e+07 steps"),
    "beams": ({"lidar": {"beams": 10**6}}, "lidar.beams is 1000000"),
    "frame": (
        {
            "floor_plan": {"outer": [[0, 0], [1e5, 0], [1e5, 1e5], [0, 1e5]]},
            "render_mode": "rgb_array",
        },
        "a picture of the floor plan would have 200016 x 200016 pixels, but may have at most 8,192",
    ),
}


@pytest.mark.parametrize("name", SIZES)
def test_what_is_too_large_is_refused_before_memory_is_taken(name):
    kwargs, text = SIZES[name]
    tracemalloc.start()
    refused(text, **kwargs)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # Refused sizes would take 10 MB to 100 GB. A floor plan's own check of its space and the
    # import of the drawing take 2 to 4 MB.
    assert peak < 8e6


def test_the_widest_lidar_draws_its_noise_in_few_rows():
    env = RoomEnv(lidar={"beams": 100_000})
    env.reset(seed=0)
    tracemalloc.start()
    env.step(env.plan[0])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20 * 100_000 * 8  # not 256 rows of noise


@pytest.mark.parametrize("value", ["no", "False", 0, 1, None, []])
def test_what_is_no_truth_value_is_refused(value):
    refused("ends_at_goal is ", ends_at_goal=value)


@pytest.mark.parametrize(
    ("text", "kwargs"),
    [
        ("start.pose is ['175', '50', '0']", {"start": {"pose": ["175", "50", "0"]}}),
        ("start.pose is ('175', 50, 0)", {"start": {"pose": ("175", 50, 0)}}),
        ("start.pose is (True, False, True)", {"start": {"pose": (True, False, True)}}),
        ("lap.waypoints is ", {"lap": {"waypoints": [["50", "50"], [300, 50], [300, 250]]}}),
        ("the outer wall is ", {"floor_plan": {"outer": [["0", "0"], ["1", "0"], ["0", "1"]]}}),
    ],
)
def test_words_that_spell_numbers_are_no_numbers(text, kwargs):
    refused(text, **kwargs)


def test_a_start_that_cannot_see_the_lap_is_refused():
    # A recess at the left, open only at its upper end: the lap's nearest point lies behind a wall.
    wall = [[60, 0], [64, 0], [64, 200], [60, 200]]
    floor_plan = {"outer": OUTER, "obstacles": [wall, *PAPER["obstacles"]]}
    lap = {"waypoints": [(82, 50), (300, 50), (300, 250), (82, 250)]}
    refused(
        "the straight way from start.pose (30, 100) to the lap at (82, 100) touches a wall",
        floor_plan=floor_plan, lap=lap, start={"pose": (30, 100, 0.0)},
    )  # fmt: skip
    env = RoomEnv(floor_plan=floor_plan, lap=lap, start={"pose": (30, 240, 0.0)})
    env.reset(seed=0)  # from beside the upper end it can


def test_a_start_that_hardly_ever_fits_is_refused_at_reset():
    env = gym.make(ROOM_ID, start={"sd_position": 1e9})
    with pytest.raises(InputError, match=r"none of 1000 starts drawn around \(175, 50\) is free"):
        env.reset(seed=0)
