"""RoomEnv keeps Gymnasium's contract: import, ids, spaces, what info says, frames, processes."""

import copy
import inspect
import math
import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from deqmcl_command import python
from room_cases import ROOM_ID, STILL, calm, hall

import deqmcl_gym
from deqmcl_gym.envs import RoomEnv, RoomInfo
from deqmcl_gym.envs.vector import RoomVectorEnv
from deqmcl_gym.maps import GridMap
from deqmcl_gym.validation import InputError
from deqmcl_gym.world import WORLDS as WORLDS_BY_NAME
from deqmcl_gym.world.drawing import BLACK, GRAY, PALE, Drawing, View

MAKE = 'assert gymnasium.make("deqmcl_gym/Room-v0").reset(seed=1)[1]["planned_count"] == 204'
FIRST_CALL = "numba.core.typing.cffi_utils"  # which the first call of a kernel loads
STRICT = "-W", "error::UserWarning", "-c"
MANY = 'gymnasium.make_vec("deqmcl_gym:deqmcl_gym/Room-v0", num_envs=2, vectorization_mode="{}")'
OTHERWISE = {"clutter": {}, "people": {}, "ends_at_goal": False}
ARRAYS = {"planned_actions": np.float32, "command": np.float32, "truth": np.float64}
PAGE = (Path(deqmcl_gym.__file__).parents[1] / "docs" / "environment.md").read_text("utf-8")
SCALE, MARGIN = 2.0, 8  # View's defaults: image pixels per px, image pixels around


def test_what_is_not_needed_is_not_loaded():
    unused = "seen = set(sys.modules) & {}; assert not seen, seen".format
    steps = [
        "import sys, deqmcl_gym.maps",
        unused({"gymnasium", "pymunk", "cv2", "benchmarks", "localizers", FIRST_CALL}),
        "import localizers; localizers.names()",
        unused({"gymnasium", "pymunk", "cv2", "benchmarks"}),
        f"import gymnasium; {MANY.format('vector_entry_point')}",
        unused({"pymunk"}),
    ]
    python(*STRICT, "; ".join(steps))


@pytest.mark.parametrize(
    "code",
    [
        f"import gymnasium, deqmcl_gym; {MAKE}",
        f"import localizers, gymnasium; {MAKE}",
        f"import gymnasium; {MANY.format('sync')}.reset(seed=1)",
    ],
)
def test_the_id_is_known_in_whatever_order_things_are_imported(code):
    python(*STRICT, code)


@pytest.mark.parametrize("preset", WORLDS_BY_NAME)
def test_each_preset_has_an_id_of_its_own_for_one_room_and_for_many(preset):
    name = f"deqmcl_gym/{preset.capitalize()}-v0"
    env, same = gym.make(name), RoomEnv(preset=preset)
    assert env.unwrapped.world == same.world
    assert (same.world.driver is not None) == (preset == "guided")
    np.testing.assert_equal(env.reset(seed=3), same.reset(seed=3))
    assert isinstance(gym.make_vec(name, num_envs=2), RoomVectorEnv)


def test_a_world_can_be_given_whole_and_changed_in_part():
    world = WORLDS_BY_NAME["guided"].changed(lidar={"beams": 5})
    env = RoomEnv(world=world, noise={"drive": 0.3})
    assert env.world == world.changed(noise={"drive": 0.3})
    with pytest.raises(InputError, match="world is 'guided', but must be a World"):
        RoomEnv(world="guided")


def test_a_dict_shows_the_plan_the_share_of_the_lap_and_of_the_time():
    env = RoomEnv(preset="sharp", observation="dict", horizon=4, noise=STILL)
    for _ in range(2):
        seen, info = env.reset(seed=0)
        for step in range(20):
            assert env.observation_space.contains(seen)
            np.testing.assert_array_equal(seen["plan"], info["planned_actions"])
            assert seen["progress"] == pytest.approx(5 * step / 900)
            assert seen["clock"] == pytest.approx(step / 204)
            seen, *_, info = env.step(env.plan[step])
    plain = RoomEnv(preset="sharp", noise=STILL)
    np.testing.assert_array_equal(env.reset(seed=7)[0]["scan"], plain.reset(seed=7)[0])


