"""scaling.png."""

import io
from collections.abc import Sequence

from benchmarks.speed.scaling import Scaling
from benchmarks.speed.tables import by_task


def scaling_plot(curves: Sequence[Scaling]) -> bytes:
    """Return one picture per task, as PNG; axes are logarithmic where values span a decade."""
    from matplotlib.figure import Figure

    tasks = by_task(curves)
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
        axes.yaxis.set_major_formatter(_plain)
        axes.set(xlabel=curve.varied, ylabel=curve.unit)
        axes.set_title(what, fontsize="medium")
        axes.grid(alpha=0.3)
        axes.legend()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def _plain(value: float, _place: object) -> str:
    return f"{value / 1e6:,g} M" if value >= 1e6 else f"{value:,g}"
