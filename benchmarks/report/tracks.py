"""What a report says and draws of runs on a whole log: scores, differences, tracks, errors."""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from benchmarks.report.charts import INK, Chart, canvas, line
from benchmarks.report.frames import PanelFrames
from benchmarks.report.tables import Table, means, nees_words
from benchmarks.report.verdict import rounded
from benchmarks.setup.logs import LogScenario
from benchmarks.setup.names import scenario
from benchmarks.tables.frames import paired, whole_runs
from benchmarks.tables.stats import ALPHA, sample_sd, worlds_to_see
from benchmarks.tables.text import p_value, percent
from benchmarks.tables.tracks import Row, TrackedRun, rows_of, worse
from benchmarks.trials.scores import JOURNEY_SCORES, LEVELS
from benchmarks.trials.tracks import FOUND, NEAR, TOLERATED
from deqmcl_gym.maps import Map
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.drawing import PALE, Drawing, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# by score: its title, and what tells it; None counts runs
_Columns = dict[str, tuple[str, Callable[[float], str] | None]]
_METRES, _DEGREES = "{:.3f} m".format, "{:.2f}°".format
_RESULTS: _Columns = {
    "within_1m": ("within 1 m, 30°", percent),
    "within_05m": ("0.5 m, 10°", percent),
    "success_1m": ("localized to the end", None),
    "lost": ("lost", None),
    "position_median": ("position, median", _METRES),
    "position_p95": ("95 %", _METRES),
    "heading_median": ("heading, median", lambda angle: _DEGREES(math.degrees(angle))),
    "metres_to_localize": ("metres to localize", "{:.1f} m".format),
}
_TIMED: _Columns = {"ms_per_step": ("ms per step", "{:.2f}".format)}
_BELIEFS: _Columns = {
    **{f"coverage_{level}": (f"inside {level} %", percent) for level in LEVELS},
    "nees": ("NEES (3)", nees_words),
    "log_score": ("log score", "{:,.2f}".format),
}
_FITTING: _Columns = {
    "agreement_01": ("beams within 0.1 m", percent),
    "agreement_03": ("0.3 m", percent),
}
_STAMPS: _Columns = {
    "position_median_stamps": ("position, median, at stamps", _METRES),
    "heading_median_stamps": ("heading", lambda angle: _DEGREES(math.degrees(angle))),
}


def shown(panel: PanelFrames) -> tuple[list[Row], Map | None]:
    """Return the runs of each method of a panel, and the map; none if it has no tracks.

    None also where log and map are not there any more, or need somebody's code: a folder is read on
    other machines, too.
    """
    name, records = panel.setting.scenario, panel.records
    if any(record.track is None for own in records.values() for record in own):
        return [], None
    try:
        replayed = scenario(name).changed(panel.setting.world)
        if not isinstance(replayed, LogScenario):
            return [], None
        log, floor_plan = replayed.recording()
    except InputError:
        return [], None
    failed = {label: int(panel.runs_of(label)["failed"].sum()) for label in records}
    rows = rows_of(records, failed, log)
    same = all(len(run.track.best) == len(log) for row in rows for run in row.runs)
    return (rows, floor_plan) if same else ([], None)


def parts_of(panel: PanelFrames) -> list[tuple[Any, ...]]:
    """Return headings, notes, tables and charts of runs on a log; none of other runs."""
    rows, floor_plan = shown(panel)
    if floor_plan is None:
        return []
    return [
        ("", "", tables_of(rows)),
        (
            "On the map",
            "Best clusters: the heaviest cell of a histogram of the belief (1 m × 1 m × 30°) and "
            "its neighbours, the one place that it favours. The cross is where the robot was when "
            "it was last lost: from there on the estimate is never again within 1 m and 30°.",
            [],
            track_charts(panel, rows, floor_plan),
        ),
        ("Over the distance driven", "", [], error_charts(panel, rows)),
        ("APE and RPE", "", evo_tables(rows)),
    ]


