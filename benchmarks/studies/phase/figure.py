"""phase.png: a row per method; its theta cycles, its precession, its table of the queue."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon
from numpy.typing import NDArray

from benchmarks.pictures import styled
from benchmarks.pictures.figures import png_of
from benchmarks.studies.phase.cycles import Cycles, PlaceFields, Precession
from deqmcl_gym.maps import Map, PolygonMap
from deqmcl_gym.numerics.types import Floats

# After Okabe & Ito (2008): told apart under every common colour blindness.
_COLORS = ("#0072b2", "#e69f00", "#009e73", "#d55e00", "#56b4e9", "#aa4499")
_INK, _FITTED, _NOT_HELD = "#1f2328", "#d55e00", "#e4e4e4"
_DOTTED, _DASHED = (0, (1, 1.5)), (0, (3, 2))
_CELLS = 41  # bins of position, and rows of the table
_NUMBERED = 24  # more fields are too small for their numbers
_STYLE: Any = {
    "text.parse_math": False,
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.linewidth": 0.8,
}


def phase_figure(
    laps: Mapping[str, Cycles], fields: PlaceFields, floor_plan: Map, title: str
) -> bytes:
    """Return the figure as PNG: the perfect queue's lap with the map, then a row per method."""
    (perfect, *others), unit = laps.values(), fields.unit
    with styled(_STYLE):
        figure = Figure(figsize=(11, 1.3 + 2.15 * len(laps)), dpi=100, layout="constrained")
        shares: Any = {"width_ratios": (2.1, 1, 1.15), "height_ratios": [*[1.0] * len(laps), 0.09]}
        axes = figure.subplots(len(laps) + 1, 3, squeeze=False, **shares)
        told = np.nan_to_num(perfect.activity) > 0  # the queue tells of the field
        extent = float(np.abs(perfect.passed[told]).max(initial=0.0)) or 1.0
        off = np.concatenate([own.distance[own.held] for own in others])
        farthest = float(np.quantile(off, 0.98)) if off.size else 1.0  # 2 % are farther
        for row, (name, own) in zip(axes[:-1], laps.items(), strict=True):
            _draw_cycles(row[0], own)
            words = f"{name}: {_words(own.precession)}"
            row[0].set_title(words, loc="left", fontweight="bold")
            mass = _draw_precession(row[1], own, perfect.precession, extent, unit)
        for row, own in zip(axes[1:-1], others, strict=True):
            table = _draw_table(row[2], own, farthest)
        _number_fields(axes[0][0], perfect)
        _draw_map(axes[0][2], fields, floor_plan)
        _label(axes[:-1], unit)
        _legend(axes[-1][0])
        distance = f"RMS distance of belief and truth ({unit})"
        for image, bar, label in ((mass, 1, "mean mass in the field"), (table, 2, distance)):
            figure.colorbar(image, cax=axes[-1][bar], orientation="horizontal", label=label)
        figure.suptitle(title, fontsize=11)
        return png_of(figure, pil_kwargs={"optimize": True})


def _words(found: Precession) -> str:
    if math.isnan(found.first):
        return "no field is active"
    if math.isnan(found.slope):
        return f"fires at {found.first:.0f}° only, no precession"
    return f"fires from {found.first:.0f}° to {found.last:.0f}°"


def _draw_cycles(axes: Axes, cycles: Cycles) -> None:
    """Every cycle as a column, from early phase up to late; hue: the place, strength: its mass."""
    activity = np.nan_to_num(cycles.activity)
    none = 1 - activity.sum(axis=2, keepdims=True)
    picture = none.clip(0, 1) + activity @ _colors(activity.shape[2])
    picture[~cycles.held] = to_rgb(_NOT_HELD)
    over_phase = picture.clip(0, 1).transpose(1, 0, 2)
    _image(axes, over_phase, (-0.5, cycles.steps + 0.5, *_phase_span(cycles)))


def _number_fields(axes: Axes, perfect: Cycles) -> None:
    """Write each field's number where the robot is in it, once per longer visit."""
    inside = perfect.activity[:, perfect.reach]
    home = np.where(inside.any(axis=1), inside.argmax(axis=1), -1)
    if inside.shape[1] > _NUMBERED:
        return
    for visit in np.split(np.arange(home.size), np.flatnonzero(np.diff(home)) + 1):
        if home[visit[0]] >= 0 and visit.size > 3:  # a shorter one is narrower than its number
            _write(axes, float(visit.mean()), 180, int(home[visit[0]]), size=9)


def _draw_precession(axes: Axes, cycles: Cycles, true: Precession, extent: float, unit: str) -> Any:
    """Mean activity over the robot's position in the field and the phase, over all fields."""
    found = cycles.precession
    span = (-extent, extent, *_phase_span(cycles))
    image = _image(axes, _binned(cycles, extent), span, cmap="Blues", vmin=0, vmax=1)
    for line, color, style in ((true, _INK, _DOTTED), (found, _FITTED, "-")):
        if math.isfinite(line.slope):
            phases = np.array([line.first, line.last])
            places = line.late + (phases - 180) / line.slope
            axes.plot(places, phases, color=color, linestyle=style, linewidth=1.6)
    axes.set_xlim(-extent, extent)
    words = f"slope {found.slope:#.3g} °/{unit}" if math.isfinite(found.slope) else "no slope"
    axes.set_title(words, loc="left")
    return image


