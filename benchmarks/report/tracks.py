"""What a report says and draws of runs on a whole log: scores, differences, tracks, errors.

``runs`` is a ``runs_frame``. Lengths are in m, angles in rad; errors are those of best clusters.
"""

import math
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from benchmarks.report.charts import INK, Chart, canvas, line
from benchmarks.report.runs import ended, middle_run, runs_frame, scores_by_localizer, worst_run
from benchmarks.report.tables import Part, Table, means, nees_words, words
from benchmarks.setup.logs import LogScenario
from benchmarks.setup.names import scenario
from benchmarks.tables import p_value, percent
from benchmarks.tables.frames import paired_worlds, whole_runs
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import ALPHA, sample_sd, worlds_to_see
from benchmarks.trials.scores import CALIBRATION, JOURNEY_SCORES, LEVELS
from benchmarks.trials.tracks import FOUND, NEAR
from deqmcl_gym.maps import Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.drawing import PALE, Drawing, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TO_THE_END = "localized to the end"
_CALIBRATION = [f"calibration_{name}" for name in CALIBRATION]


def tracked(panel: Panel) -> tuple[pd.DataFrame, Map] | None:
    """Return the runs of each method of a panel, and the map; None if it has no tracks.

    None also where log and map are not there any more, or need somebody's code.
    """
    records = panel.records
    if any(record.track is None for finished in records.values() for record in finished):
        return None
    try:
        replayed = scenario(panel.setting.scenario).changed(panel.setting.world)
        if not isinstance(replayed, LogScenario):
            return None
        log, floor_plan = replayed.recording()
    except InputError:
        return None
    failed = {label: int(panel.runs_of(label)["failed"].sum()) for label in records}
    runs = runs_frame(records, failed, log)
    same = all(len(track.best) == len(log) for track in ended(runs)["track"])
    return (runs, floor_plan) if same else None


def track_parts(panel: Panel) -> list[Part]:
    """Return tables and charts of runs on a log; none of other runs."""
    if (runs_and_map := tracked(panel)) is None:
        return []
    runs, floor_plan = runs_and_map
    note = (
        "Best clusters: the heaviest cell of a histogram of the belief (1 m × 1 m × 30°) and its "
        "neighbours, the one place that it favours. The cross is where the robot was when it was "
        "last lost: from there on the estimate is never again within 1 m and 30°."
    )
    return [
        Part("", tables=tables_of(runs, without=[_TO_THE_END])),  # the verdict has it
        Part("On the map", note, charts=track_charts(panel, runs, floor_plan)),
        Part("Over the distance driven", charts=error_charts(panel, runs)),
    ]


def tables_of(runs: pd.DataFrame, without: Collection[str] = ()) -> list[Table]:
    """Return the scores as readable tables, without these columns; one without a reference."""
    tracks, rows = list(ended(runs)["track"]), scores_by_localizer(runs)
    if rows.empty:
        return []

    def cells(name: str, write: Callable[[float], str]) -> list[str]:
        return [  # metres that are infinite were never enough
            write(score) if math.isfinite(score) else "n/a" if math.isnan(score) else "never"
            for score in rows[name]
        ]

    def counts(name: str, of: pd.Series) -> list[str]:
        shares = zip(rows[name], of, strict=True)
        return ["n/a" if math.isnan(share) else f"{round(share * n)} of {n}" for share, n in shares]

    metres = "{:.3f} m".format
    first = {"localizer": list(rows["label"]), "runs": words(rows, str, "seeds")}
    timed = {"ms per step": cells("ms_per_step", "{:.2f}".format)}
    fitting = {"beams within 0.1 m": cells("agreement_01", percent)}
    fitting["0.3 m"] = cells("agreement_03", percent)
    if not any(track.known.size for track in tracks):
        return [Table("agreement", pd.DataFrame(first | fitting | timed))]
    results = {
        **first,
        "within 1 m, 30°": cells("within_1m", percent),
        "0.5 m, 10°": cells("within_05m", percent),
        _TO_THE_END: counts("success_1m", rows["seeds"]),
        # of a failed run it is not known
        "lost": counts("lost", rows["seeds"] - rows["failed"]),
        "position, median": cells("position_median", metres),
        "95 %": cells("position_p95", metres),
        "heading, median": cells("heading_median", _degrees),
        "metres to localize": cells("metres_to_localize", "{:.1f} m".format),
        **timed,
    }
    beliefs = {
        **first,
        **{f"inside {level} %": cells(f"coverage_{level}", percent) for level in LEVELS},
        "NEES (3)": cells("nees", nees_words),
        "log score": cells("log_score", "{:,.2f}".format),
        "APE, rmse": cells("ape_rmse", metres),
        "RPE": cells("rpe_rmse", metres),
        **fitting,
    }
    between = any(track.at_stamps.size < track.known.size for track in tracks)
    if between:
        beliefs["position, median, at stamps"] = cells("position_median_stamps", metres)
        beliefs["heading"] = cells("heading_median_stamps", _degrees)
    return [
        Table("accuracy", pd.DataFrame(results).drop(columns=[*without])),
        Table("beliefs", pd.DataFrame(beliefs), about=between),
    ]


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.2f}°"