def tables_of(rows: Sequence[Row]) -> list[Table]:
    """Return the scores as readable tables; without a reference only the agreement."""
    tracks = [run.track for row in rows for run in row.runs]
    if not rows:
        return []
    if not any(track.known.size for track in tracks):
        caption = "How well the scans fit the map at the pose that each localizer estimates."
        return [_table(rows, caption, _FITTING | _TIMED)]
    between = any(track.at_stamps.size < track.known.size for track in tracks)
    caption = (
        "Best cluster against the reference: share of records within a distance and an angle, runs "
        f"localized to the end (at {1 - TOLERATED:.0%} of the records of the last 25 %, within 1 m "
        "and 30°), errors over all records of all "
        "runs. Lost: off by more than 1 m on average over the last 20 records. ms per step: the "
        "localizer's own time for a record, median over runs."
    )
    of_beliefs = (
        "Share of records at the reference's own times whose reference lies in the credible region "
        "of so many per cent, and "
        "normalized estimation error squared, 3 if the belief is as sure as it may be, more if it "
        "is too sure; log score: -log of the density of the reference, nats, the smaller the "
        "better; n/a: it has no spread. Beams: with a return, within so much of the map's "
        "range at the best cluster." + " At stamps: at the reference's own times." * between
    )
    beliefs = _BELIEFS | _FITTING | (_STAMPS if between else {})
    return [_table(rows, caption, _RESULTS | _TIMED), _table(rows, of_beliefs, beliefs)]


def evo_tables(rows: Sequence[Row]) -> list[Table]:
    """APE and RPE of each localizer's median run, as evo computes them."""
    lines = []
    for row in rows:
        run = row.middle
        for name, errors in {"APE": run.track.errors, "RPE": run.track.relative}.items():
            if (moved := errors.translation).size:
                numbers = (errors.rmse, moved.mean(), float(np.median(moved)), moved.max())
                turned = f"{math.degrees(errors.rotation.mean()):.2f}°"
                metres = (f"{value:.3f} m" for value in numbers)
                lines.append([f"{row.label} {name}", str(run.seed), *metres, turned])
    header = ["median run", "seed", "rmse", "mean", "median", "max", "rotation, mean"]
    caption = (
        "APE without alignment, RPE from record to record, as evo_ape tum and evo_rpe tum compute "
        "them from the trajectories in tracks/."
    )
    return [Table(caption, pd.DataFrame(lines, columns=header))] if lines else []


def accuracy(rows: Sequence[Row]) -> list[str]:
    """Say how exact the localizers are, the best first, and what the worst run of all was."""
    known = [row for row in rows if any(run.track.known.size for run in row.runs)]
    if not known:
        return []
    ranked = sorted(known, key=lambda row: row.scores["position_median"])
    errors = ", ".join(f"{row.label} {row.scores['position_median']:.3f} m" for row in ranked)
    worst = min(known, key=lambda row: worse(row.worst))
    said = f"Worst run: {worst.label}, seed {worst.worst.seed}: {told(worst.worst)}"
    runs = [(row, run) for row in known for run in row.runs if run.track.known.size]
    row, run = max(runs, key=lambda one: largest(one[1]))
    if run is not worst.worst:
        said += (
            f" The largest error of all is {largest(run):.2f} m, of {row.label}, seed {run.seed}."
        )
    return [f"Position error, median over all records: {errors}. {said}"]


def largest(run: TrackedRun) -> float:
    """The largest position error of a run, m."""
    return float(run.track.errors.translation.max())


