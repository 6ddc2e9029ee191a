"""What a report says of runs on a whole log: scores, differences, how the worst run ended."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.report.tables import Table
from benchmarks.report.words import estimated, p_value, rounded
from benchmarks.setup.logs import LogScenario
from benchmarks.setup.names import plug_ins_of, scenario
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.pairing import differences
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import sample_sd, worlds_to_see
from benchmarks.tables.text import percent
from benchmarks.tables.tracks import Row, Run, rows_of, worse
from benchmarks.trials.fixes import FOUND
from benchmarks.trials.journeys import JOURNEY_SCORES, Score
from benchmarks.trials.metrics import LEVELS
from deqmcl_gym.maps import Map
from deqmcl_gym.validation import InputError

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
_BELIEFS = {f"coverage_{level}": f"inside {level} %" for level in LEVELS} | {"nees": "NEES (3)"}
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
        found = None if plug_ins_of(name) else scenario(name).changed(panel.setting.world)
        if not isinstance(found, LogScenario):
            return [], None
        log, floor_plan = found.recording()
    except InputError:
        return [], None
    failed = {panel.labels[method]: len(own.failed) for method, own in panel.whole.items()}
    rows = rows_of({panel.labels[method]: own for method, own in records.items()}, failed, log)
    same = all(len(run.track.best) == len(log) for row in rows for run in row.runs)
    return (rows, floor_plan) if same else ([], None)


def track_tables(panel: Panel) -> list[Table]:
    """The scores by records, and what the beliefs are worth."""
    return tables_of(shown(panel)[0])


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
        "localized to the end (at every record of the last 25 %), errors over all records of all "
        "runs. Lost: off by more than 1 m on average over the last 20 records. ms per step: the "
        "localizer's own time for a record, median over runs."
    )
    of_beliefs = (
        "Share of records whose reference lies in the credible region of so many per cent, and "
        "normalized estimation error squared, 3 if the belief is as sure as it may be, more if it "
        "is too sure; n/a: it has no spread. Beams: with a return, within so much of the map's "
        "range at the best cluster." + " At stamps: at the reference's own times." * between
    )
    beliefs = _BELIEFS | _FITTING | (_STAMPS if between else {})
    return [_table(rows, caption, _RESULTS | _TIMED), _table(rows, of_beliefs, beliefs)]


def evo_tables(panel: Panel) -> list[Table]:
    """APE and RPE of each localizer's median run, as evo computes them."""
    lines = []
    for row in shown(panel)[0]:
        for name, errors in (
            ("APE", (run := row.middle).track.errors),
            ("RPE", run.track.relative),
        ):
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
    return [f"Position error, median over all records: {errors}. {said}"]


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


def told(run: Run) -> str:
    """Say how a run ended: where it was lost, or how far off it was at most."""
    track, scores = run.track, run.scores
    if not track.known.size:
        return f"{scores['agreement_03']:.0%} of the beams within 0.3 m of the map."
    within = f"{scores[f'within_{FOUND}']:.0%} of its records are within 1 m and 30°"
    largest = f"the largest error is {track.errors.translation.max():.2f} m"
    if track.lost is None:
        return f"localized to the end; {within}, {largest}."
    record, way = track.lost
    if record == track.known[0]:
        return f"never within 1 m and 30° of the reference; {largest}."
    elapsed = track.log.times[record] - track.log.times[0]
    return (
        f"lost after {way:.1f} m, {elapsed:,.1f} s: never again within 1 m and 30°; {within}, "
        f"{largest}."
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
        runs = {"lost": len(row.runs)}  # of a failed run it is not known
        cells = [
            _word(name, row.scores.get(name, math.nan), runs.get(name, row.seeds))
            for name in columns
        ]
        lines.append([row.label, str(row.seeds), *cells])
    return Table(caption, ["localizer", "runs", *columns.values()], lines)


def _word(name: str, value: float, runs: int) -> str:
    if not math.isfinite(value):
        return "n/a" if math.isnan(value) else "never"
    kind = name.partition("_")[0]
    if kind == "nees":
        value = value if value < 100 else float(f"{value:.3g}")
        return f"{value:,.{1 if value < 100 else 0}f}"
    if kind in ("agreement", "within", "coverage"):
        return percent(value)
    if kind in ("success", "lost"):
        return f"{round(value * runs)} of {runs}"
    forms = {"heading": f"{math.degrees(value):.2f}°", "metres": f"{value:.1f} m"}
    return forms.get(kind, f"{value:.2f}" if kind == "ms" else f"{value:.3f} m")
