"""Ray casting, against others in the paper's room."""

from collections.abc import Callable, Sequence

import numpy as np
import pymunk

from benchmarks.speed import numpy_baseline
from benchmarks.speed.figure import Figure, Sides, require
from benchmarks.speed.lap import BEAMS, fan, free_poses
from benchmarks.speed.timing import Job
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.numerics.types import Singles
from deqmcl_gym.world.paper_room import PAPER_ROOM

POSES = 20_000
POSES_OF_MANY_BEAMS = 1_000
POSES_ONE_BY_ONE = 100  # for those who are asked for a pose at a time
FAR = 1000.0  # px, beyond every wall
ALL_AROUND = 360

Segment = tuple[tuple[float, float], tuple[float, float]]


def bearings_of(beams: int) -> Singles:
    """Return the bearings of a fan all around, (beams,) rad."""
    return fan(beams).bearings.astype(np.float32)


def our_job(poses: int = POSES, beams: int = BEAMS) -> Job:
    """Return the job of ``PolygonMap.ranges``."""
    cloud, bearings = free_poses(PAPER_ROOM, poses), bearings_of(beams)
    return Job(call=lambda: PAPER_ROOM.ranges(cloud, bearings), amount=poses * beams)


def numpy_job(caster: Callable[[PolygonMap], numpy_baseline.Caster]) -> Job:
    """Return the job of a NumPy baseline: ``segments`` or ``slabs``."""
    cloud = np.ascontiguousarray(free_poses(PAPER_ROOM, POSES).T)
    bearings, cast = bearings_of(BEAMS), caster(PAPER_ROOM)
    return Job(
        call=lambda: numpy_baseline.ranges(cloud, bearings, cast),
        amount=POSES * BEAMS,
    )


def pymunk_room() -> pymunk.Space:
    """Return a space with the room's walls."""
    space = pymunk.Space()
    for x0, y0, x1, y1 in PAPER_ROOM.walls.tolist():
        space.add(pymunk.Segment(space.static_body, (x0, y0), (x1, y1), 0.0))
    return space


def segments(poses: Singles, bearings: Singles) -> list[Segment]:
    """Return each ray of each pose as a segment that reaches beyond the walls."""
    angles = (poses[:, 2, None] + bearings).ravel()
    starts = np.repeat(poses[:, :2], bearings.size, axis=0)
    ends = starts + FAR * np.column_stack([np.cos(angles), np.sin(angles)])
    pairs = np.stack([starts, ends], axis=1).tolist()
    return [((x0, y0), (x1, y1)) for (x0, y0), (x1, y1) in pairs]


def pymunk_ranges(space: pymunk.Space, rays: Sequence[Segment]) -> list[float]:
    """Return the distance along each ray by ``Space.segment_query_first``."""
    seen = pymunk.ShapeFilter()
    found = [space.segment_query_first(start, end, 0.0, seen) for start, end in rays]
    return [FAR if first is None else FAR * first.alpha for first in found]


def pymunk_job() -> Job:
    """Return the job of pymunk's queries; the ends of the rays are computed beforehand."""
    space = pymunk_room()
    rays = segments(free_poses(PAPER_ROOM, POSES_ONE_BY_ONE), bearings_of(BEAMS))
    return Job(call=lambda: pymunk_ranges(space, rays), amount=len(rays))


def navground_sides(beams: int) -> Sides:
    """Return our job and navground's, with ``beams`` a call."""
    require("navground.core")
    from benchmarks.speed.peers.navground import NavgroundCaster

    caster = NavgroundCaster(PAPER_ROOM, beams)
    poses = free_poses(PAPER_ROOM, POSES_ONE_BY_ONE).tolist()

    def cast() -> None:
        for pose in poses:
            caster.ranges(pose)

    ours = our_job(POSES if beams == BEAMS else POSES_OF_MANY_BEAMS, beams)
    return ours, Job(call=cast, amount=len(poses) * beams)


def raycast2d_sides() -> Sides:
    """Return our job and raycast2D's."""
    require("raycast2D")
    from benchmarks.speed.peers.raycast2d import GridCaster

    caster = GridCaster(PAPER_ROOM, BEAMS)
    poses = free_poses(PAPER_ROOM, POSES_ONE_BY_ONE)
    poses = poses[PAPER_ROOM.free(poses, radius=2.0)].tolist()  # not in a wall's pixels

    def cast() -> None:
        for pose in poses:
            caster.hits(pose)

    return our_job(), Job(call=cast, amount=len(poses) * BEAMS)


_ROOM = f"rays in the paper's room, {POSES:,} poses × {BEAMS} beams"

FIGURES = (
    Figure(
        name="rays_vs_numpy",
        task=_ROOM,
        ours="PolygonMap.ranges",
        other="NumPy, all walls, float32 in blocks",
        unit="rays/s",
        target=8,
        sides=lambda: (our_job(), numpy_job(numpy_baseline.segments)),
    ),
    Figure(
        name="rays_vs_numpy_slabs",
        task=_ROOM,
        ours="PolygonMap.ranges",
        other="NumPy, slab method, float32 in blocks",
        unit="rays/s",
        sides=lambda: (our_job(), numpy_job(numpy_baseline.slabs)),
    ),
    Figure(
        name="rays_vs_pymunk",
        task=_ROOM,
        ours="PolygonMap.ranges",
        other="pymunk, a segment query a ray",
        unit="rays/s",
        target=1_000,
        sides=lambda: (our_job(), pymunk_job()),
    ),
    Figure(
        name="rays_vs_navground",
        task=f"rays in the paper's room, {ALL_AROUND} beams a pose",
        ours="PolygonMap.ranges",
        other=f"navground, {ALL_AROUND} beams a call",
        unit="rays/s",
        target=10,
        sides=lambda: navground_sides(ALL_AROUND),
        peer="navground",
    ),
    Figure(
        name="rays_vs_navground_16",
        task=_ROOM,
        ours="PolygonMap.ranges",
        other=f"navground, {BEAMS} beams a call",
        unit="rays/s",
        sides=lambda: navground_sides(BEAMS),
        peer="navground",
    ),
    Figure(
        name="rays_vs_raycast2d",
        task=_ROOM,
        ours="PolygonMap.ranges, exact",
        other=f"raycast2D, pixels of 1 px, {BEAMS} beams a call",
        unit="rays/s",
        sides=raycast2d_sides,
        peer="raycast2D",
    ),
)