def _draw_table(axes: Axes, cycles: Cycles, farthest: float) -> Any:
    """Rows: scans up to t; columns: the state x_s; colour: how far the belief is from the truth."""
    first, reach = max(0, cycles.steps // 2 - _CELLS // 2), cycles.reach
    times = np.arange(first, min(first + _CELLS, cycles.steps + 1))
    states = np.arange(max(0, first - reach), min(cycles.steps, times[-1] + reach) + 1)
    offsets = states - times[:, None]
    distances = cycles.distance[times[:, None], (offsets + reach).clip(0, 2 * reach)]
    table = np.where(np.abs(offsets) <= reach, distances, np.nan)
    span = (states[0] - 0.5, states[-1] + 0.5, times[-1] + 0.5, first - 0.5)
    image = _image(axes, table, span, origin="upper", cmap="viridis_r", vmin=0, vmax=farthest)
    if cycles.held.any(axis=0).sum() > 1:  # a line would hide the present if that is all
        axes.plot(times, times, color="white", linewidth=2.2)
        axes.plot(times, times, color=_INK, linewidth=1.0, linestyle=_DASHED)
    return image


def _draw_map(axes: Axes, fields: PlaceFields, floor_plan: Map) -> None:
    """The room and the numbered fields."""
    if isinstance(floor_plan, PolygonMap):
        axes.add_patch(Polygon(floor_plan.outer, facecolor="white", edgecolor=_INK, linewidth=1.4))
        for corners in floor_plan.obstacles:
            axes.add_patch(Polygon(corners, facecolor="#bbbbbb", edgecolor=_INK, linewidth=1.0))
    else:
        walls = floor_plan.walls.reshape(-1, 2, 2)
        axes.add_collection(LineCollection(list(walls), colors=_INK, linewidths=0.5))
    colors = _colors(len(fields))
    for place, ((x, y), color) in enumerate(zip(fields.centres.tolist(), colors, strict=True)):
        axes.add_patch(Circle((x, y), fields.radius, facecolor=color, edgecolor="none"))
        if len(fields) <= _NUMBERED:
            _write(axes, x, y, place, size=7)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()
    radius = f"{fields.radius:.{fields.decimals - 1}f} {fields.unit}"
    axes.set_title(f"The place fields, radius {radius}", loc="left")


def _label(axes: NDArray[Any], unit: str) -> None:
    for row in axes:
        row[0].set(ylim=(0, 360), yticks=[0, 90, 180, 270, 360], ylabel="theta phase (°)")
        row[1].set_ylim(0, 360)
        row[1].set_yticks([90, 180, 270], ["past", "now", "future"], rotation=90, va="center")
        row[1].tick_params(axis="y", length=0)
    axes[-1][0].set_xlabel("theta cycle = step t")
    axes[-1][1].set_xlabel(f"robot past the field's centre ({unit})")
    axes[-1][2].set_xlabel("step s of the state")
    for row in axes[1:]:
        row[2].set_ylabel("scans up to t")
    axes[1][2].set_title("Table of the queue, x[s] | o[1:t]", loc="left")


def _legend(axes: Axes) -> None:
    handles = [
        Patch(color=_COLORS[0], label="mass in a field, in its hue"),
        Patch(color=_NOT_HELD, label="not held"),
        Line2D([], [], color=_FITTED, label="fitted line"),
        Line2D([], [], color=_INK, linestyle=_DOTTED, label="perfect queue"),
        Line2D([], [], color=_INK, linestyle=_DASHED, linewidth=1.0, label="the present"),
    ]
    style: Any = {"columnspacing": 1.4, "handlelength": 1.6, "frameon": False}
    axes.set_axis_off()
    axes.legend(handles=handles, loc="center", ncols=3, **style)


def _image(
    axes: Axes, values: Floats, span: tuple[float, float, float, float], **style: Any
) -> Any:
    axes.set_facecolor(_NOT_HELD)
    style = {"origin": "lower", "aspect": "auto", "interpolation": "nearest"} | style
    return axes.imshow(values, extent=span, **style)


def _write(axes: Axes, x: float, y: float, place: int, *, size: float) -> None:
    style: Any = {"color": "white", "ha": "center", "va": "center", "fontweight": "bold"}
    axes.text(x, y, str(place + 1), fontsize=size, **style)


def _phase_span(cycles: Cycles) -> tuple[float, float]:
    """Phases at which the drawn offsets begin and end, degrees."""
    half = 180 / (2 * cycles.lag + 1)
    return float(cycles.phases[0]) - half, float(cycles.phases[-1]) + half


def _binned(cycles: Cycles, extent: float) -> Floats:
    """Mean activity of all steps and fields in each bin of position, (2R + 1, bins)."""
    known = ~np.isnan(cycles.activity) & (cycles.passed < extent)
    row = np.broadcast_to(cycles.offsets[:, None], known.shape)[known]
    reach = cycles.reach + 0.5
    span = ((-reach, reach), (-extent, extent))
    bins: Any = {"bins": (cycles.offsets.size, _CELLS), "range": span}
    counts, _, _ = np.histogram2d(row, cycles.passed[known], **bins)
    active = cycles.activity[known]
    sums, _, _ = np.histogram2d(row, cycles.passed[known], weights=active, **bins)
    return np.divide(sums, counts, out=np.full(sums.shape, np.nan), where=counts > 0)


def _colors(count: int) -> Floats:
    """RGB of each field, (count, 3)."""
    return np.array([to_rgb(_COLORS[i % len(_COLORS)]) for i in range(count)])
