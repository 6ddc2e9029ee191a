"""FloorPlan.ranges against pymunk and against the plain NumPy reference.

The law: a range is the exact range of some pose within 1e-3 px and 1e-5 rad of the one asked for.
Needed because float32 cannot do better near a corner, where an arbitrarily small turn changes the
wall that is hit. Tested by perturbing the pose: half of the allowance goes to the perturbations
(5e-4 px, 5e-6 rad), the other half to the distance along the beam. For one and the same wall the
range is continuous in the pose, so every value between its least and its greatest is taken.
"""

from itertools import product

import numpy as np
import pymunk
import pytest
from sample_plans import PLANS, anywhere, awkward_poses, space_of

from deqmcl_gym.floorplan import FloorPlan, Lidar, reference

N = 12_000
HALF_PX, HALF_RAD = 5e-4, 5e-6
EVERYTHING = pymunk.ShapeFilter()


def by_reference(plan: FloorPlan, pose: np.ndarray) -> tuple[float, object]:
    """Range straight ahead and the wall it ends at."""
    each = [reference.ranges(wall[None], pose[None], [0.0])[0, 0] for wall in plan.walls]
    return min(each), int(np.argmin(each))


def by_pymunk(space: pymunk.Space, pose: np.ndarray) -> tuple[float, object]:
    x, y, heading = pose.tolist()
    end = (x + 2000 * np.cos(heading), y + 2000 * np.sin(heading))
    hit = space.segment_query_first((x, y), end, 0.0, EVERYTHING)
    return (np.inf, None) if hit is None else (2000 * hit.alpha, hit.shape)


def is_range_of_a_pose_nearby(seen: float, pose: np.ndarray, cast) -> bool:
    spread: dict[object, list[float]] = {}
    for dx, dy, turn in product((-1, 0, 1), repeat=3):
        moved = pose + (dx * HALF_PX, dy * HALF_PX, turn * HALF_RAD)
        exact, wall = cast(moved)
        spread.setdefault(wall, []).append(exact)
    return any(min(r) - HALF_PX <= seen <= max(r) + HALF_PX for r in spread.values())


def violations(seen: np.ndarray, exact: np.ndarray, poses: np.ndarray, cast) -> list[np.ndarray]:
    """Poses whose range is not the exact one of any pose nearby."""
    suspects = np.flatnonzero(~(np.abs(seen - exact) <= HALF_PX))
    return [
        poses[i] for i in suspects if not is_range_of_a_pose_nearby(float(seen[i]), poses[i], cast)
    ]


def inside_the_outer_wall(plan: FloorPlan, poses: np.ndarray) -> np.ndarray:
    """Poses (k, 3) inside the outer wall, clear of it by more than float32 resolves."""
    outer = plan.walls[: len(plan.outer)]
    clear = reference.clearance(outer, poses, poses) > 1e-3
    return poses[clear & (reference.winding(outer, poses[:, :2]) == 1)]


@pytest.mark.parametrize("name", PLANS)
def test_each_range_is_the_references_range_of_a_pose_nearby(name):
    plan = PLANS[name]
    poses = inside_the_outer_wall(plan, awkward_poses(plan, N, np.random.default_rng(1)))
    assert len(poses) > 10_000 or name == "hall"
    seen = plan.ranges(poses, [0.0])[:, 0]
    exact = reference.ranges(plan.walls, poses, [0.0])[:, 0]
    assert violations(seen, exact, poses, lambda pose: by_reference(plan, pose)) == []


@pytest.mark.parametrize("name", PLANS)
def test_each_range_is_pymunks_range_of_a_pose_nearby(name):
    plan, space = PLANS[name], space_of(PLANS[name])
    poses = inside_the_outer_wall(plan, awkward_poses(plan, N, np.random.default_rng(2)))
    seen = plan.ranges(poses, [0.0])[:, 0]
    exact = np.array([by_pymunk(space, pose)[0] for pose in poses])
    assert violations(seen, exact, poses, lambda pose: by_pymunk(space, pose)) == []


@pytest.mark.parametrize("change", [lambda r: r + 2e-3, lambda r: r - 2e-3])
def test_the_law_notices_a_range_that_is_two_thousandths_of_a_pixel_off(change):
    plan = PLANS["room"]
    pose = np.array([50.0, 50.0, 0.3])
    exact = reference.ranges(plan.walls, pose[None], [0.0])[0, 0]
    cast = lambda near: by_reference(plan, near)  # noqa: E731
    assert is_range_of_a_pose_nearby(exact, pose, cast)
    assert not is_range_of_a_pose_nearby(change(exact), pose, cast)


@pytest.mark.parametrize("name", PLANS)
def test_no_beam_from_inside_the_outer_wall_escapes(name):
    plan = PLANS[name]
    poses = inside_the_outer_wall(plan, awkward_poses(plan, 100_000, np.random.default_rng(3)))
    seen = plan.ranges(poses, [0.0])
    x0, y0, x1, y1 = plan.bounds
    assert np.isfinite(seen).all()
    assert seen.min() >= 0
    assert seen.max() <= np.hypot(x1 - x0, y1 - y0)


def test_beams_are_turned_by_their_bearings_and_stand_in_columns():
    plan, lidar = PLANS["hall"], Lidar(beams=7, field_of_view=2.0)
    rng = np.random.default_rng(4)
    poses = np.column_stack([anywhere(plan, 500, rng), rng.uniform(-np.pi, np.pi, 500)])
    poses = inside_the_outer_wall(plan, poses)
    fan = plan.ranges(poses, lidar.bearings)
    assert fan.shape == (len(poses), 7)
    for beam, bearing in enumerate(lidar.bearings):
        turned = poses + (0.0, 0.0, bearing)
        exact = reference.ranges(plan.walls, turned, [0.0])[:, 0]
        assert violations(fan[:, beam], exact, turned, lambda p: by_reference(plan, p)) == []


@pytest.mark.parametrize("n", [0, 1, 63, 64, 65, 200])
def test_a_pose_has_the_same_bits_in_every_block(n):
    plan, lidar = PLANS["room"], Lidar(beams=3)
    rng = np.random.default_rng(5)
    poses = np.column_stack([rng.uniform(10, 90, (n, 2)), rng.uniform(-3, 3, n)])
    together = plan.ranges(poses, lidar.bearings)
    assert together.shape == (n, 3)
    for pose, fan in zip(poses, together, strict=True):
        assert np.array_equal(plan.ranges(pose[None], lidar.bearings)[0], fan)
