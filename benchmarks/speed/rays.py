"""Ray casting, against others in the paper's room."""

from collections.abc import Callable
from functools import partial
from importlib import import_module

import numpy as np
import pymunk

from benchmarks.speed.buildings import office_floor, pillared_room
from benchmarks.speed.figure import Figure, Published, Side
from benchmarks.speed.lap import BEAMS, bearings_of, free_poses
from benchmarks.speed.numpy_baseline import CasterMaker, segments, slabs
from benchmarks.speed.timing import Job
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Singles
from deqmcl_gym.world.config import PAPER_ROOM

POSES = 20_000
POSES_ONE_BY_ONE = 100  # for those who are asked for a pose at a time
FAR = 1000.0  # px, beyond every wall


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


def peer_job(name: str, beams: int) -> Job:
    """Return the job of a peer that is asked for a pose at a time."""
    cast = import_module(f"benchmarks.speed.peers.{name}").caster(PAPER_ROOM, beams)
    poses = free_poses(PAPER_ROOM, POSES_ONE_BY_ONE, radius=2.0).tolist()  # not in a wall's pixels

    def cast_all() -> None:
        for pose in poses:
            cast(pose)

    return Job(cast_all, POSES_ONE_BY_ONE * beams)


def _figure(
    name: str, other: Side, target: float | None = None, *, poses: int = POSES, beams: int = BEAMS
) -> Figure:
    return Figure(
        name=f"rays_vs_{name}",
        what=f"rays in the paper's room, {poses:,} poses × {beams} beams",
        unit="rays/s",
        ours=Side("PolygonMap.ranges", partial(our_job, PAPER_ROOM, poses, beams)),
        other=other,
        target=target,
    )


def _peer(name: str, who: str, beams: int = BEAMS) -> Side:
    return Side(f"{who}, {beams} beams a call", partial(peer_job, name, beams))


def _published(name: str, ours: Side, other: Published, what: str) -> Figure:
    return Figure(name=name, what=what, unit="rays/s", ours=ours, other=other)


_TABLE = Published("a lookup table of range_libc, on another machine", 31e6)
_FLOOR = f"rays in 1,000² cells, {POSES:,} poses × {BEAMS} beams"


def _grid(name: str, spread: float | None) -> Figure:
    ours = Side("GridMap.ranges", partial(office_job, spread))
    cloud = "all over the map" if spread is None else f"within {spread:g} m and 0.1 rad (σ)"
    return _published(f"rays_grid_{name}", ours, _TABLE, f"{_FLOOR}, {cloud}")


def _walls_job(walls: int) -> Job:
    return our_job(pillared_room(walls), POSES)


def _walls(walls: int) -> Figure:
    ours = Side("PolygonMap.ranges", partial(_walls_job, walls))
    what = f"rays among {walls:,} walls, {POSES:,} poses × {BEAMS} beams"
    return _published(f"rays_{walls}_walls", ours, _TABLE, what)


FIGURES = (
    _figure("numpy", Side("NumPy, all walls", partial(numpy_job, segments)), 8),
    _figure("numpy_slabs", Side("NumPy, slab method", partial(numpy_job, slabs))),
    _figure("pymunk", Side("pymunk, a segment query a ray", pymunk_job), 1_000),
    _grid("uniform", None),
    _grid("converged", 0.2),
    _walls(256),
    _walls(1024),
)
PEERS = (
    _figure("navground", _peer("navground", "navground", 360), 10, poses=1_000, beams=360),
    _figure("navground_16", _peer("navground", "navground")),
    _figure("raycast2d", _peer("raycast2d", "raycast2D, pixels of 1 px (not exact)")),
)