def differences_table(panel: PanelFrames) -> Table | None:
    """How methods differ from the baseline, and what it takes to show it; None of one method."""
    scores = {"success_1m": ("localized to the end, points", "+.0f", 100, "points")}
    scores["position_median"] = ("position error, median, m", "+.3f", 1, "m")
    rows = panel.present[~panel.present["is_baseline"]]
    if rows.empty or not scores.keys() <= set(rows):
        return None
    columns: dict[str, Sequence[str]] = {
        "localizer": list(rows["label"]),
        "pairs": [str(n) for n in rows["paired_worlds"]],
    }
    for name, (words, form, scale, unit) in scores.items():
        columns[words] = list(means(f"{name}_diff", form, scale=scale)(rows))
        columns[f"p, Holm ({unit})"] = [p_value(p) for p in rows[f"{name}_p_holm"]]
        columns[f"runs needed ({unit})"] = [_needed(panel, row, name) for _, row in rows.iterrows()]
    caption = (
        f"Difference to {rows['reference'].iloc[0]}, over runs of the same seed, with 95 % "
        f"bootstrap intervals. p is corrected by Holm's method for {panel.tests} tests. Runs "
        "needed: would show a difference of this size with 80 % power."
    )
    return Table(caption, pd.DataFrame(columns))


def told(run: TrackedRun) -> str:
    """Say how a run ended: where it was lost, or how far off it was at most."""
    track, scores = run.track, run.scores
    if not track.known.size:
        return f"{percent(scores['agreement_03'])} of the beams within 0.3 m of the map."
    within = f"{percent(scores[f'within_{FOUND}'])} of its records are within 1 m and 30°"
    most = f"its largest error is {largest(run):.2f} m"
    if track.lost is None:
        end = "to" if scores[f"success_{FOUND}"] else "at"  # of the last quarter, or but lately
        return f"localized {end} the end; {within}, {most}."
    record, way = track.lost
    if record == track.known[0]:
        return f"never within 1 m and 30° of the reference; {most}."
    elapsed = track.log.times[record] - track.log.times[0]
    return (
        f"lost after {way:.1f} m, {elapsed:,.1f} s: never again within 1 m and 30°; {within}, "
        f"{most}."
    )


def _needed(panel: PanelFrames, row: pd.Series, score: str) -> str:
    """How many runs would show a difference; – where it is shown, or there is none."""
    runs = [panel.runs_of(row[one]) for one in ("label", "reference")]
    apart = paired(*(whole_runs(own, JOURNEY_SCORES[score]) for own in runs))["apart"].to_numpy()
    mean, sd = abs(float(apart.mean())) if apart.size else 0.0, sample_sd(apart)
    low, high = row[f"{score}_diff_low"], row[f"{score}_diff_high"]
    shown_already = (low > 0 or high < 0) and row[f"{score}_p_holm"] < ALPHA
    if shown_already or not mean > 0 or math.isnan(sd):
        return "–"
    needed = worlds_to_see(mean, sd, panel.tests)
    return "–" if needed <= len(apart) else f"about {rounded(needed)}"


def _table(rows: Sequence[Row], caption: str, columns: _Columns) -> Table:
    lines = [
        [
            row.label,
            str(row.seeds),
            *(_cell(row, name, tell) for name, (_, tell) in columns.items()),
        ]
        for row in rows
    ]
    header = ["localizer", "runs", *(title for title, _ in columns.values())]
    return Table(caption, pd.DataFrame(lines, columns=header))


def _cell(row: Row, name: str, tell: Callable[[float], str] | None) -> str:
    value = row.scores.get(name, math.nan)
    if not math.isfinite(value):
        return "n/a" if math.isnan(value) else "never"
    if tell is not None:
        return tell(value)
    runs = len(row.runs) if name == "lost" else row.seeds  # of a failed run it is not known
    return f"{round(value * runs)} of {runs}"


_SCALE = 1.0  # of a drawn map: 480 image pixels, about as many as the page shows
_GREY = 140  # of walls
_UNKNOWN = 50 / (255 - PALE[0])  # opacity per darkness: 50 of 255 for unknown cells, walls whole
_POINTS = 300  # of a curve
_LEAST = 0.01  # m: where the axis of errors begins


