"""Runs on a whole log, drawn: trajectories on the map, errors over the distance driven."""

import numpy as np
from matplotlib.axes import Axes

from benchmarks.report.svg import INK, Look, Looks, Picture, canvas, picture
from benchmarks.report.tracks import shown, told
from benchmarks.tables.panels import Panel
from benchmarks.tables.tracks import Row, Run
from benchmarks.trials.fixes import FOUND, NEAR
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Indices
from deqmcl_gym.world.drawing import PALE, Drawing, View

ON_THE_MAP = (
    "Best clusters: the heaviest cell of a histogram of the belief (1 m × 1 m × 30°) and its "
    "neighbours, the one place that it favours. The cross is where the robot was when it was last "
    "lost: from there on the estimate is never again within 1 m and 30°."
)
OVER_THE_WAY = "Line: median over runs; band: least to largest; dotted: 1 m."

_SCALE = 1.0  # of a drawn map: 480 image pixels, about as many as the page shows
_GREY = 140  # of walls, in the light and in the dark
_UNKNOWN = 50 / (255 - PALE[0])  # opacity per darkness: 50 of 255 for unknown cells, walls whole
_POINTS = 300  # of a curve
_LOST = "lost from here on"
_LEAST = 0.01  # m: where the axis of errors begins


def track_charts(panel: Panel, looks: Looks) -> list[Picture]:
    """The median run of each localizer on the map, and its worst one if that is another."""
    charts = []
    rows, floor_plan = shown(panel)
    for number, row in enumerate(rows, 1):
        name = f"trajectory-{panel.number}-{number}"
        runs = {"Median run": (row.middle, name), "Worst run": (row.worst, f"{name}-worst")}
        if row.worst is row.middle:
            runs = {"Median and worst run" if row.seeds > 1 else "The run": (row.middle, name)}
        for which, (run, own) in runs.items():
            assert floor_plan is not None
            charts.append(_trajectory(row.label, run, which, floor_plan, looks[row.label], own))
    return charts


def error_charts(panel: Panel, looks: Looks) -> list[Picture]:
    """Error over the distance driven, a chart per localizer, on one scale."""
    rows = [row for row in shown(panel)[0] if row.runs[0].track.known.size]
    tops = [run.track.errors.translation.max() for row in rows for run in row.runs]
    return [
        _error_chart(row, looks[row.label], 1.3 * max(*tops, 1.0), f"error-{panel.number}-{number}")
        for number, row in enumerate(rows, 1)
    ]


def _trajectory(
    label: str, run: Run, which: str, floor_plan: Map, look: Look, name: str
) -> Picture:
    """One run of a localizer on the map, the reference, and where it was lost for good."""
    track = run.track
    x0, y0, x1, y1 = floor_plan.bounds
    width = 4.8
    height = min(9.0, (width - 0.77) * (y1 - y0) / (x1 - x0) + 0.62)
    lost = track.lost
    figure, axes = canvas(width, height, legend_of=(label, "reference", *([_LOST] if lost else [])))
    _draw(floor_plan, axes)
    if track.log.reference is not None and track.known.size:
        x, y, _ = track.log.reference[track.known].T
        axes.plot(x, y, color=INK, alpha=0.35, linewidth=2.5, label="reference")
    x, y, _ = track.best.T
    axes.plot(x, y, color=look.color, linewidth=1.0, label=label)
    if track.log.reference is not None and lost is not None:
        x, y, _ = track.log.reference[lost[0]]
        axes.plot(x, y, "X", color=INK, markersize=9, markeredgewidth=0, label=_LOST)
    unit = floor_plan.unit
    axes.set(xlim=(x0, x1), ylim=(y0, y1), aspect="equal", xlabel=f"x, {unit}", ylabel=f"y, {unit}")
    axes.grid(visible=False)
    return picture(
        figure,
        name=name,
        title=f"{label}: {which.lower()}",
        caption=f"Seed {run.seed}: {told(run)}",
        alt=f"{which} of {label} on the map",
    )


def _error_chart(row: Row, look: Look, top: float, name: str) -> Picture:
    first = row.runs[0].track
    way = first.way[first.known]
    at = _chosen(len(way))
    errors = np.array([run.track.errors.translation[at] for run in row.runs])
    figure, axes = canvas(3.2, 2.3, top=0.28)
    low, middle, high = np.maximum(np.quantile(errors, [0, 0.5, 1], axis=0), _LEAST)
    axes.fill_between(way[at], low, high, color=look.color, alpha=0.25, lw=0)
    axes.plot(way[at], middle, color=look.color, linewidth=1.0)
    axes.axhline(NEAR[FOUND][0], color=INK, linewidth=0.8, linestyle=":")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set(ylim=(_LEAST, top), xlim=(0, None), xlabel="driven, m", ylabel="position error, m")
    axes.set_title(row.label, loc="left")
    return picture(
        figure,
        name=name,
        title=f"Error over distance: {row.label}",
        caption="",
        alt=f"Position error of {row.label} over the distance driven",
    )


def _chosen(n: int) -> Indices:
    return np.unique(np.linspace(0, n - 1, min(n, _POINTS)).astype(np.intp))


def _draw(floor_plan: Map, axes: Axes) -> None:
    """Draw a map's walls, and its unknown or solid areas paler; free space is transparent."""
    view = View(floor_plan, _SCALE)
    darkness = 255.0 - Drawing(view).image[:, :, 0]
    image = np.full((*darkness.shape, 4), _GREY, np.uint8)
    image[:, :, 3] = np.minimum(np.rint(_UNKNOWN * darkness), 255)
    (width, height), margin = view.size, view.margin
    x0, _, _, y1 = floor_plan.bounds
    columns, rows = np.array((-margin, width - margin)), np.array((margin - height, margin))
    left, right = x0 + columns / view.per_length
    low, high = y1 + rows / view.per_length
    # not thinned again: walls would be lost
    axes.imshow(image, extent=(left, right, low, high), interpolation="none")
