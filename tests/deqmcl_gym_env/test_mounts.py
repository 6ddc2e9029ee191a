"""A lidar of several scanners: exact rays from each, blind sectors, a range floor, upside down."""

import math
import pickle
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import reference
from refusals import refused

import deqmcl_gym  # noqa: F401  # registers the environments
from deqmcl_gym.maps import Lidar, Mount
from localizers.inference import checked_step

BACK_TO_BACK = (Mount(x=5.0, y=2.0, heading=0.3), Mount(x=-6.0, y=-1.0, heading=math.pi))
TWO = Lidar(beams=14, field_of_view=1.2 * math.pi, max_range=400.0, sigma=0.0, mounts=BACK_TO_BACK)


def room(lidar, **how):
    return gym.make("deqmcl_gym/Room-v0", preset="guided", lidar=lidar, **how)


def exact(pose, mount, walls):
    """Ranges of the seven beams of a mount, in float64."""
    own = np.linspace(-0.5, 0.5, 7) * TWO.field_of_view
    bearings = mount.heading + (-own if mount.upside_down else own)
    return reference.ranges(walls, reference.mounted([pose], (mount.x, mount.y)), bearings)[0]


@pytest.mark.parametrize("upside_down", [False, True])
def test_the_beams_of_each_scanner_are_exact_from_where_it_is_mounted(upside_down):
    mounts = (BACK_TO_BACK[0], Mount(x=-6.0, y=-1.0, heading=2.0, upside_down=upside_down))
    env = room(replace(TWO, mounts=mounts), ends_at_goal=False)
    scan, info = env.reset(seed=3)
    walls = env.unwrapped.floor_plan.walls
    for _ in range(12):
        pose = env.unwrapped.pose
        expected = np.concatenate([exact(pose, one, walls) for one in mounts])
        # float32 at 400 px: half a step is 1.5e-5 px, over a few additions and a corner's slant
        np.testing.assert_allclose(scan, np.minimum(expected, 400.0), atol=2e-3)
        scan, _, _, _, info = env.step(info["planned_actions"][0])


def test_one_mount_in_the_centre_is_the_plain_lidar_to_the_bit():
    plain = room({"beams": 9, "field_of_view": 3.0})
    mounted = room({"beams": 9, "field_of_view": 3.0, "mounts": [(0.0, 0.0, 0.0)]})
    (scan, info), (same, _) = plain.reset(seed=1), mounted.reset(seed=1)
    for _ in range(20):
        np.testing.assert_array_equal(scan, same)
        action = info["planned_actions"][0]
        scan, _, _, _, info = plain.step(action)
        same = mounted.step(action)[0]


def test_a_blind_sector_and_the_range_floor_lose_readings_and_change_no_other():
    free = replace(TWO, sigma=5.0)
    blind = (BACK_TO_BACK[0], replace(BACK_TO_BACK[1], blind=((-0.7, 0.7),)))
    held = replace(free, mounts=blind, min_range=60.0)
    hidden = np.abs(np.linspace(-0.6 * math.pi, 0.6 * math.pi, 7)) <= 0.7
    hidden = np.concatenate([np.zeros(7, bool), hidden])
    assert hidden.any()
    np.testing.assert_array_equal(held.blind, hidden)
    one, other = room(free), room(held)
    (scan, info), (less, _) = one.reset(seed=2), other.reset(seed=2)
    short = 0
    for _ in range(20):
        lost = hidden | (scan < 60.0)
        short += int((scan < 60.0).sum())
        np.testing.assert_array_equal(less, np.where(lost, np.inf, scan))
        # a filter that is given the raw scan uses the same readings
        taken, _, _ = checked_step(scan, info["command"], info["planned_actions"], held)
        np.testing.assert_array_equal(taken.usable, ~lost)
        action = info["planned_actions"][0]
        scan, _, _, _, info = one.step(action)
        less = other.step(action)[0]
    assert short > 0


def test_sectors_may_cross_the_back_and_turn_with_an_upside_down_scanner():
    mount = Mount(heading=1.0, upside_down=True, blind=((2.0, -2.0),))
    own = np.linspace(-3.0, 3.0, 25)
    np.testing.assert_array_equal(mount.hides(mount.seen(own)), np.abs(own) >= 2.0)


def test_it_survives_a_pickle_and_mounts_may_be_rows():
    lidar = Lidar(beams=6, mounts=BACK_TO_BACK, min_range=3.0)
    assert pickle.loads(pickle.dumps(lidar)) == lidar
    rows = [(one.x, one.y, one.heading) for one in BACK_TO_BACK]
    assert Lidar(beams=6, mounts=rows, min_range=3.0) == lidar


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"beams": 5}, "must be a multiple of 2"),
        ({"beams": 5, "mounts": [{"beams": 2}, {"beams": 4}]}, "with the sum"),
        ({"mounts": [{"beams": 3}, {}]}, "to none or to all"),
        ({"mounting": (1.0, 0.0)}, "give only one of them"),
        ({"mounts": "front"}, "must be a list of mounts"),
        ({"mounts": [{"heading": 180.0}] * 2}, "heading of a mount"),
        ({"mounts": [{"blind": [[0, 90]]}] * 2}, "angles from -2π to 2π"),
        ({"min_range": 500.0}, "lidar.min_range"),
    ],
)
def test_a_bad_mounting_is_refused(given, said):
    with refused(said):
        Lidar(**{"beams": 4, "mounts": BACK_TO_BACK, **given})
