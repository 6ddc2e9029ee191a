"""A localizer's step through its public ``update`` on a recorded lap, and its parts.

And how rays and steps grow with the map, the particles, the beams and the queue: curves.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
from tabulate import tabulate

from benchmarks.pictures import styled
from benchmarks.pictures.figures import png_of
from benchmarks.studies.speed import numpy_baseline, peers, rays, work
from benchmarks.studies.speed.figure import (
    Effort,
    Figure,
    Job,
    Published,
    Side,
    amount,
    digits,
    in_unit,
    rates,
)
from benchmarks.studies.speed.numpy_baseline import CasterMaker, segments, slabs
from benchmarks.tables.text import csv_text
from deqmcl_gym.world.presets import PAPER_ROOM
from localizers import CensoredGaussianUniform, make
from localizers.models.scan import LidarScan, Scan

FEW, MANY = 1_000, 10_000


def our_job(name: str, *, beams: int = work.BEAMS, **params: int) -> Job:
    """Return the job of one of our localizers, its queue full."""
    lap = work.recorded_lap(beams)
    localizer = make(name, lap.robot, **params)
    localizer.reset(lap.prior, lap.first, np.random.default_rng(1))
    job = lap.following(localizer.update)
    for _ in range(params.get("lag", 0)):
        job.call()
    return job


def numpy_job(particles: int, caster: CasterMaker = segments) -> Job:
    """Return the job of MCL in NumPy."""
    lap, rng = work.recorded_lap(), np.random.default_rng(1)
    return lap.following(numpy_baseline.mcl(lap.robot, particles, lap.prior, rng, caster))


def peer_job(made: Callable[..., peers.Update]) -> Job:
    """Return the job of MCL as a peer's user would write it, given the NumPy models."""
    lap, rng = work.recorded_lap(), np.random.default_rng(1)
    return lap.following(made(lap.robot, FEW, lap.prior, rng))


def replanned_job(name: str, particles: int, ahead: int = 0) -> Job:
    """Return the job of following a lap whose plan changes, over and over from its start.

    A queue has to redraw its future there; on a plan that is kept, that is spared. At each step the
    state ``ahead`` is asked for: a future may be drawn only then.
    """
    lap = work.replanned_lap()
    localizer = make(name, lap.robot, particles=particles)

    def update(*step: Any) -> None:
        belief = localizer.update(*step)
        if ahead:
            belief.points(ahead)

    def restart() -> None:
        localizer.reset(lap.prior, lap.first, np.random.default_rng(1))

    return lap.following(update, restart)


def scan_job(*, clipped: bool) -> Job:
    """Return the job of weighing a scan by a censored beam model, its beams clipped or not."""
    lap, lidar = work.recorded_lap(), work.fan(work.BEAMS)
    scan = LidarScan(floor_plan=PAPER_ROOM, lidar=lidar, beam=CensoredGaussianUniform())
    states = np.ascontiguousarray(work.free_poses(PAPER_ROOM, FEW).T)
    inside = lap.steps[0][0].astype(np.float64)
    ranges = np.full(work.BEAMS, lidar.max_range) if clipped else inside
    seen = Scan.of(ranges, lidar.max_range)
    return Job(lambda: scan.log_likelihood(states, seen))


def _versus(name: str, particles: int, other: Side, target: float | None = None) -> Figure:
    what = f"MCL step, N = {particles:,}, B = {work.BEAMS}"
    ours = Side("mcl", partial(our_job, "mcl", particles=particles))
    return Figure(name, what, "steps/s", ours, other, target)


def _peer(made: Callable[..., peers.Update], who: str) -> Figure:
    side = Side(f"{who}, given the NumPy models", partial(peer_job, made))
    return _versus(f"step1k_vs_{made.__name__}", FEW, side, 10)


def _deq(lag: int) -> Side:
    return Side(f"deq-mcl, L = {lag}", partial(our_job, "deq-mcl", particles=MANY, lag=lag))


def _replanned(
    figure: str,
    name: str,
    particles: int,
    target: float | None = None,
    members: int = 1,
    ahead: int = 0,
) -> Figure:
    what = f"step in scenario guided, a new plan at every step, N = {particles:,}, B = 1"
    each = f", {members} x N" if members > 1 else ""
    ours = Side(f"{name}, L = 20{each}", partial(replanned_job, name, members * particles, ahead))
    other = Side("mcl-map", partial(replanned_job, "mcl-map", particles))
    named = f"{figure}_vs_map_step{particles // 1000}k"
    return Figure(named, what, "µs/step", ours, other, target)


_STEP, _FEW = f"step, N = {MANY:,}, B = {work.BEAMS}", f"N = {FEW:,}, B = {work.BEAMS}"
_MAP = Side("mcl-map", partial(our_job, "mcl-map", particles=MANY))
_SAME = {"min_particles": FEW, "max_particles": FEW, "update_min_d": 0, "update_min_a": 0}

