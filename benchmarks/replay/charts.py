"""The charts of a replay: trajectories on the map, errors and localized runs over distance."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from benchmarks.replay.scoring import Played, Row
from benchmarks.replay.words import told
from benchmarks.report.journeys import LOCALIZED, share_chart
from benchmarks.report.svg import INK, Look, Picture, canvas, picture
from benchmarks.tables.journeys import curve_of
from benchmarks.trials.fixes import FOUND, NEAR
from deqmcl_gym.maps import Map
from deqmcl_gym.numerics.types import Floats, Indices
from deqmcl_gym.world.drawing import PALE, Drawing, View

Looks = Mapping[str, Look]

_SCALE = 1.0  # of a drawn map: 480 image pixels, about as many as the page shows
_GREY = 140  # of walls, in the light and in the dark
_UNKNOWN = 50 / (255 - PALE[0])  # opacity per darkness: 50 of 255 for unknown cells, walls whole
_POINTS = 300  # of a curve
_LOST = "lost from here on"
_LEAST = 0.01  # m: where the axis of errors begins


def trajectory_charts(row: Row, floor_plan: Map, look: Look, number: int) -> list[Picture]:
    """The median run of a localizer on the map, and its worst one if that is another."""
    name = f"trajectory-{number}"
    shown = {"Median run": (row.middle, name), "Worst run": (row.worst, f"{name}-worst")}
    if row.worst is row.middle:
        shown = {"Median and worst run" if row.seeds > 1 else "The run": (row.middle, name)}
    return [
        trajectory_chart(row, played, which, floor_plan, look, own)
        for which, (played, own) in shown.items()
    ]


def trajectory_chart(
    row: Row, played: Played, which: str, floor_plan: Map, look: Look, name: str
) -> Picture:
    """One run of a localizer on the map, the reference, and where it was lost for good.

    Args:
        row: of the localizer.
        played: the run.
        which: run it is, in words.
        floor_plan: the map.
        look: of the localizer.
        name: of the file.
    """
    x0, y0, x1, y1 = floor_plan.bounds
    width = 4.8
    height = min(9.0, (width - 0.77) * (y1 - y0) / (x1 - x0) + 0.62)
    labels = (row.localizer, "reference", *((_LOST,) if played.lost else ()))
    figure, axes = canvas(width, height, legend_of=labels)
    _draw(floor_plan, axes)
    if played.known.size:
        x, y, _ = played.track.truth[played.known].T
        axes.plot(x, y, color=INK, alpha=0.35, linewidth=2.5, label="reference")
    x, y, _ = played.track.best.T
    axes.plot(x, y, color=look.color, linewidth=1.0, label=row.localizer)
    if played.lost is not None:
        x, y, _ = played.track.truth[played.lost[0]]
        axes.plot(x, y, "X", color=INK, markersize=9, markeredgewidth=0, label=_LOST)
    unit = floor_plan.unit
    axes.set(xlim=(x0, x1), ylim=(y0, y1), aspect="equal", xlabel=f"x, {unit}", ylabel=f"y, {unit}")
    axes.grid(visible=False)
    return picture(
        figure,
        name=name,
        title=f"{row.localizer}: {which.lower()}",
        caption=f"Seed {played.run.seed}: {told(played)}",
        alt=f"{which} of {row.localizer} on the map",
    )


def error_chart(row: Row, look: Look, top: float, number: int) -> Picture:
    """Position error of a localizer over the distance driven."""
    first = row.played[0]
    way = first.way[first.known]
    at = _chosen(len(way))
    errors = np.array([_error(played)[at] for played in row.played])
    figure, axes = canvas(3.2, 2.3, top=0.28)
    low, middle, high = np.maximum(np.quantile(errors, [0, 0.5, 1], axis=0), _LEAST)
    axes.fill_between(way[at], low, high, color=look.color, alpha=0.25, lw=0)
    axes.plot(way[at], middle, color=look.color, linewidth=1.0)
    axes.axhline(NEAR[FOUND][0], color=INK, linewidth=0.8, linestyle=":")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set(ylim=(_LEAST, top), xlim=(0, None), xlabel="driven, m", ylabel="position error, m")
    axes.set_title(row.localizer, loc="left")
    return picture(
        figure,
        name=f"error-{number}",
        title=f"Error over distance: {row.localizer}",
        caption="",
        alt=f"Position error of {row.localizer} over the distance driven",
    )


def localized_chart(rows: Sequence[Row], looks: Looks) -> Picture:
    """Share of runs that are localized for good over the distance driven."""
    curves = {}
    for row in rows:
        metres = [played.fixes.metres_to_localize for played in row.played]
        runs = [*metres, *[math.inf] * row.failed]
        curves[row.localizer] = curve_of({run: [m] for run, m in enumerate(runs)})
    return share_chart(
        curves,
        looks,
        end=max(float(played.way[-1]) for row in rows for played in row.played),
        name="localized",
        words=LOCALIZED,
    )


def error_charts(rows: Sequence[Row], looks: Looks) -> list[Picture]:
    """Error over distance, a chart per localizer, on one scale."""
    tops = [_error(played).max() for row in rows for played in row.played]
    top = 1.3 * max(*tops, 1.0)
    return [
        error_chart(row, looks[row.localizer], top, number) for number, row in enumerate(rows, 1)
    ]


def _error(played: Played) -> Floats:
    assert played.errors is not None
    return played.errors.translation


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
