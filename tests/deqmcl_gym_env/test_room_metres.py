"""Rooms in metres are the same rooms."""

import numpy as np
import pytest
from room_cases import PAPER, SEVERAL

import deqmcl_gym  # noqa: F401  # registers the envs
from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.envs.vector import RoomVectorEnv
from deqmcl_gym.maps import Lidar
from deqmcl_gym.maps.map import scaled
from deqmcl_gym.validation import InputError
from deqmcl_gym.world import WORLDS, Driver, Lap

M = 0.02  # to the px
CLOSE = 350 * 1e-5  # of the room's width, px
ROUGH = {"drive": 0.3, "turn": 0.3}  # drift is per length, so it is left to the preset


def metres(plan: dict) -> dict:
    outer = (np.array(plan["outer"]) * M).tolist()
    obstacles = [(np.array(one) * M).tolist() for one in plan.get("obstacles", ())]
    return {"outer": outer, "obstacles": obstacles, "unit": "m"}


def assert_alike(px: dict, m: dict) -> None:
    near = {"rtol": 0, "atol": CLOSE}
    np.testing.assert_allclose(m["truth"][..., :2] / M, px["truth"][..., :2], **near)
    turned = (m["truth"] - px["truth"])[..., 2]
    np.testing.assert_allclose(np.sin(turned / 2), 0, atol=1e-5)
    for key in ("planned_actions", "command"):
        np.testing.assert_allclose(m[key] / (M, 1), px[key], **near)
    np.testing.assert_array_equal(m["planned_count"], px["planned_count"])
    np.testing.assert_array_equal(m["collided"], px["collided"])


def pair(make, plan: dict, **kwargs):
    return make(floor_plan=plan, **kwargs), make(floor_plan=metres(plan), **kwargs)


def assert_same_episode(px, m, commands=None) -> int:
    """Drive both through an episode, by their plans or by commands in px; return the contacts."""
    (scan, said), (other, told) = px.reset(seed=3), m.reset(seed=3)
    contacts, ended, step = 0, False, 0
    while not ended:
        np.testing.assert_allclose(other / M, scan, rtol=0, atol=CLOSE)
        assert_alike(said, told)
        action = said["planned_actions"][..., 0, :] if commands is None else commands[step]
        scan, reward, *ends, said = px.step(np.float32(action))
        other, earned, *overs, told = m.step(np.float32(action * np.float64([M, 1])))
        np.testing.assert_allclose(np.asarray(earned) / M, reward, rtol=0, atol=CLOSE)
        np.testing.assert_array_equal(overs, ends)
        ended = np.any(ends)
        contacts += np.sum(said["collided"])
        step += 1
    assert step > 150
    return int(contacts)


@pytest.mark.parametrize("preset", WORLDS)
def test_an_episode_along_the_plan_is_the_same_with_and_without_a_driver(preset):
    assert_same_episode(*pair(RoomEnv, PAPER, preset=preset))


@pytest.mark.parametrize(
    ("make", "plan", "batch", "kwargs"),
    [
        (RoomEnv, PAPER, (), {"ends_at_goal": False}),
        (RoomEnv, SEVERAL, (), {"ends_at_goal": False}),
        (RoomVectorEnv, PAPER, (6,), {"num_envs": 6}),
    ],
)
def test_rough_driving_with_contacts_is_the_same_in_one_room_and_in_many(make, plan, batch, kwargs):
    commands = np.random.default_rng(4).uniform((5, -0.6), (10, 0.6), (1000, *batch, 2))
    envs = pair(make, plan, lidar={"beams": 5}, noise=ROUGH, **kwargs)
    assert assert_same_episode(*envs, commands) > 20


def test_changes_and_whole_parts_are_in_the_units_of_the_map():
    room = metres(PAPER)
    world = WORLDS["guided"].changed(floor_plan=room, robot={"radius": 0.1}, lidar=Lidar(sigma=1.0))
    assert (world.robot.radius, world.robot.max_distance) == (0.1, 10 * M)
    assert (world.lidar.sigma, world.lidar.max_range) == (1.0, 400.0)
    assert (world.noise.drift, world.noise.turn) == (0.02 / M, 0.2)
    assert WORLDS["paper"].changed(floor_plan=room, driver={}).driver == scaled(Driver(), M)
    back = world.changed(floor_plan=PAPER)
    assert back.robot.radius == pytest.approx(0.1 / M)
    assert back.lap == Lap()


def test_sentences_say_the_unit_of_the_map():
    env = RoomEnv(floor_plan=metres(PAPER))
    env.reset(seed=0)
    with pytest.raises(InputError, match=r"from 0 to 0\.2 m and"):
        env.step(np.float32([5.0, 0.0]))
    for changed in ({"start": {"pose": (0, 0, 0)}}, {"robot": {"radius": 1.2}}):
        with pytest.raises(InputError, match=r"radius [0-9.]+ m"):
            RoomEnv(floor_plan=metres(PAPER), **changed)
