"""What a report says and draws of runs on a whole log: scores, differences, tracks, errors."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from benchmarks.report.svg import INK, Look, Looks, Picture, canvas, picture
from benchmarks.report.tables import Table, nees_words
from benchmarks.report.words import rounded
from benchmarks.setup.logs import LogScenario
from benchmarks.setup.names import scenario
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.pairing import differences
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import Estimate, sample_sd, worlds_to_see
from benchmarks.tables.text import estimated, p_value, percent
from benchmarks.tables.tracks import Row, TrackedRun, rows_of, worse
from benchmarks.trials.fixes import FOUND, NEAR
from benchmarks.trials.journeys import JOURNEY_SCORES, Score
from benchmarks.trials.metrics import LEVELS
from benchmarks.trials.tracks import TOLERATED
from deqmcl_gym.maps import Map
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.drawing import PALE, Drawing, View

_RESULTS = {
    "within_1m": "within 1 m, 30°",
    "within_05m": "0.5 m, 10°",
    "success_1m": "localized to the end",
    "lost": "lost",
    "position_median": "position, median",
    "position_p95": "95 %",
    "heading_median": "heading, median",
    "metres_to_localize": "metres to localize",
}
_TIMED = {"ms_per_step": "ms per step"}
_BELIEFS = {f"coverage_{level}": f"inside {level} %" for level in LEVELS} | {
    "nees": "NEES (3)",
    "log_score": "log score",
}
_FITTING = {"agreement_01": "beams within 0.1 m", "agreement_03": "0.3 m"}
_STAMPS = {
    "position_median_stamps": "position, median, at stamps",
    "heading_median_stamps": "heading",
}


def shown(panel: Panel) -> tuple[list[Row], Map | None]:
    """Return the runs of each method of a panel, and the map; none if it has no tracks.

    None also where log and map are not there any more, or need somebody's code: a folder is read on
    other machines, too.
    """
    name, records = panel.setting.scenario, panel.records
    if any(record.track is None for own in records.values() for record in own):
        return [], None
    try:
        found = scenario(name).changed(panel.setting.world)
        if not isinstance(found, LogScenario):
            return [], None
        log, floor_plan = found.recording()
    except InputError:
        return [], None
    failed = {panel.labels[method]: len(own.failed) for method, own in panel.whole.items()}
    rows = rows_of({panel.labels[method]: own for method, own in records.items()}, failed, log)
    same = all(len(run.track.best) == len(log) for row in rows for run in row.runs)
    return (rows, floor_plan) if same else ([], None)


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


def evo_tables(panel: Panel) -> list[Table]:
    """APE and RPE of each localizer's median run, as evo computes them."""
    lines = []
    for row in shown(panel)[0]:
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
    return [Table(caption, header, lines)] if lines else []


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


def differences_table(panel: Panel) -> Table | None:
    """How methods differ from the baseline, and what it takes to show it; None of one method."""
    scores = [JOURNEY_SCORES[name] for name in ("success_1m", "position_median")]
    rows = [row for row in panel.present if not row.is_baseline]
    if not rows or not all(score.name in row.journey for row in panel.present for score in scores):
        return None
    header = ["localizer", "pairs", "localized to the end, points", "p, Holm", "runs needed"]
    header += ["position error, median, m", "p, Holm", "runs needed"]
    lines = []
    for row in rows:
        success, error = (row.journey[score.name] for score in scores)
        cells = [estimated(success.diff.percent, "+.0f"), p_value(success.p_holm)]
        cells += [_needed(panel, row, scores[0]), estimated(error.diff, "+.3f")]
        cells += [p_value(error.p_holm), _needed(panel, row, scores[1])]
        lines.append([panel.labels[row.method], str(row.paired_worlds), *cells])
    return Table(
        f"Difference to {panel.labels[rows[0].baseline]}, over runs of the same seed, with 95 % "
        f"bootstrap intervals. p is corrected by Holm's method for {panel.tests} tests. Runs "
        "needed: would show a difference of this size with 80 % power.",
        header,
        lines,
    )


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


def _needed(panel: Panel, row: Comparison, score: Score) -> str:
    """How many runs would show a difference; – where it is shown, or there is none."""
    ours, theirs = (panel.whole[method].runs(score) for method in (row.method, row.baseline))
    apart = differences(ours, theirs)
    mean, sd = abs(float(apart.mean())) if apart.size else 0.0, sample_sd(apart)
    if row.journey[score.name].significant or not mean > 0 or math.isnan(sd):
        return "–"
    needed = worlds_to_see(mean, sd, panel.tests)
    return "–" if needed <= apart.size else f"about {rounded(needed)}"


def _table(rows: Sequence[Row], caption: str, columns: Mapping[str, str]) -> Table:
    lines = []
    for row in rows:
        runs = dict.fromkeys(columns, row.seeds)
        runs["lost"] = len(row.runs)  # of a failed run it is not known
        cells = [_word(name, row.scores.get(name, math.nan), runs[name]) for name in columns]
        lines.append([row.label, str(row.seeds), *cells])
    return Table(caption, ["localizer", "runs", *columns.values()], lines)


def _word(name: str, value: float, runs: int) -> str:
    if not math.isfinite(value):
        return "n/a" if math.isnan(value) else "never"
    kind = name.partition("_")[0]
    if kind == "nees":
        return nees_words(Estimate(value))
    if kind == "log":
        return f"{value:,.2f}"
    if kind in ("agreement", "within", "coverage"):
        return percent(value)
    if kind in ("success", "lost"):
        return f"{round(value * runs)} of {runs}"
    forms = {"heading": f"{math.degrees(value):.2f}°", "metres": f"{value:.1f} m"}
    return forms.get(kind, f"{value:.2f}" if kind == "ms" else f"{value:.3f} m")


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
    label: str, run: TrackedRun, which: str, floor_plan: Map, look: Look, name: str
) -> Picture:
    """One run of a localizer on the map, the reference, and where it was lost for good."""
    track = run.track
    x0, y0, x1, y1 = floor_plan.bounds
    width = 4.8
    height = min(9.0, (width - 0.77) * (y1 - y0) / (x1 - x0) + 0.62)
    lost = track.lost
    figure, axes = canvas(width, height, legend_of=(label, "reference", *([_LOST] if lost else [])))
    draw_map(floor_plan, axes)
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
    n = len(way)
    at = np.unique(np.linspace(0, n - 1, min(n, _POINTS)).astype(np.intp))
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


def draw_map(floor_plan: Map, axes: Axes) -> None:
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
