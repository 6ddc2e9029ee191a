"""How rays and steps grow with the map, the particles, the beams and the queue."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from benchmarks.speed import rays
from benchmarks.speed.buildings import pillared_room
from benchmarks.speed.figure import in_unit
from benchmarks.speed.lap import BEAMS
from benchmarks.speed.steps import FEW, numpy_job, our_job
from benchmarks.speed.timing import Effort, Job, rates

POSES = 2_000
_SEGMENTS = (8, 16, 32, 64, 128, 256, 512)
_BEAMS = (1, 2, 4, 8, 16, 32, 64)
_LAGS = (0, 5, 10, 20, 40, 80)


@dataclass(frozen=True)
class Curve:
    """What is measured at each of some values of one parameter.

    Attributes:
        what: is done, the same for all curves of one picture.
        who: does it.
        varied: the parameter.
        values: of the parameter.
        job: makes the job for a value.
        unit: of what is measured.
    """

    what: str
    who: str
    varied: str
    values: Sequence[int]
    job: Callable[[int], Job]
    unit: str = "µs/step"


Scaling = tuple[Curve, Sequence[float]]  # a curve with its measured values, in its unit


def curves(*, largest: int) -> tuple[Curve, ...]:
    """Return all curves, with up to ``largest`` particles."""
    clouds = [n for n in (100, 1_000, 10_000, 100_000, 1_000_000) if n <= largest]
    by_segments = f"rays, {POSES:,} poses × {BEAMS} beams, pillars in a square room"
    by_particles, by_beams = f"MCL step, B = {BEAMS}", f"MCL step, N = {FEW:,}"
    by_lag = f"DEQ-MCL step, N = {FEW:,}, B = {BEAMS}"
    return (
        Curve(by_segments, "PolygonMap.ranges", "segments", _SEGMENTS, _rays_among, "rays/s"),
        Curve(by_particles, "mcl", "particles", clouds, lambda n: our_job("mcl", particles=n)),
        Curve(by_particles, "NumPy", "particles", clouds, numpy_job),
        Curve(by_beams, "mcl", "beams", _BEAMS, lambda b: our_job("mcl", particles=FEW, beams=b)),
        Curve(by_lag, "deq-mcl", "lag", _LAGS, lambda k: our_job("deq-mcl", particles=FEW, lag=k)),
    )


def scaled(chosen: Sequence[Curve], effort: Effort) -> Iterator[Scaling]:
    """Measure each curve; its values take turns."""
    for curve in chosen:
        seen = rates([curve.job(value) for value in curve.values], effort)
        yield curve, [in_unit(rate, curve.unit) for rate in seen]


def _rays_among(segments: int) -> Job:
    return rays.our_job(pillared_room(segments), POSES)