FIGURES = (
    *(
        _versus(f"{name}_vs_numpy{suffix}", n, Side(who, partial(numpy_job, n, caster)), target)
        for name, n, least in (("step1k", FEW, None), ("step10k", MANY, 5))
        for suffix, who, caster, target in (
            ("", "NumPy, all walls", segments, least),
            ("_slabs", "NumPy, slab method", slabs, None),
        )
    ),
    Figure("deq_vs_map_step", _STEP, "µs/step", _deq(20), _MAP, 1.5),
    Figure("deq_lag80_vs_lag10", _STEP, "µs/step", _deq(80), _deq(10), 1.3),
    Figure(
        "amcl_step",
        f"step with a likelihood field and KLD-sampling, {_FEW}",
        "µs/step",
        Side("amcl", partial(our_job, "amcl", **_SAME)),
        Published("beluga, on another machine", 383),
    ),
    Figure(
        "censored_vs_inside",
        f"CensoredGaussianUniform by LidarScan, {_FEW}",
        "µs/scan",
        Side("all beams clipped", partial(scan_job, clipped=True)),
        Side("no beam clipped", partial(scan_job, clipped=False)),
    ),
    *(
        _replanned(figure, name, particles, target, members, ahead)
        for particles in (FEW, MANY)
        for figure, name, target, members, ahead in (
            ("plan", "mcl-plan", 5.0, 1, 0),
            ("hedged", "mcl-plan-hedged", 4.0 if particles == FEW else None, 2, 0),
            ("replanned_deq", "deq-mcl", None, 1, 0),
            ("replanned_fresh", "deq-mcl-fresh", None, 1, 20),
        )
    ),
)
PEERS = (
    _peer(peers.particles, "particles"),
    _peer(peers.pfilter, "pfilter"),
    _peer(peers.stonesoup, "Stone Soup"),
)


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
    by_segments = f"rays, {POSES:,} poses × {work.BEAMS} beams, pillars in a square room"
    by_particles, by_beams = f"MCL step, B = {work.BEAMS}", f"MCL step, N = {FEW:,}"
    by_lag = f"DEQ-MCL step, N = {FEW:,}, B = {work.BEAMS}"
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


def scaling_csv(measured: Iterable[Scaling]) -> str:
    """Return scaling.csv, one line per point."""
    points = (
        [curve.what, curve.who, curve.varied, value, digits(result), curve.unit]
        for curve, results in measured
        for value, result in zip(curve.values, results, strict=True)
    )
    return csv_text(["task", "who", "varied", "value", "result", "unit"], points)


def scaling_tables(measured: Sequence[Scaling]) -> str:
    """Return one Markdown table per task, a column per who."""
    tables = []
    for what, same in _by_task(measured):
        curve, _ = same[0]
        columns = [[amount(result, curve.unit) for result in results] for _, results in same]
        lines = list(zip([f"{value:,}" for value in curve.values], *columns, strict=True))
        header = [curve.varied, *(curve.who for curve, _ in same)]
        body = tabulate(lines, header, "github", disable_numparse=True, stralign="right")
        tables.append(f"### {what}\n\n{body}")
    return "\n\n".join(tables)


@styled()
def scaling_plot(measured: Sequence[Scaling]) -> bytes:
    """Return one picture per task, as PNG; axes are logarithmic where values span a decade."""
    from matplotlib.figure import Figure

    tasks = _by_task(measured)
    rows = -(-len(tasks) // 2)
    figure = Figure(figsize=(10, 3.6 * rows), dpi=120, layout="constrained")
    for axes, (what, same) in zip(figure.subplots(rows, 2).flat, tasks, strict=False):
        for curve, results in same:
            axes.plot(curve.values, results, "o-", label=curve.who)
        seen = [result for _, results in same for result in results]
        if min(curve.values) > 0:
            axes.set_xscale("log")
            axes.xaxis.minorticks_off()
        if max(seen) > 10 * min(seen):
            axes.set_yscale("log")
        else:
            axes.set_ylim(0, 1.15 * max(seen))
        axes.set_xticks(curve.values, [f"{value:,}" for value in curve.values])
        axes.yaxis.set_major_formatter(lambda y, _: f"{y / 1e6:,g} M" if y >= 1e6 else f"{y:,g}")
        axes.set(xlabel=curve.varied, ylabel=curve.unit)
        axes.set_title(what, fontsize="medium")
        axes.grid(alpha=0.3)
        axes.legend()
    return png_of(figure)


def _rays_among(segments: int) -> Job:
    return rays.our_job(work.pillared_room(segments), POSES)


def _by_task(measured: Iterable[Scaling]) -> list[tuple[str, list[Scaling]]]:
    """Return the curves of each task, which follow each other."""
    return [(what, list(same)) for what, same in groupby(measured, lambda seen: seen[0].what)]