def track_charts(panel: PanelFrames, rows: Sequence[Row], floor_plan: Map) -> list[Chart]:
    """The median run of each localizer on the map, and its worst one if that is another."""
    charts = []
    for number, row in enumerate(rows, 1):
        name = f"trajectory-{panel.number}-{number}"
        runs = {"median run": (row.middle, name), "worst run": (row.worst, f"{name}-worst")}
        if row.worst is row.middle:
            runs = {"median and worst run" if row.seeds > 1 else "the run": (row.middle, name)}
        for which, (run, own) in runs.items():
            frame = panel.labelled(
                pd.DataFrame(run.track.best, columns=["x", "y", "heading"]).assign(label=row.label)
            )
            charts.append(_trajectory(f"{row.label}: {which}", frame, run, floor_plan, own))
    return charts


def error_charts(panel: PanelFrames, rows: Sequence[Row]) -> list[Chart]:
    """Error over the distance driven."""
    drawn = []
    for row in rows:
        first = row.runs[0].track
        if (n := first.known.size) == 0:
            continue
        at = np.unique(np.linspace(0, n - 1, min(n, _POINTS)).astype(np.intp))
        errors = np.array([run.track.errors.translation[at] for run in row.runs])
        low, middle, high = np.maximum(np.quantile(errors, [0, 0.5, 1], axis=0), _LEAST)
        curve = {"way": first.way[first.known][at], "low": low, "middle": middle, "high": high}
        drawn.append(pd.DataFrame({"label": row.label, **curve}))
    if not drawn:
        return []
    axes = line(panel.labelled(pd.concat(drawn)), "way", "middle", "low", "high", band=True, lw=1)
    axes.axhline(NEAR[FOUND][0], color=INK, lw=0.8, ls=":")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set(ylim=(_LEAST, None), xlim=(0, None), xlabel="driven, m", ylabel="position error, m")
    caption = "Line: median over runs; band: least to largest; dotted: 1 m."
    return [Chart(f"error-{panel.number}", "Error over the distance", caption, axes.figure)]


def _trajectory(
    title: str, best: pd.DataFrame, run: TrackedRun, floor_plan: Map, name: str
) -> Chart:
    """One run of a localizer on the map, the reference, and where it was lost for good."""
    track, log = run.track, run.track.log
    axes = map_axes(floor_plan)
    if log.reference is not None and track.known.size:
        x, y, _ = log.reference[track.known].T
        axes.plot(x, y, color=INK, alpha=0.35, lw=2.5, label="reference")
    line(best, "x", "y", axes=axes, marker="", lw=1)
    if log.reference is not None and track.lost is not None:
        x, y, _ = log.reference[track.lost[0]]
        axes.plot(x, y, "X", color=INK, ms=9, mew=0)
    return Chart(name, title, f"Seed {run.seed}: {told(run)}", axes.figure)


def map_axes(floor_plan: Map, width: float = 4.8) -> "Axes":
    """Return axes with a map: its walls grey, its unknown or solid areas paler."""
    x0, y0, x1, y1 = floor_plan.bounds
    axes = canvas(width, min(9.0, (width - 0.77) * (y1 - y0) / (x1 - x0) + 0.62))
    view = View(floor_plan, _SCALE)
    darkness = 255.0 - Drawing(view).image[:, :, 0]
    image = np.full((*darkness.shape, 4), _GREY, np.uint8)
    image[:, :, 3] = np.minimum(np.rint(_UNKNOWN * darkness), 255)
    (wide, high), margin = view.size, view.margin
    columns, rows = np.array((-margin, wide - margin)), np.array((margin - high, margin))
    left, right = x0 + columns / view.per_length
    low, top = y1 + rows / view.per_length
    # not thinned again: walls would be lost
    axes.imshow(image, extent=(left, right, low, top), interpolation="none")
    unit = floor_plan.unit
    axes.set(xlim=(x0, x1), ylim=(y0, y1), aspect="equal", xlabel=f"x, {unit}", ylabel=f"y, {unit}")
    axes.grid(visible=False)
    return axes
