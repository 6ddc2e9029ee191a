"""speed.png and scaling.png."""

import io
from collections.abc import Sequence
from typing import Any

from benchmarks.speed.figure import MICROSECONDS, Measured
from benchmarks.speed.scaling import Measurement
from benchmarks.speed.tables import ratio

_RATE, _TIME, _AIM = "tab:blue", "tab:orange", "black"


def ratios_plot(rows: Sequence[Measured]) -> bytes:
    """Return horizontal bars of the ratios on a logarithmic axis, from 1, as PNG."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure = Figure(figsize=(9, 1.6 + 0.36 * len(rows)), dpi=120, layout="constrained")
    axes = figure.subplots()
    for place, row in enumerate(rows):
        color = _TIME if row.figure.unit == MICROSECONDS else _RATE
        axes.barh(place, row.ratio - 1, left=1, color=color, height=0.62)
        if row.figure.target is not None:
            aim = row.figure.target
            axes.plot([aim, aim], [place - 0.42, place + 0.42], color=_AIM, linewidth=1.8)
        words = f"{ratio(row.ratio)}  ({row.figure.aim})" if row.figure.aim else ratio(row.ratio)
        axes.text(1.01, place, words, transform=axes.get_yaxis_transform(), va="center")
    axes.axvline(1, color="gray", linewidth=1)
    axes.set_xscale("log")
    known = [1.0, *(row.ratio for row in rows), *(row.figure.target or 1.0 for row in rows)]
    axes.set_xlim(min(known) / 1.5, max(known) * 1.5)
    axes.set_yticks(range(len(rows)), [row.figure.name for row in rows])
    axes.invert_yaxis()
    axes.xaxis.set_major_formatter(_plain)
    axes.grid(axis="x", alpha=0.3)
    axes.set_axisbelow(True)
    axes.set(xlabel="ours / other's", title="Speed of one core against others in the same run")
    figure.legend(
        handles=[
            Patch(color=_RATE, label="rates: to the right is faster"),
            Patch(color=_TIME, label="times: to the left is faster"),
            Line2D([], [], color=_AIM, linewidth=1.8, label="target"),
        ],
        loc="outside lower center",
        ncols=3,
        frameon=False,
    )
    return _png(figure)


def scaling_plot(measurements: Sequence[Measurement]) -> bytes:
    """Return one picture per task, as PNG; axes are logarithmic where values span a decade."""
    from matplotlib.figure import Figure

    tasks = list(dict.fromkeys(m.curve.task for m in measurements))
    columns = 2
    rows = -(-len(tasks) // columns)
    figure = Figure(figsize=(10, 3.6 * rows), dpi=120, layout="constrained")
    for axes, task in zip(figure.subplots(rows, columns).flat, tasks, strict=False):
        same = [m for m in measurements if m.curve.task == task]
        for measurement in same:
            curve = measurement.curve
            axes.plot(curve.values, measurement.results, "o-", label=curve.who)
        _draw_axes(axes, same)
    return _png(figure)


def _draw_axes(axes: Any, measurements: Sequence[Measurement]) -> None:
    curve = measurements[0].curve
    results = [result for measurement in measurements for result in measurement.results]
    if min(curve.values) > 0:
        axes.set_xscale("log")
        axes.xaxis.minorticks_off()
    if max(results) > 10 * min(results):
        axes.set_yscale("log")
    else:
        axes.set_ylim(0, 1.15 * max(results))
    axes.set_xticks(curve.values, [f"{value:,}" for value in curve.values])
    axes.yaxis.set_major_formatter(_plain)
    axes.set(xlabel=curve.varied, ylabel=curve.unit)
    axes.set_title(curve.task, fontsize="medium")
    axes.grid(alpha=0.3)
    if len(measurements) > 1:
        axes.legend()


def _plain(value: float, place: object = None) -> str:
    del place
    return f"{value / 1e6:,g} M" if value >= 1e6 else f"{value:,g}"


def _png(figure: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()
