"""phase.png: a row per method; its theta cycles, its precession, its table of the queue."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.phase.cycles import Cycles
from benchmarks.phase.fields import PlaceFields
from benchmarks.phase.panels import (
    COLORS,
    DASHED,
    DOTTED,
    FITTED,
    INK,
    NOT_HELD,
    draw_cycles,
    draw_map,
    draw_precession,
    draw_table,
    number_fields,
)
from benchmarks.phase.precession import Precession
from deqmcl_gym.maps import PolygonMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MASS = "mean mass in the field"
_DISTANCE = "RMS distance of belief and truth (px)"
_STYLE: Any = {
    "text.parse_math": False,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.linewidth": 0.8,
}


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One row of the figure.

    Attributes:
        title: of the method.
        words: what came out, in a few words.
        cycles: its lap.
        precession: measured on it.
    """

    title: str
    words: str
    cycles: Cycles
    precession: Precession


def phase_figure(
    perfect: Panel,
    methods: Sequence[Panel],
    fields: PlaceFields,
    floor_plan: PolygonMap,
    title: str,
) -> bytes:
    """Return the figure as PNG: the perfect queue and the map first, then a row per method."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    rows = [perfect, *methods]
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(11, 1.3 + 2.15 * len(rows)), dpi=100, layout="constrained")
        heights = [1.0] * len(rows) + [0.09]
        axes = figure.subplots(
            len(rows) + 1, 3, width_ratios=(2.1, 1, 1.15), height_ratios=heights, squeeze=False
        )
        extent, farthest = _extent(perfect.cycles), _farthest(methods)
        for row, panel in zip(axes[:-1], rows, strict=True):
            draw_cycles(row[0], panel.cycles)
            row[0].set_title(f"{panel.title}: {panel.words}", loc="left", fontweight="bold")
            mass = draw_precession(
                row[1], panel.cycles, panel.precession, perfect.precession, extent
            )
        for row, panel in zip(axes[1:-1], methods, strict=True):
            table = draw_table(row[2], panel.cycles, farthest)
        number_fields(axes[0][0], perfect.cycles)
        draw_map(axes[0][2], fields, floor_plan)
        _label(axes[:-1])
        _legend(axes[-1][0])
        figure.colorbar(mass, cax=axes[-1][1], orientation="horizontal", label=_MASS)
        figure.colorbar(table, cax=axes[-1][2], orientation="horizontal", label=_DISTANCE)
        figure.suptitle(title, fontsize=11)
        return _png(figure)


def _label(axes: NDArray[Any]) -> None:
    for row in axes:
        row[0].set_ylabel("theta phase (°)")
        row[1].set_yticks([90, 180, 270], ["past", "now", "future"], rotation=90, va="center")
        row[1].tick_params(axis="y", length=0)
    for column, words in enumerate(("robot past the field's centre (px)", "step s of the state")):
        axes[-1][column + 1].set_xlabel(words)
    axes[-1][0].set_xlabel("theta cycle = step t")
    for row in axes[1:]:
        row[2].set_ylabel("scans up to t")
    axes[1][2].set_title("Table of the queue, x[s] | o[1:t]", loc="left")


def _legend(axes: "Axes") -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    axes.set_axis_off()
    axes.legend(
        handles=[
            Patch(color=COLORS[0], label="mass in a field, in its hue"),
            Patch(color=NOT_HELD, label="not held"),
            Line2D([], [], color=FITTED, label="fitted line"),
            Line2D([], [], color=INK, linestyle=DOTTED, label="perfect queue"),
            Line2D([], [], color=INK, linestyle=DASHED, linewidth=1.0, label="the present"),
        ],
        loc="center",
        ncols=3,
        columnspacing=1.4,
        handlelength=1.6,
        frameon=False,
    )


def _extent(perfect: Cycles) -> float:
    """The farthest from a field's centre, px, that the robot is while the queue tells of it."""
    active = np.nan_to_num(perfect.activity) > 0
    return float(np.abs(perfect.passed()[active]).max(initial=1.0))


def _farthest(methods: Sequence[Panel]) -> float:
    """Upper end of the colours: all but the farthest 2 % of the cells, px."""
    values = np.concatenate([p.cycles.distance[p.cycles.held] for p in methods])
    return float(np.quantile(values, 0.98)) if values.size else 1.0


def _png(figure: "Figure") -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None}, pil_kwargs={"optimize": True})
    return buffer.getvalue()
