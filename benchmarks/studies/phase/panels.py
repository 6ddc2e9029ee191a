"""The pictures that phase.png is made of, each drawn into given axes."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.patches import Circle, Polygon

from benchmarks.phase.cycles import Cycles
from benchmarks.phase.fields import PlaceFields
from benchmarks.phase.precession import Precession
from deqmcl_gym.maps import Map, PolygonMap
from deqmcl_gym.numerics.types import Floats

# After Okabe & Ito (2008): told apart under every common colour blindness.
COLORS = ("#0072b2", "#e69f00", "#009e73", "#d55e00", "#56b4e9", "#aa4499")
INK, FITTED, NOT_HELD = "#1f2328", "#d55e00", "#e4e4e4"
DOTTED, DASHED = (0, (1, 1.5)), (0, (3, 2))
_CELLS = 41  # bins of position, and rows of the table
_NUMBERED = 24  # more fields are too small for their numbers


def draw_cycles(axes: Axes, cycles: Cycles) -> None:
    """Every cycle as a column, from early phase up to late; hue: the place, strength: its mass."""
    activity = np.nan_to_num(cycles.activity)
    none = 1 - activity.sum(axis=2, keepdims=True)
    picture = none.clip(0, 1) + activity @ _colors(activity.shape[2])
    picture[~cycles.held] = to_rgb(NOT_HELD)
    over_phase = picture.clip(0, 1).transpose(1, 0, 2)
    _image(axes, over_phase, (-0.5, cycles.steps + 0.5, *_phase_span(cycles)))
    _phase_axis(axes)


def number_fields(axes: Axes, perfect: Cycles) -> None:
    """Write each field's number where the robot is in it, once per longer visit."""
    inside = perfect.activity[:, perfect.reach]
    home = np.where(inside.any(axis=1), inside.argmax(axis=1), -1)
    if inside.shape[1] > _NUMBERED:
        return
    for visit in np.split(np.arange(home.size), np.flatnonzero(np.diff(home)) + 1):
        if home[visit[0]] >= 0 and visit.size > 3:  # a shorter one is narrower than its number
            _write(axes, float(visit.mean()), 180, int(home[visit[0]]), size=9)


def draw_precession(
    axes: Axes, cycles: Cycles, found: Precession, true: Precession, extent: float, unit: str
) -> Any:
    """Mean activity over the robot's position in the field and the phase, over all fields."""
    values = _binned(cycles, extent)
    span = (-extent, extent, *_phase_span(cycles))
    image = _image(axes, values, span, cmap="Blues", vmin=0, vmax=1)
    for line, color, style in ((true, INK, DOTTED), (found, FITTED, "-")):
        if math.isfinite(line.slope):
            phases = np.array([line.first, line.last])
            places = line.late + (phases - 180) / line.slope
            axes.plot(places, phases, color=color, linestyle=style, linewidth=1.6)
    axes.set_xlim(-extent, extent)
    _phase_axis(axes)
    words = f"slope {found.slope:#.3g} °/{unit}" if math.isfinite(found.slope) else "no slope"
    axes.set_title(words, loc="left")
    return image


def draw_table(axes: Axes, cycles: Cycles, farthest: float) -> Any:
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
        axes.plot(times, times, color=INK, linewidth=1.0, linestyle=DASHED)
    return image


def draw_map(axes: Axes, fields: PlaceFields, floor_plan: Map) -> None:
    """The room and the numbered fields."""
    if isinstance(floor_plan, PolygonMap):
        axes.add_patch(Polygon(floor_plan.outer, facecolor="white", edgecolor=INK, linewidth=1.4))
        for corners in floor_plan.obstacles:
            axes.add_patch(Polygon(corners, facecolor="#bbbbbb", edgecolor=INK, linewidth=1.0))
    else:
        walls = floor_plan.walls.reshape(-1, 2, 2)
        axes.add_collection(LineCollection(list(walls), colors=INK, linewidths=0.5))
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


def _image(
    axes: Axes, values: Floats, span: tuple[float, float, float, float], **style: Any
) -> Any:
    axes.set_facecolor(NOT_HELD)
    style = {"origin": "lower", "aspect": "auto", "interpolation": "nearest"} | style
    return axes.imshow(values, extent=span, **style)


def _write(axes: Axes, x: float, y: float, place: int, *, size: float) -> None:
    style: Any = {"color": "white", "ha": "center", "va": "center", "fontweight": "bold"}
    axes.text(x, y, str(place + 1), fontsize=size, **style)


def _phase_axis(axes: Axes) -> None:
    axes.set_ylim(0, 360)
    axes.set_yticks([0, 90, 180, 270, 360])


def _phase_span(cycles: Cycles) -> tuple[float, float]:
    """Phases at which the drawn offsets begin and end, degrees."""
    half = 180 / (2 * cycles.lag + 1)
    return float(cycles.phases[0]) - half, float(cycles.phases[-1]) + half


def _binned(cycles: Cycles, extent: float) -> Floats:
    """Mean activity of all steps and fields in each bin of position, (2R + 1, bins)."""
    known = ~np.isnan(cycles.activity) & (cycles.passed < extent)
    row = np.broadcast_to(cycles.offsets[:, None], known.shape)[known]
    reach = cycles.reach + 0.5
    (sums, _, _), (counts, _, _) = (
        np.histogram2d(
            row,
            cycles.passed[known],
            bins=(cycles.offsets.size, _CELLS),
            range=((-reach, reach), (-extent, extent)),
            weights=weights,
        )
        for weights in (cycles.activity[known], None)
    )
    means: Floats = np.divide(sums, counts, out=np.full(sums.shape, np.nan), where=counts > 0)
    return means


def _colors(count: int) -> Floats:
    """RGB of each field, (count, 3)."""
    return np.array([to_rgb(COLORS[i % len(COLORS)]) for i in range(count)])