def test_a_journey_may_be_longer_than_the_limit_of_the_room():
    route = {"min_length": 45.0}  # m: 450 drives of 0.1 m
    env = gym.make("deqmcl_gym/Journey-v1", route=route, driver="none")
    cut = gym.make(deqmcl_gym.ENV_ID, floor_plan={"office": {}}, route=route)
    assert env.spec.max_episode_steps is None
    env.reset(seed=0)
    cut.reset(seed=0)
    planned = len(env.unwrapped.plan)
    assert planned > 450
    stand = np.zeros(2, np.float32)
    said = [env.step(stand)[2:4] for _ in range(planned)]
    assert said == [(False, False)] * (planned - 1) + [(False, True)]
    assert [cut.step(stand)[3] for _ in range(408)] == [False] * 407 + [True]


def test_spaces_are_the_documented_boxes():
    env = RoomEnv(lidar={"beams": 4, "max_range": 123.0}, robot={"max_turn": 0.5})
    assert env.observation_space == gym.spaces.Box(0.0, 123.0, (4,), np.float32)
    low, high = np.float32([0, -0.5]), np.float32([10, 0.5])
    assert env.action_space == gym.spaces.Box(low, high, dtype=np.float32)


@pytest.mark.parametrize(
    ("context", "world"), [("fork", {}), ("spawn", {"preset": "guided"}), ("spawn", OTHERWISE)]
)
def test_rooms_in_processes_of_their_own_say_what_rooms_in_this_one_say(context, world):
    """Each hashes strings otherwise, and has imported nothing of ours before."""
    kwargs = {"num_envs": 2, "horizon": 20, **world}
    own = {"vectorization_mode": "async", "vector_kwargs": {"context": context}}
    away = gym.make_vec(ROOM_ID, **own, **kwargs)
    here = gym.make_vec(ROOM_ID, vectorization_mode="sync", **kwargs)
    try:
        told = here.reset(seed=11)
        np.testing.assert_equal(away.reset(seed=11), told)
        for step in range(200):
            actions = told[-1]["planned_actions"][:, 0].copy()
            actions[0, 1] += 0.2 * (step % 7 == 6)
            actions = actions.clip(here.action_space.low, here.action_space.high)
            told = here.step(actions)
            np.testing.assert_equal(away.step(actions), told)
    finally:
        away.close()


@pytest.mark.parametrize("horizon", [None, 1, 1000])
def test_info_has_its_types_and_shapes_and_the_plan_shows_the_next_actions_and_then_zeros(horizon):
    env = RoomEnv(horizon=horizon, ends_at_goal=False)
    plan, rows = env.plan, horizon or len(env.plan)
    shapes = {"planned_actions": (rows, 2), "command": (2,), "truth": (3,)}
    _, info = env.reset(seed=0)
    infos = [info]
    for action in plan:
        infos.append(env.step(action)[4])
        np.testing.assert_array_equal(infos[-1]["truth"], env.pose)
    for step, info in enumerate(infos):
        assert set(info) == RoomInfo.__required_keys__
        assert type(info["planned_count"]) is np.int64
        assert type(info["collided"]) is type(info["is_success"]) is np.float64
        for key, dtype in ARRAYS.items():
            assert (info[key].dtype, info[key].shape) == (dtype, shapes[key])
            assert np.isfinite(info[key]).all()
        count = min(rows, len(plan) - step)
        assert info["planned_count"] == count
        np.testing.assert_array_equal(info["planned_actions"][:count], plan[step : step + count])
        assert not info["planned_actions"][count:].any()


