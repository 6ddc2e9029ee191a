"""Rays of others end where ours do, to what their arithmetic resolves."""

from importlib import import_module

import numpy as np
import pytest
import reference

from benchmarks.speed import numpy_baseline
from benchmarks.speed.lap import bearings_of, fan, free_poses
from benchmarks.speed.rays import pymunk_queries
from benchmarks.speed.scaling import pillared_room
from deqmcl_gym.world.config import PAPER_ROOM

SINGLE = 2e-6  # rad: θ + b, sine and cosine in float32, |θ + b| ≤ 2π, are off by less


def numpy_ranges(caster, poses, beams):
    return caster(PAPER_ROOM)(np.ascontiguousarray(poses.T), bearings_of(beams)).T


def pymunk_ranges(poses, beams):
    return np.reshape(pymunk_queries(poses, bearings_of(beams))(), (len(poses), beams))


def navground_ranges(poses, beams):
    pytest.importorskip("navground.core")
    ranges = import_module("benchmarks.speed.peers.navground").caster(PAPER_ROOM, beams)
    return np.array([ranges(pose) for pose in poses.tolist()])


@pytest.mark.parametrize(
    ("cast", "beams", "turn", "slack"),
    [  # px: a product, a quotient and differences of coordinates to 350 or, the last two, to 1,000
        (lambda *rays: numpy_ranges(numpy_baseline.segments, *rays), 16, SINGLE, 5e-4),
        (lambda *rays: numpy_ranges(numpy_baseline.slabs, *rays), 16, SINGLE, 5e-4),
        (pymunk_ranges, 16, SINGLE, 1e-3),
        # it adds up the step between beams: each sum below 2π is off by 2.4e-7 rad at most
        (navground_ranges, 16, SINGLE + 16 * 2.4e-7, 1e-3),
        (navground_ranges, 360, SINGLE + 360 * 2.4e-7, 1e-3),
    ],
    ids=["NumPy", "NumPy slabs", "pymunk", "navground 16", "navground 360"],
)
def test_ranges_are_exact_within_a_turn_that_float32_cannot_resolve(cast, beams, turn, slack):
    poses = free_poses(PAPER_ROOM, 3_000)  # the NumPy baseline takes them in several blocks
    bearings = bearings_of(beams)
    around = [reference.ranges(PAPER_ROOM.walls, poses, bearings + s * turn) for s in (-1, 0, 1)]
    low, high = np.min(around, axis=0), np.max(around, axis=0)
    seen = cast(poses, beams)
    assert ((seen >= low - slack) & (seen <= high + slack)).all()
    assert np.median(high - low) < 0.02  # the bracket is narrow: the test can fail


def test_raycast2d_hits_pixels_that_the_same_beams_meet():
    pytest.importorskip("raycast2D")
    hits_at = import_module("benchmarks.speed.peers.raycast2d").caster(PAPER_ROOM, 16)
    poses, bearings = free_poses(PAPER_ROOM, 200, radius=2.0), fan(16).bearings
    poses[:, :2] = np.floor(poses[:, :2]) + 0.5  # pixels' centres: where it starts from
    for pose in poses:
        hits = hits_at(pose.tolist()) + 0.5
        # a wall within 1.5 px (a pixel's diagonal) of every hit
        points = np.column_stack([hits, np.zeros(len(hits))])
        assert (reference.clearance(PAPER_ROOM.walls, points, points) <= 1.5).all()
        # and it lies on the beam: ends rounded by half a pixel at 500 px, lines by half a pixel
        to_hit = hits - pose[:2]
        directions = pose[2] + bearings
        across = to_hit[:, 1] * np.cos(directions) - to_hit[:, 0] * np.sin(directions)
        assert (np.abs(across) <= 1.5).all()


@pytest.mark.parametrize("segments", [8, 16, 64, 512])
def test_the_pillared_room_has_as_many_walls_as_asked_for_and_pillars_apart(segments):
    room = pillared_room(segments)
    assert len(room.walls) == segments
    assert room.free(free_poses(room, 100)).all()
    corners = np.array(room.obstacles).reshape(-1, 2)
    assert ((corners > 0) & (corners < 400)).all()
