"""How rays and steps grow with the map, the particles, the beams and the queue: curves."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from tabulate import tabulate

from benchmarks.pictures.plots import png_of
from benchmarks.studies.speed import rays
from benchmarks.studies.speed.figure import Effort, Job, amount, digits, in_unit, rates
from benchmarks.studies.speed.steps import FEW, numpy_job, our_job
from benchmarks.studies.speed.work import BEAMS, pillared_room
from benchmarks.tables.text import csv_text

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
    return rays.our_job(pillared_room(segments), POSES)


def _by_task(measured: Iterable[Scaling]) -> list[tuple[str, list[Scaling]]]:
    """Return the curves of each task, which follow each other."""
    return [(what, list(same)) for what, same in groupby(measured, lambda seen: seen[0].what)]
