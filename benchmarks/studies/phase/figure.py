"""phase.png: a row per method; its theta cycles, its precession, its table of the queue."""

import io
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
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
from benchmarks.phase.precession import Lap
from deqmcl_gym.maps import Map

_MASS = "mean mass in the field"
_DISTANCE = "RMS distance of belief and truth"
_STYLE: Any = {
    "text.parse_math": False,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.linewidth": 0.8,
}


def phase_figure(laps: Sequence[Lap], fields: PlaceFields, floor_plan: Map, title: str) -> bytes:
    """Return the figure as PNG: the perfect queue's lap with the map, then a row per method."""
    perfect = laps[0]
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(11, 1.3 + 2.15 * len(laps)), dpi=100, layout="constrained")
        shares: Any = {"width_ratios": (2.1, 1, 1.15), "height_ratios": [*[1.0] * len(laps), 0.09]}
        axes = figure.subplots(len(laps) + 1, 3, squeeze=False, **shares)
        extent, farthest = _extent(perfect.cycles), _farthest(laps[1:])
        for row, lap in zip(axes[:-1], laps, strict=True):
            draw_cycles(row[0], lap.cycles)
            row[0].set_title(f"{lap.title}: {lap.words}", loc="left", fontweight="bold")
            mass = draw_precession(
                row[1], lap.cycles, lap.precession, perfect.precession, extent, fields.unit
            )
        for row, lap in zip(axes[1:-1], laps[1:], strict=True):
            table = draw_table(row[2], lap.cycles, farthest)
        number_fields(axes[0][0], perfect.cycles)
        draw_map(axes[0][2], fields, floor_plan)
        _label(axes[:-1], fields.unit)
        _legend(axes[-1][0])
        figure.colorbar(mass, cax=axes[-1][1], orientation="horizontal", label=_MASS)
        figure.colorbar(
            table, cax=axes[-1][2], orientation="horizontal", label=f"{_DISTANCE} ({fields.unit})"
        )
        figure.suptitle(title, fontsize=11)
        buffer = io.BytesIO()
        metadata, smaller = {"Software": None}, {"optimize": True}
        figure.savefig(buffer, format="png", metadata=metadata, pil_kwargs=smaller)
    return buffer.getvalue()


def _label(axes: NDArray[Any], unit: str) -> None:
    for row in axes:
        row[0].set_ylabel("theta phase (°)")
        row[1].set_yticks([90, 180, 270], ["past", "now", "future"], rotation=90, va="center")
        row[1].tick_params(axis="y", length=0)
    axes[-1][0].set_xlabel("theta cycle = step t")
    axes[-1][1].set_xlabel(f"robot past the field's centre ({unit})")
    axes[-1][2].set_xlabel("step s of the state")
    for row in axes[1:]:
        row[2].set_ylabel("scans up to t")
    axes[1][2].set_title("Table of the queue, x[s] | o[1:t]", loc="left")


def _legend(axes: Axes) -> None:
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
    """The farthest from a field's centre that the robot is while the queue tells of it."""
    active = np.nan_to_num(perfect.activity) > 0
    return float(np.abs(perfect.passed[active]).max(initial=0.0)) or 1.0


def _farthest(laps: Sequence[Lap]) -> float:
    """Upper end of the colours: all but the farthest 2 % of the cells."""
    values = np.concatenate([lap.cycles.distance[lap.cycles.held] for lap in laps])
    return float(np.quantile(values, 0.98)) if values.size else 1.0