def accuracy(runs: pd.DataFrame) -> list[str]:
    """Say how exact the localizers are, the best first, and what the worst run of all was."""
    done = ended(runs)
    referenced = done[[bool(track.known.size) for track in done["track"]]]
    if referenced.empty:
        return []
    compared = runs[runs["label"].isin(referenced["label"])]
    rows = scores_by_localizer(compared).sort_values("position_median")
    errors = ", ".join(words(rows, "{} {:.3f} m".format, "label", "position_median"))
    worst = worst_run(referenced)
    remark = f"Worst run: {_whose(worst, runs)}: {run_words(worst)}"
    farthest = max((run for _, run in referenced.iterrows()), key=_largest)
    if f"{_largest(farthest):.2f}" != f"{_largest(worst):.2f}":
        remark += f" The largest error is {_largest(farthest):.2f} m, of {_whose(farthest, runs)}."
    return [f"Position error, median over all records: {errors}. {remark}"]


def published(runs: pd.DataFrame) -> list[str]:
    """Say how each localizer's covariance is calibrated, ready to be pasted: medians over runs."""
    done = ended(runs)
    if done[_CALIBRATION].isna().all(axis=None):
        return []
    size = metre(done["track"].iloc[0].log.unit)
    middle = done.groupby("label", sort=False)[_CALIBRATION].median().dropna()
    lines = [
        f"{label}: Calibration(scale={scale:.3g}, position={position * size:.3g}, "
        f"heading={heading:.3g})"
        for label, scale, position, heading in middle.itertuples()
    ]
    return [
        "Coverage, NEES and log score are of published covariances, scale · P + floor, in the "
        "records after those that each run's calibration is fitted to. For localizers.Tracker(…, "
        f"calibration=…), medians over runs: {'; '.join(lines)}."
    ]


def _whose(run: pd.Series, runs: pd.DataFrame) -> str:
    """Name the localizer of a run, and the seed if it has several runs: a trajectory has none."""
    label = str(run["label"])
    return f"{label}, seed {run['seed']}" if (runs["label"] == label).sum() > 1 else label


def _largest(run: pd.Series) -> float:
    """The largest position error of a run, m."""
    return float(run["track"].errors.translation.max())


def differences_table(panel: Panel) -> Table | None:
    """How methods differ from the baseline, and what it takes to show it; None of one method."""
    rows = panel.present[~panel.present["is_baseline"]]
    if rows.empty or not {"success_1m", "position_median"} <= set(rows):
        return None
    columns = {"localizer": list(rows["label"]), "pairs": words(rows, str, "paired_worlds")}
    for name, title, form, scale, what in (
        ("success_1m", "localized to the end, percentage points", "+.0f", 100, "localized"),
        ("position_median", "position error, median, m", "+.3f", 1, "position"),
    ):
        columns[title] = means(rows, f"{name}_diff", form, scale=scale)
        columns[f"p, Holm ({what})"] = words(rows, p_value, f"{name}_p_holm")
        columns[f"runs needed ({what})"] = [_needed(panel, name, r) for _, r in rows.iterrows()]
    return Table("", pd.DataFrame(columns))


def _needed(panel: Panel, score: str, row: pd.Series) -> str:
    """How many runs would show a difference; – where it is shown, or there is none."""
    runs = [panel.runs_of(row[column]) for column in ("label", "reference")]
    pairs = paired_worlds(*(whole_runs(rows, JOURNEY_SCORES[score]) for rows in runs))
    differences = pairs["apart"].to_numpy()
    mean, sd = abs(float(differences.mean())) if differences.size else 0.0, sample_sd(differences)
    low, high = row[f"{score}_diff_low"], row[f"{score}_diff_high"]
    clear = (low > 0 or high < 0) and row[f"{score}_p_holm"] < ALPHA
    needed = 0 if clear or not sd >= 0 or not mean else worlds_to_see(mean, sd, panel.tests)
    if needed <= len(differences):
        return "–"
    # two digits: it is known no better
    return f"about {int(float(f'{needed:.2g}')):,}" if needed <= 100_000 else "more than 100,000"


