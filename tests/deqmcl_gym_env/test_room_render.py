"""Frames show the world where it is, and drawing has no side effects."""

import math

import numpy as np
import pytest
from room_cases import calm

from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.world.drawing import GRAY, PALE

SCALE, MARGIN = 2.0, 8  # View's defaults: image pixels per px, image pixels around


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


def test_rendering_changes_nothing_and_every_frame_is_fresh():
    seen, unseen = RoomEnv(render_mode="rgb_array"), RoomEnv()
    scans = [env.reset(seed=1)[0] for env in (seen, unseen)]
    np.testing.assert_array_equal(*scans)
    for action in seen.plan[:30]:
        first, second = seen.render(), seen.render()
        np.testing.assert_array_equal(first, second)
        first[...] = 0
        np.testing.assert_array_equal(seen.render(), second)
        np.testing.assert_equal(seen.step(action), unseen.step(action))


def test_without_a_render_mode_there_is_no_frame_but_a_warning():
    with pytest.warns(UserWarning, match=r'render\(\) needs .*render_mode="rgb_array"'):
        assert calm().render() is None
