"""A lidar that is not in the robot's centre: where its rays start, in rooms and in their logs."""

import math

import gymnasium as gym
import numpy as np
import pytest
import reference
from room_cases import PAPER, STILL
from room_trace import ROOM_ID

import deqmcl_gym  # noqa: F401  # registers the envs
from deqmcl_gym import logs
from deqmcl_gym.envs.wrappers import RecordLog
from deqmcl_gym.maps import PolygonMap

PLACES = [(5.0, 0.0), (-4.0, 6.0)]  # px; the robot's radius is 8
FAN = {"beams": 9, "field_of_view": 2 * math.pi, "sigma": 0.0, "max_range": 1000.0}
# float32 positions of up to 350 px: 3e-5 px, along a slant or past a corner some more
NEAR = 1e-2


def exact(poses, place, bearings) -> np.ndarray:
    """Ranges seen from a place on robots, by plain trigonometry in float64."""
    x, y, heading = np.asarray(poses, float).T
    (ahead, aside), cosine, sine = place, np.cos(heading), np.sin(heading)
    at = np.column_stack(
        [x + ahead * cosine - aside * sine, y + ahead * sine + aside * cosine, heading]
    )
    plan = PolygonMap(outer=PAPER["outer"], obstacles=PAPER["obstacles"])
    return reference.ranges(plan.walls, at, bearings)


def driven(env, steps: int):
    """Scans, poses and infos of the planned drive."""
    scan, info = env.reset(seed=4)
    said = [(scan, info)]
    for _ in range(steps):
        scan, *_, info = env.step(info["planned_actions"][0])
        said.append((scan, info))
    scans, infos = zip(*said, strict=True)
    return np.array(scans), np.array([info["truth"] for info in infos]), infos


@pytest.mark.parametrize("place", PLACES)
def test_rays_start_at_the_mounting_and_nothing_else_changes(place):
    ahead, centred = (
        gym.make(ROOM_ID, floor_plan=PAPER, lidar={**FAN, "mounting": one})
        for one in (place, (0.0, 0.0))
    )
    scans, poses, infos = driven(ahead, 60)
    others, same, infos_there = driven(centred, 60)
    np.testing.assert_array_equal(poses, same)  # poses are the robot's
    for one, other in zip(infos, infos_there, strict=True):
        np.testing.assert_array_equal(one["planned_actions"], other["planned_actions"])
        np.testing.assert_array_equal(one["action"], other["action"])
    bearings = ahead.unwrapped.lidar.bearings
    np.testing.assert_allclose(scans, exact(poses, place, bearings), rtol=0, atol=NEAR)
    np.testing.assert_allclose(others, exact(poses, (0, 0), bearings), rtol=0, atol=NEAR)
    assert np.abs(scans - others).max() > 1.0


@pytest.mark.parametrize("ending", [".log", ".csv", ".npz", ".mcap"])
def test_a_room_recorded_with_a_mounting_is_played_back_with_it(tmp_path, ending):
    place = PLACES[1]
    room = RecordLog(
        gym.make(ROOM_ID, floor_plan=PAPER, noise=STILL, lidar={**FAN, "mounting": place})
    )
    scans, poses, _ = driven(room, 30)
    logs.write(room.log, tmp_path / f"x{ending}")
    back = gym.make("deqmcl_gym/Log-v0", log=tmp_path / f"x{ending}", map=PAPER)
    assert back.unwrapped.lidar.mounting == pytest.approx(place)
    again, truth, infos = driven(back, 30)
    np.testing.assert_array_equal(again, scans)
    np.testing.assert_allclose(truth, poses, rtol=0, atol=1e-9)
    # what the log's lidar would see from the poses that the log tells
    lidar = back.unwrapped.lidar
    seen = exact(truth, lidar.mounting, lidar.bearings)
    np.testing.assert_allclose(again, seen, rtol=0, atol=NEAR)
    # without noise the odometry is that of the robot's centre, wherever its lidar is
    x, y, heading = poses[0]
    told = logs.motion.dead_reckoned([info["action"] for info in infos[1:]], (x, y, heading))
    np.testing.assert_allclose(told, poses, rtol=0, atol=1e-3)
