"""The pictures that phase.png is made of, each drawn into given axes."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.phase.cycles import Cycles
from benchmarks.phase.fields import PlaceFields
from benchmarks.phase.precession import Precession
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.numerics.types import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# After Okabe & Ito (2008): told apart under every common colour blindness.
COLORS = ("#0072b2", "#e69f00", "#009e73", "#d55e00", "#56b4e9", "#aa4499")
INK, FITTED, NOT_HELD = "#1f2328", "#d55e00", "#e4e4e4"
DOTTED, DASHED = (0, (1, 1.5)), (0, (3, 2))
_CELLS = 41  # bins of position, and rows of the table
_NUMBERED = 24  # more fields are too small for their numbers


def draw_cycles(axes: "Axes", cycles: Cycles) -> None:
    """Every cycle as a column, from early phase up to late; hue: the place, strength: its mass."""
    activity = np.nan_to_num(cycles.activity)
    colors = _colors(activity.shape[2])
    none = 1 - activity.sum(axis=2, keepdims=True)
    picture = none.clip(0, 1) + activity @ colors
    picture[~cycles.held] = _rgb(NOT_HELD)
    low, high = _phase_span(cycles)
    axes.imshow(
        picture.clip(0, 1).transpose(1, 0, 2),
        origin="lower",
        aspect="auto",
        interpolation="nearest",
        extent=(-0.5, cycles.steps + 0.5, low, high),
    )
    axes.set_facecolor(NOT_HELD)
    _phase_axis(axes)


def number_fields(axes: "Axes", perfect: Cycles) -> None:
    """Write each field's number where the robot is in it, once per longer visit."""
    home = perfect.home
    if perfect.activity.shape[2] > _NUMBERED:
        return
    visits = np.split(np.arange(home.size), np.flatnonzero(np.diff(home)) + 1)
    for visit in visits:
        if home[visit[0]] >= 0 and visit.size > 3:  # a shorter one is narrower than its number
            _write(axes, float(visit.mean()), 180, int(home[visit[0]]), size=9)


def draw_precession(
    axes: "Axes", cycles: Cycles, found: Precession, true: Precession, extent: float
) -> Any:
    """Mean activity over the robot's position in the field and the phase, over all fields."""
    edges = np.linspace(-extent, extent, _CELLS + 1)
    low, high = _phase_span(cycles)
    image = axes.imshow(
        _binned(cycles, edges),
        origin="lower",
        aspect="auto",
        interpolation="nearest",
        extent=(-extent, extent, low, high),
        cmap="Blues",
        vmin=0,
        vmax=1,
    )
    axes.set_facecolor(NOT_HELD)
    for line, color, style in ((true, INK, DOTTED), (found, FITTED, "-")):
        if math.isfinite(line.slope):
            phases = np.array([line.first, line.last])
            places = line.position + (phases - line.centre) / line.slope
            axes.plot(places, phases, color=color, linestyle=style, linewidth=1.6)
    axes.set_xlim(-extent, extent)
    _phase_axis(axes)
    words = f"slope {found.slope:#.3g} °/px" if math.isfinite(found.slope) else "no slope"
    axes.set_title(words, loc="left")
    return image


def draw_table(axes: "Axes", cycles: Cycles, farthest: float) -> Any:
    """Rows: scans up to t; columns: the state x_s; colour: how far the belief is from the truth."""
    first = max(0, cycles.steps // 2 - _CELLS // 2)
    times = np.arange(first, min(first + _CELLS, cycles.steps + 1))
    last = min(cycles.steps, times[-1] + cycles.reach)
    states = np.arange(max(0, times[0] - cycles.reach), last + 1)
    table = np.full((times.size, states.size), np.nan)
    for row, t in enumerate(times.tolist()):
        inside = np.abs(states - t) <= cycles.reach
        table[row, inside] = cycles.distance[t, states[inside] - t + cycles.reach]
    image = axes.imshow(
        table,
        origin="upper",
        aspect="auto",
        interpolation="nearest",
        extent=(states[0] - 0.5, states[-1] + 0.5, times[-1] + 0.5, times[0] - 0.5),
        cmap="viridis_r",
        vmin=0,
        vmax=farthest,
    )
    axes.set_facecolor(NOT_HELD)
    if cycles.held.any(axis=0).sum() > 1:  # a line would hide the present if that is all
        axes.plot(times, times, color="white", linewidth=2.2)
        axes.plot(times, times, color=INK, linewidth=1.0, linestyle=DASHED)
    return image


def draw_map(axes: "Axes", fields: PlaceFields, floor_plan: PolygonMap) -> None:
    """The room and the numbered fields."""
    from matplotlib.patches import Circle, Polygon

    axes.add_patch(Polygon(floor_plan.outer, facecolor="white", edgecolor=INK, linewidth=1.4))
    for corners in floor_plan.obstacles:
        axes.add_patch(Polygon(corners, facecolor="#bbbbbb", edgecolor=INK, linewidth=1.0))
    colors = _colors(len(fields))
    for place, (centre, color) in enumerate(zip(fields.centres, colors, strict=True)):
        axes.add_patch(Circle(tuple(centre), fields.radius, facecolor=color, edgecolor="none"))
        if len(fields) <= _NUMBERED:
            _write(axes, float(centre[0]), float(centre[1]), place, size=7)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()
    axes.set_title(f"The place fields, radius {fields.radius:.0f} px", loc="left")


def _write(axes: "Axes", x: float, y: float, place: int, *, size: float) -> None:
    words = str(place + 1)
    axes.text(
        x, y, words, color="white", ha="center", va="center", fontsize=size, fontweight="bold"
    )


def _phase_axis(axes: "Axes") -> None:
    axes.set_ylim(0, 360)
    axes.set_yticks([0, 90, 180, 270, 360])


def _phase_span(cycles: Cycles) -> tuple[float, float]:
    """Phases at which the drawn offsets begin and end, degrees."""
    half = 180 / (2 * cycles.lag + 1)
    return float(cycles.phases[0]) - half, float(cycles.phases[-1]) + half


def _binned(cycles: Cycles, edges: Floats) -> Floats:
    """Mean activity of all steps and fields in each bin of position, (2R + 1, bins)."""
    bins = edges.size - 1
    column = np.digitize(cycles.passed(), edges) - 1  # NaN goes last
    known = (column >= 0) & (column < bins) & ~np.isnan(cycles.activity)
    row = np.broadcast_to(np.arange(cycles.error.shape[1])[:, None], known.shape)
    place = row[known] * bins + column[known]
    size = cycles.error.shape[1] * bins
    sums = np.bincount(place, cycles.activity[known], size)
    counts = np.bincount(place, minlength=size)
    means = np.full(size, np.nan)
    np.divide(sums, counts, out=means, where=counts > 0)
    return means.reshape(-1, bins)


def _colors(count: int) -> Floats:
    """RGB of each field, (count, 3)."""
    return np.array([_rgb(COLORS[i % len(COLORS)]) for i in range(count)])


def _rgb(color: str) -> tuple[float, ...]:
    return tuple(int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
