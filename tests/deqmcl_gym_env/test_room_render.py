"""Frames show the world where it is, and drawing has no side effects."""

import math

import numpy as np
import pytest
from room_cases import calm

from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.world.drawing import GRAY, ORANGE, PALE, PINK, Drawing, View
from deqmcl_gym.world.presets import PAPER_ROOM

SCALE, MARGIN = 2.0, 8  # View's defaults: image pixels per px, image pixels around


def at(image: np.ndarray, x: float, y: float) -> tuple:
    """The colour at a point of the 350 × 300 room; rows count downwards from y = 300."""
    return tuple(image[round((300 - y) * SCALE + MARGIN), round(x * SCALE + MARGIN)].tolist())


def pixels_of(image: np.ndarray, color: tuple) -> int:
    return int((image == color).all(axis=2).sum())


@pytest.mark.parametrize("side", [100.0, 100.3, 101.0])
def test_frames_of_odd_floor_plans_are_even_and_large_enough(side):
    room = PolygonMap([(0, 0), (side, 0), (side, 2 * side + 0.25), (0, 2 * side + 0.25)])
    width, height = View(room).size
    assert (width % 2, height % 2) == (0, 0)
    assert width >= side * SCALE + 2 * MARGIN
    assert height >= (2 * side + 0.25) * SCALE + 2 * MARGIN


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


def test_points_are_dots_at_their_pixels_and_those_outside_the_frame_are_left_out():
    far = [(-40, 50), (50, -40), (390, 50), (50, 340), (-1e6, 1e6), (-354, 150), (175, 604)]
    blank = Drawing(View(PAPER_ROOM)).image
    np.testing.assert_array_equal(Drawing(View(PAPER_ROOM)).points(far, PINK).image, blank)
    image = Drawing(View(PAPER_ROOM)).points([(30, 60), (330, 280)], ORANGE).image
    assert at(image, 30, 60) == at(image, 330, 280) == ORANGE
    # Half of a dot on the frame's left edge: 2 of its 3 columns, and nothing at the right.
    image = Drawing(View(PAPER_ROOM)).points([(-MARGIN / SCALE, 150)], PINK).image
    assert pixels_of(image[:, :2], PINK) == pixels_of(image, PINK) == 2 * 3


def test_beams_end_at_their_ranges_and_beams_without_a_number_are_left_out():
    blank = Drawing(View(PAPER_ROOM)).image
    fan = [-math.pi / 2, 0.0, math.pi / 2]
    drawn = (
        Drawing(View(PAPER_ROOM))
        .beams([(175, 60, angle) for angle in fan], [20.0, math.inf, math.nan])
        .image
    )
    changed = (drawn != blank).any(axis=2)
    rows, columns = np.nonzero(changed)
    assert abs(columns - (175 * SCALE + MARGIN)).max() <= 1  # one vertical line
    top, bottom = ((300 - y) * SCALE + MARGIN for y in (60, 40))
    assert abs(rows.min() - top) <= 1
    assert abs(rows.max() - bottom) <= 1