def test_action_is_the_command_before_noise_and_contact():
    env = RoomEnv(start={"pose": (335, 50, 0.0)}, noise={"drive": 0.5, "turn": 0.5})
    _, info = env.reset(seed=0)
    np.testing.assert_array_equal(info["command"], np.zeros(2, np.float32))
    assert not info["collided"]
    for command in ([9.7, 0.1], [9.7, 0.0], [0.3, 0.2]):  # into the wall x = 350
        before = env.pose
        info = env.step(np.array(command))[4]  # float64 is cast
        np.testing.assert_array_equal(info["command"], np.float32(command))
        way = np.hypot(info["truth"][0] - before[0], info["truth"][1] - before[1])
        assert way != pytest.approx(command[0], abs=1e-3)  # noise or contact: not what was done


@pytest.mark.parametrize("heading", [math.pi, 4.0, -2 * math.pi])
def test_the_heading_of_truth_is_wrapped_from_the_start(heading):
    start = {"pose": (175, 50, heading), "sd_heading": 1.0}
    env = RoomEnv(start=start, noise=STILL, ends_at_goal=False)
    truths = [env.reset(seed=seed)[1]["truth"] for seed in range(50)]
    assert all(-math.pi <= truth[2] < math.pi for truth in truths)
    still = env.step(np.zeros(2, np.float32))[4]["truth"]
    np.testing.assert_allclose(still, truths[-1], rtol=0, atol=1e-15)  # wrapping may round
    away = [math.remainder(truth[2] - heading, 2 * math.pi) for truth in truths]
    assert abs(sum(away)) < 5 * math.sqrt(50)  # around the pose asked for: 5 standard errors


def test_what_is_done_to_returned_arrays_and_frames_matters_to_nobody():
    spoiled, other = (RoomEnv(horizon=20, render_mode="rgb_array") for _ in range(2))
    plan = np.array(spoiled.plan)
    spoiled.plan[...] = 7
    said, kept = spoiled.reset(seed=2), [other.reset(seed=2)]
    then = copy.deepcopy(kept)
    for action in plan[:60]:
        for array in (said[0], *(said[-1][key] for key in ARRAYS)):
            array[...] = 7
        given = action.copy()
        said = spoiled.step(given)
        given[...] = 7
        kept.append(other.step(action))
        then.append(copy.deepcopy(kept[-1]))
        np.testing.assert_equal(said, kept[-1])
        spoiled.render()[...] = 7
        np.testing.assert_array_equal(spoiled.render(), spoiled.render())
    np.testing.assert_equal(kept, then)
    np.testing.assert_array_equal(spoiled.render(), other.render())  # its first picture


def test_every_key_of_info_and_further_argument_of_the_vector_env_is_documented():
    further = set(inspect.signature(RoomVectorEnv).parameters) - {"room", "render_mode"}
    for name in (*RoomInfo.__annotations__, *further):
        assert re.search(rf"^\| `{name}` \| ", PAGE, re.MULTILINE)


def test_the_robots_gray_disc_is_where_the_robot_is_with_y_up():
    frame = calm(start={"pose": (60, 240, 0.0)}, render_mode="rgb_array").render()
    assert frame.dtype == np.uint8
    rows, columns = np.nonzero((frame == GRAY).all(axis=2))
    # the nose line covers a little of its right half; row 0 is the top, y = 300
    assert abs(rows.mean() - ((300 - 240) * SCALE + MARGIN)) < 1
    assert abs(columns.mean() - (60 * SCALE + MARGIN)) < 2
    # A disc of radius 16 image pixels, less a rim of 2 and a nose line of 4 × 16 at most.
    assert math.pi * 14**2 - 64 <= len(rows) <= math.pi * 16**2


def test_obstacles_are_pale_walls_dark_and_the_floor_white():
    frame = calm(render_mode="rgb_array").render()
    obstacle, side, wall, floor = (frame[-8 - 2 * 120, 8 + 2 * x] for x in (150, 100, 0, 30))
    assert (tuple(obstacle), tuple(floor)) == (PALE, (255, 255, 255))
    assert max(side) < 60 > max(wall)


def test_without_a_render_mode_there_is_no_frame_but_a_warning():
    with pytest.warns(UserWarning, match=r'render\(\) needs .*render_mode="rgb_array"'):
        assert calm().render() is None


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
