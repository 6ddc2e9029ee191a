"""Ray casting, against others in the paper's room."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pymunk

from benchmarks.studies.speed import peers
from benchmarks.studies.speed.figure import Figure, Job, Published, Side
from benchmarks.studies.speed.numpy_baseline import CasterMaker, segments, slabs
from benchmarks.studies.speed.work import BEAMS, fan, free_poses, office_floor, pillared_room
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Singles
from deqmcl_gym.world.presets import PAPER_ROOM

POSES = 20_000
POSES_ONE_BY_ONE = 100  # for those who are asked for a pose at a time
FAR = 1000.0  # px, beyond every wall


def bearings_of(beams: int) -> Singles:
    """Return the bearings of a lidar that looks all around, (beams,) rad."""
    return fan(beams).bearings.astype(np.float32)


def our_job(room: Map, poses: int, beams: int = BEAMS) -> Job:
    """Return the job of ``Map.ranges``."""
    cloud, bearings = free_poses(room, poses), bearings_of(beams)
    return Job(lambda: room.ranges(cloud, bearings), poses * beams)


def office_job(spread: float | None = None) -> Job:
    """Return the job of ``GridMap.ranges``: a cloud all over the map, or N(pose, spread² m²)."""
    floor, bearings = office_floor(), bearings_of(BEAMS)
    cloud = free_poses(floor, POSES)
    if spread is not None:
        rng, centre = np.random.default_rng(0), free_poses(floor, 1, radius=0.9)
        noise = rng.normal(0, (spread, spread, 0.1), (POSES, 3))
        cloud = (centre + noise).astype(np.float32)
    return Job(lambda: floor.ranges(cloud, bearings), POSES * BEAMS)


def numpy_job(caster: CasterMaker) -> Job:
    """Return the job of a NumPy baseline."""
    cloud = np.ascontiguousarray(free_poses(PAPER_ROOM, POSES).T)
    bearings, cast = bearings_of(BEAMS), caster(PAPER_ROOM)
    return Job(lambda: cast(cloud, bearings), POSES * BEAMS)


def pymunk_queries(poses: Singles, bearings: Singles) -> Callable[[], list[float]]:
    """Return what asks ``Space.segment_query_first`` for each ray's range, pose by pose.

    The ends of the rays, beyond the walls, are computed beforehand.
    """
    space, everything = pymunk.Space(), pymunk.ShapeFilter()
    for x0, y0, x1, y1 in PAPER_ROOM.walls.tolist():
        space.add(pymunk.Segment(space.static_body, (x0, y0), (x1, y1), 0.0))
    angles = (poses[:, 2, None] + bearings).ravel()
    starts = np.repeat(poses[:, :2], bearings.size, axis=0)
    ends = starts + FAR * np.column_stack([np.cos(angles), np.sin(angles)])
    rays = [((x0, y0), (x1, y1)) for x0, y0, x1, y1 in np.hstack([starts, ends]).tolist()]

    def query() -> list[float]:
        found = [space.segment_query_first(start, end, 0.0, everything) for start, end in rays]
        return [FAR if first is None else FAR * first.alpha for first in found]

    return query


def pymunk_job() -> Job:
    """Return the job of pymunk's queries."""
    poses = free_poses(PAPER_ROOM, POSES_ONE_BY_ONE)
    return Job(pymunk_queries(poses, bearings_of(BEAMS)), POSES_ONE_BY_ONE * BEAMS)


def peer_job(made: peers.CasterMaker, beams: int) -> Job:
    """Return the job of a peer that is asked for a pose at a time."""
    cast = made(PAPER_ROOM, beams)
    poses = free_poses(PAPER_ROOM, POSES_ONE_BY_ONE, radius=2.0).tolist()  # not in a wall's pixels

    def cast_all() -> None:
        for pose in poses:
            cast(pose)

    return Job(cast_all, POSES_ONE_BY_ONE * beams)


def _in_paper(
    name: str, other: Side, target: float | None = None, *, poses: int = POSES, beams: int = BEAMS
) -> Figure:
    what = f"rays in the paper's room, {poses:,} poses × {beams} beams"
    ours = Side("PolygonMap.ranges", partial(our_job, PAPER_ROOM, poses, beams))
    return Figure(f"rays_vs_{name}", what, "rays/s", ours, other, target)


def _in_cells(name: str, spread: float | None, cloud: str) -> Figure:
    what = f"rays in 1,000² cells, {POSES:,} poses × {BEAMS} beams, {cloud}"
    ours = Side("GridMap.ranges", partial(office_job, spread))
    return Figure(f"rays_grid_{name}", what, "rays/s", ours, _TABLE)


def _among(walls: int) -> Figure:
    what = f"rays among {walls:,} walls, {POSES:,} poses × {BEAMS} beams"
    ours = Side("PolygonMap.ranges", lambda: our_job(pillared_room(walls), POSES))
    return Figure(f"rays_{walls}_walls", what, "rays/s", ours, _TABLE)


def _peer(made: peers.CasterMaker, who: str, beams: int = BEAMS) -> Side:
    return Side(f"{who}, {beams} beams a call", partial(peer_job, made, beams))


_TABLE = Published("a lookup table of range_libc, on another machine", 31e6)

FIGURES = (
    _in_paper("numpy", Side("NumPy, all walls", partial(numpy_job, segments)), 8),
    _in_paper("numpy_slabs", Side("NumPy, slab method", partial(numpy_job, slabs))),
    _in_paper("pymunk", Side("pymunk, a segment query a ray", pymunk_job), 1_000),
    _in_cells("uniform", None, "all over the map"),
    _in_cells("converged", 0.2, "within 0.2 m and 0.1 rad (σ)"),
    _among(256),
    _among(1024),
)
PEERS = (
    _in_paper("navground", _peer(peers.navground, "navground", 360), 10, poses=1_000, beams=360),
    _in_paper("navground_16", _peer(peers.navground, "navground")),
    _in_paper("raycast2d", _peer(peers.raycast2d, "raycast2D, pixels of 1 px (not exact)")),
)