def run_words(run: pd.Series) -> str:
    """Say how a run ended: where it was lost, or how far off it was at most."""
    track = run["track"]
    if not track.known.size:
        return f"{percent(run['agreement_03'])} of the beams within 0.3 m of the map."
    within = f"{percent(run[f'within_{FOUND}'])} of its records are within 1 m and 30°"
    most = f"its largest error is {_largest(run):.2f} m"
    if track.lost is None:
        end = "to" if run[f"success_{FOUND}"] else "at"  # of the last quarter, or only lately
        for first, last in sorted(track.astray, key=np.ptp)[-1:]:
            within += f", the longest stretch beyond from {first:.1f} to {last:.1f} m"
        return f"localized {end} the end; {within}, {most}."
    record, way = track.lost
    if record == track.known[0]:
        return f"never within 1 m and 30° of the reference; {most}."
    elapsed = track.log.times[record] - track.log.times[0]
    return (
        f"lost after {way:.1f} m, {elapsed:,.1f} s: never again within 1 m and 30°; {within}, "
        f"{most}."
    )


_GREY = 140  # of walls
_UNKNOWN = 50 / (255 - PALE[0])  # opacity per darkness: 50 of 255 for unknown cells, walls whole
_POINTS = 300  # of a curve
_LEAST = 0.01  # m: where the axis of errors begins


def track_charts(panel: Panel, runs: pd.DataFrame, floor_plan: Map) -> list[Chart]:
    """The median run of each localizer on the map, and its worst one if that is another."""
    charts = []
    for number, (label, group) in enumerate(runs.groupby("label", sort=False), 1):
        if (done := ended(group)).empty:
            continue
        name = f"trajectory-{panel.number}-{number}"
        median, worst = middle_run(done), worst_run(done)
        drawn = {"median run": (median, name), "worst run": (worst, f"{name}-worst")}
        if worst["track"] is median["track"]:
            drawn = {"median and worst run" if len(group) > 1 else "the run": (median, name)}
        for which, (run, file) in drawn.items():
            best = pd.DataFrame(run["track"].best, columns=["x", "y", "heading"])
            frame = panel.labelled(best.assign(label=label))
            charts.append(_trajectory(f"{label}: {which}", frame, run, floor_plan, file))
    return charts


def error_charts(panel: Panel, runs: pd.DataFrame) -> list[Chart]:
    """Error over the distance driven."""
    drawn = []
    for label, group in ended(runs).groupby("label", sort=False):
        tracks = list(group["track"])
        first = tracks[0]
        if (n := first.known.size) == 0:
            continue
        at = np.unique(np.linspace(0, n - 1, min(n, _POINTS)).astype(np.intp))
        errors = np.array([track.errors.translation[at] for track in tracks])
        low, median, high = np.maximum(np.quantile(errors, [0, 0.5, 1], axis=0), _LEAST)
        curve = {"way": first.way[first.known][at], "low": low, "middle": median, "high": high}
        drawn.append(pd.DataFrame({"label": label, **curve}))
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
    title: str, best: pd.DataFrame, run: pd.Series, floor_plan: Map, name: str
) -> Chart:
    """One run of a localizer on the map, the reference, and where it was lost for good."""
    track = run["track"]
    log = track.log
    axes = map_axes(floor_plan)
    if log.reference is not None and track.known.size:
        x, y, _ = log.reference[track.known].T
        axes.plot(x, y, color=INK, alpha=0.35, lw=2.5, label="reference")
    line(best, "x", "y", axes=axes, marker="", lw=1)
    if log.reference is not None and track.lost is not None:
        x, y, _ = log.reference[track.lost[0]]
        axes.plot(x, y, "X", color=INK, ms=9, mew=0)
    return Chart(name, title, f"Seed {run['seed']}: {run_words(run)}", axes.figure)


def map_axes(floor_plan: Map, width: float = 4.8) -> "Axes":
    """Return axes with a map: its walls grey, its unknown or solid areas paler."""
    x0, y0, x1, y1 = floor_plan.bounds
    axes = canvas(width, min(9.0, (width - 0.77) * (y1 - y0) / (x1 - x0) + 0.62))
    view = View(floor_plan, 1.0)  # 480 image pixels, about as many as the page shows
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
