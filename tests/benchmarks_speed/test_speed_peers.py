"""Peers do the same work: rays end where ours do, filters estimate what ours estimates."""

from importlib import import_module

import numpy as np
import pytest
import reference

from benchmarks.speed import numpy_baseline
from benchmarks.speed.lap import fan, free_poses, recorded_lap
from deqmcl_gym.world.paper_room import PAPER_ROOM
from localizers import make

PARTICLES, RUNS, STEPS = 500, 12, 30


def peer(name):
    library = {"navground": "navground.core", "raycast2d": "raycast2D"}.get(name, name)
    pytest.importorskip(library)
    return import_module(f"benchmarks.speed.peers.{name}")


def estimates(filter_of):
    """Mean (x, y, cos θ, sin θ) at the end of each of some runs along the lap."""
    lap, ends = recorded_lap(), []
    for seed in range(RUNS):
        np.random.seed(seed)  # noqa: NPY002 (peers draw from the global generator)
        update = filter_of(lap.robot, PARTICLES, lap.prior, np.random.default_rng(seed))
        for t in range(STEPS):
            poses, weights = update(lap.scans[t], lap.plan[t], lap.plan[t + 1 :])
        x, y, heading = np.asarray(poses, dtype=float).T
        ends.append(np.average([x, y, np.cos(heading), np.sin(heading)], axis=1, weights=weights))
    return np.array(ends)


def our_mcl(robot, particles, prior, rng):
    localizer = make("mcl", robot, particles=particles)
    localizer.reset(prior, recorded_lap().plan, rng)
    return lambda *step: localizer.update(*step).points()


@pytest.fixture(scope="module")
def ours():
    return estimates(our_mcl)


@pytest.mark.parametrize("name", ["NumPy", "particles", "pfilter", "stonesoup"])
def test_anothers_estimates_are_ours_within_their_scatter(name, ours):
    theirs = estimates(numpy_baseline.mcl if name == "NumPy" else peer(name).mcl)
    error = np.sqrt((ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / RUNS)
    # Welch's t with some 15 to 22 degrees of freedom; |t| > 5 in 4 components: below 1 in 1,000
    assert (np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) < 5 * error).all()
    assert error[:2].max() < 2.0  # px: agreement means something


@pytest.mark.parametrize("beams", [16, 360])
def test_navground_sees_the_exact_ranges(beams):
    ranges = peer("navground").caster(PAPER_ROOM, beams)
    poses, bearings = free_poses(PAPER_ROOM, 100), fan(beams).bearings
    seen = np.array([ranges(pose) for pose in poses.tolist()])
    # it adds up the step between beams in float32: each sum below 2π is off by 2.4e-7 rad at most
    turn = 2e-6 + 2.4e-7 * beams
    around = [reference.ranges(PAPER_ROOM.walls, poses, bearings + s * turn) for s in (-1, 0, 1)]
    slack = 1e-3  # px, of coordinates in float32
    assert (seen >= np.min(around, axis=0) - slack).all()
    assert (seen <= np.max(around, axis=0) + slack).all()


def test_raycast2d_hits_pixels_that_the_same_beams_meet():
    hits_at = peer("raycast2d").caster(PAPER_ROOM, 16)
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
