"""How rays and steps grow with the map, the particles, the beams and the queue."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.speed.figure import MICROSECONDS, in_unit
from benchmarks.speed.lap import BEAMS, fan, free_poses, recorded_lap
from benchmarks.speed.numpy_baseline import NumpyMCL
from benchmarks.speed.steps import FEW, our_job
from benchmarks.speed.timing import Effort, Job, rates
from deqmcl_gym.maps import PolygonMap

POSES = 2_000


@dataclass(frozen=True, kw_only=True)
class Curve:
    """What is measured at each of some values of one parameter.

    Attributes:
        task: what is done, the same for all curves of one picture.
        who: does it.
        varied: the parameter.
        values: of the parameter.
        unit: of what is measured.
        job: makes the job for a value.
    """

    task: str
    who: str
    varied: str
    values: Sequence[int]
    unit: str
    job: Callable[[int], Job]


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A curve with its measured values, in its unit."""

    curve: Curve
    results: Sequence[float]


def curves(*, largest: int) -> list[Curve]:
    """Return all curves, with up to ``largest`` particles."""
    clouds = [n for n in (100, 1_000, 10_000, 100_000, 1_000_000) if n <= largest]
    by_particles = f"MCL step, B = {BEAMS}"
    return [
        Curve(
            task=f"rays, {POSES:,} poses × {BEAMS} beams, pillars in a square room",
            who="PolygonMap.ranges",
            varied="segments",
            values=(8, 16, 32, 64, 128, 256, 512),
            unit="rays/s",
            job=_rays_among,
        ),
        Curve(
            task=by_particles,
            who="mcl",
            varied="particles",
            values=clouds,
            unit=MICROSECONDS,
            job=lambda n: our_job("mcl", n),
        ),
        Curve(
            task=by_particles,
            who="NumPy",
            varied="particles",
            values=clouds,
            unit=MICROSECONDS,
            job=lambda n: recorded_lap().following(NumpyMCL(recorded_lap().robot, particles=n)),
        ),
        Curve(
            task=f"MCL step, N = {FEW:,}",
            who="mcl",
            varied="beams",
            values=(1, 2, 4, 8, 16, 32, 64),
            unit=MICROSECONDS,
            job=lambda beams: our_job("mcl", FEW, beams=beams),
        ),
        Curve(
            task=f"DEQ-MCL step, N = {FEW:,}, B = {BEAMS}",
            who="deq-mcl",
            varied="lag",
            values=(0, 5, 10, 20, 40, 80),
            unit=MICROSECONDS,
            job=lambda lag: our_job("deq-mcl", FEW, lag=lag),
        ),
    ]


def scaled(chosen: Sequence[Curve], effort: Effort) -> Iterator[Measurement]:
    """Measure each curve; its values take turns."""
    for curve in chosen:
        seen = rates([curve.job(value) for value in curve.values], effort)
        yield Measurement(curve=curve, results=[in_unit(rate, curve.unit) for rate in seen])


def pillared_room(segments: int) -> PolygonMap:
    """Return a square room of 400 px with oblique square pillars: 4 walls each and 4 around."""
    pillars = segments // 4 - 1
    side = math.ceil(math.sqrt(pillars))
    spacing = 400 / side
    corners = np.deg2rad(17 + 90 * np.arange(4))
    square = spacing / 4 * np.column_stack([np.cos(corners), np.sin(corners)])
    centres = [(spacing * (i % side + 0.5), spacing * (i // side + 0.5)) for i in range(pillars)]
    return PolygonMap(
        outer=((0, 0), (400, 0), (400, 400), (0, 400)),
        obstacles=tuple((square + centre).tolist() for centre in centres),
    )


def _rays_among(segments: int) -> Job:
    room = pillared_room(segments)
    poses, bearings = free_poses(room, POSES), fan(BEAMS).bearings.astype(np.float32)
    return Job(call=lambda: room.ranges(poses, bearings), amount=POSES * BEAMS)
