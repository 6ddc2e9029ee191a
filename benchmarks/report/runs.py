"""Runs of localizers as rows: on a whole log, with limits on them, and from starts that are wrong.

``runs`` is a frame with a row for each run on a log: label, seed, track (None if it failed) and
scores. Lengths are in m, angles in rad; errors are those of best clusters.
"""

import math
import operator
import re
from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from statistics import median_high
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.tables import short_names
from benchmarks.tables.frames import milliseconds_per_step, value_in
from benchmarks.tables.stats import wilson
from benchmarks.trials import Trial
from benchmarks.trials.scores import JOURNEY_SCORES, TRACK_GROUPS, journey_scores
from benchmarks.trials.scoring import Finished
from benchmarks.trials.tracks import FOUND, NEAR, EstimatedTrack, middle, settled
from deqmcl_gym.logs import Log
from deqmcl_gym.maps.map import metre
from deqmcl_gym.validation import InputError, one_of, shown

_SUMMARY = (
    "position_median", "position_p95", "heading_median", "position_median_stamps",
    "heading_median_stamps", "success_1m", "success_1m_low", "success_1m_high", "success_05m",
    "within_1m", "within_05m", "metres_to_localize", "lost", "coverage_50", "coverage_80",
    "coverage_95", "nees", "log_score", "calibration_scale", "calibration_position",
    "calibration_heading", "ape_rmse", "rpe_rmse", "agreement_01", "agreement_03",
    "ms_per_step",
)  # fmt: skip
_SCORES = tuple(name for name in _SUMMARY if not name.endswith(("_low", "_high")))
_OF_RUNS = [score for name, score in JOURNEY_SCORES.items() if name in _SCORES]
COMPARISONS = tuple(
    f"{score}_{end}"
    for score in ("success_1m", "metres_to_localize", "position_median")
    for end in ("diff", "diff_low", "diff_high", "p_holm")
)
NUMBERS = ("seeds", "failed", *_SUMMARY, *COMPARISONS)  # columns of results.csv
_REACHED = f"success_{FOUND}"


def runs_frame(
    records: Mapping[str, Sequence[Finished]], failed: Mapping[str, int], log: Log
) -> pd.DataFrame:
    """Return the runs of localizers on a log, by label; and how many more failed."""
    rows = list[dict[str, Any]]()
    for label, finished in records.items():
        for record in finished:
            assert record.track is not None
            run = {"label": label, "seed": record.trial.trial, "track": record.track.on(log)}
            run |= {name: v for name, v in record.track.scores.items() if v is not None}
            run |= {score.name: value_in(record, score) for score in _OF_RUNS}
            rows.append(run | {"ms_per_step": milliseconds_per_step([record])})
        rows += [{"label": label, "seed": -1, "track": None}] * failed.get(label, 0)
    return pd.DataFrame(rows, columns=["label", "seed", "track", *_SCORES])


def run_of_track(label: str, track: EstimatedTrack, scores: Mapping[str, float]) -> pd.DataFrame:
    """Return the run of somebody else's track, of which no time is known."""
    whole = journey_scores(track.journey(), TRACK_GROUPS) if track.known.size else {}
    row = {"label": label, "seed": 0, "track": track, **scores, **whole}
    return pd.DataFrame([row], columns=["label", "seed", "track", *_SCORES])


def ended(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs that came to their end."""
    return runs[runs["track"].notna()]


def scores_by_localizer(runs: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each localizer: label, seeds, failed, and its scores.

    Positions, headings: middle and 95 % of all records of all runs; success: share of all runs,
    failed ones too; metres: median over these; else means over the runs that came to their end.
    """
    rows = []
    for label, group in runs.groupby("label", sort=False):
        done = ended(group)
        row = {"label": label, "seeds": len(group), "failed": len(group) - len(done)}
        rows.append(row | (_scores(done, len(group)) if len(done) else {}))
    return pd.DataFrame(rows, columns=["label", "seeds", "failed", *_SUMMARY])


def _scores(runs: pd.DataFrame, seeds: int) -> dict[str, float]:
    scores = {name: float(np.mean([*runs[name]])) for name in _SCORES}
    errors = [np.array(track.errors) for track in runs["track"]]
    stamps = [track.at_stamps for track in runs["track"]]
    position, heading = np.concatenate(errors, axis=1)
    near, turned = np.concatenate([e[:, at] for e, at in zip(errors, stamps, strict=True)], axis=1)
    shares = {f"success_{name}": scores[f"success_{name}"] * len(runs) / seeds for name in NEAR}
    low, high = wilson(shares[_REACHED], seeds)
    metres = [*runs["metres_to_localize"], *[math.inf] * (seeds - len(runs))]
    return scores | {
        "position_median": middle(position),
        "position_p95": float(np.quantile(position, 0.95)) if position.size else math.nan,
        "heading_median": middle(heading),
        "position_median_stamps": middle(near),
        "heading_median_stamps": middle(turned),
        **shares,
        f"{_REACHED}_low": low,
        f"{_REACHED}_high": high,
        "metres_to_localize": float(np.median(metres)),
        "ms_per_step": float(runs["ms_per_step"].median()),
    }


def middle_run(runs: pd.DataFrame) -> pd.Series:
    """Return a localizer's run of the median error, or without a reference of that agreement."""
    by = "position_median" if runs["track"].iloc[0].known.size else "agreement_03"
    return runs.sort_values(by, kind="stable").iloc[(len(runs) - 1) // 2]


def worst_run(runs: pd.DataFrame) -> pd.Series:
    """Return the run with the fewest records within 1 m and 30°, then the largest 95 % error."""
    if not runs["track"].iloc[0].known.size:
        return runs.sort_values("agreement_03", kind="stable").iloc[0]
    by = [f"within_{FOUND}", "position_p95"]
    return runs.sort_values(by, ascending=[True, False], kind="stable").iloc[0]


def tracks_table(runs: pd.DataFrame, compared: pd.DataFrame | None) -> pd.DataFrame:
    """Return results.csv: a row per localizer, its scores, then its differences if compared."""
    table = scores_by_localizer(runs).rename(columns={"label": "localizer"})
    if compared is None:
        return table.reindex(columns=["localizer", *NUMBERS])
    beside = compared[(compared["panel"] == 1) & (compared["offset"] == 0)].set_index("label")
    return table.join(beside.reindex(columns=list(COMPARISONS)), on="localizer")


def tracks_trials(runs: pd.DataFrame) -> pd.DataFrame:
    """Return trials.csv: a row per run that came to its end."""
    table = ended(runs).rename(columns={"label": "localizer"})
    return table[["localizer", "seed", *_SCORES]]


_COMPARE = {">": operator.gt, "<": operator.lt, ">=": operator.ge, "<=": operator.le}
_FORM = re.compile(r"\s*(?:(.+)\.)?(\w+)\s*([<>]=?)\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*")


class LimitError(RuntimeError):
    """A row is beyond a limit, or its value is unknown."""

    exit_code = 4


def limits_of(
    texts: Sequence[str], rows: Collection[str] | None = None
) -> list[tuple[str, str, str, str, float]]:
    """Read limits ``[ROW.]COLUMN > NUMBER``: text, row ("" is all), column, sign and number."""
    limits = []
    for text in texts:
        if (parts := _FORM.fullmatch(text)) is None:
            raise InputError(
                f"--fail-if is {shown(text)}, but must be a column of results.csv, one of "
                f"{', '.join(_COMPARE)}, and a number, as in 'position_p95 > 0.2' or "
                "'amcl.position_p95 > 0.2'."
            )
        row, column, compare, value = parts.groups(default="")
        one_of("column of --fail-if", column, NUMBERS)
        if row and rows is not None:
            one_of("row of --fail-if", row, rows)
        limits.append((text.strip(), row, column, compare, float(value)))
    return limits


def within(text: str, table: pd.DataFrame, limits: Sequence[str], baseline: str = "") -> str:
    """Return what a command prints; print it and raise if a row is beyond a limit, or unknown."""
    whole, broken = table.set_index("localizer"), list[str]()
    for words, row, column, compare, limit in limits_of(limits, [*whole.index]):
        values = whole.loc[[row], column] if row else whole[column]
        if not row and column in COMPARISONS:  # the baseline is compared with nothing
            values = values.drop(baseline, errors="ignore")
        for name, value in values[values.isna() | _COMPARE[compare](values, limit)].items():
            number = "an unknown value" if math.isnan(value) else f"{value:.4g}"
            broken.append(f"{name} has {number} ({words})")
    if broken:
        print(text)
        raise LimitError(f"beyond --fail-if: {'; '.join(broken)}.")
    return text


WITHIN = 10.0  # m, or half of a log's segment if that is less
_ERRORS = ("prior.distance", "prior.angle")
_PLACE = ["localizer", "distance_m", "angle_deg"]
_COLUMNS = (
    *(*_PLACE, "runs", "localized", "share", "share_low", "share_high"),
    *("metres_median", "steps_median"),
)
_NEVER = math.inf, math.inf


def starts_table(records: Iterable[Finished], failures: Iterable[Trial] = ()) -> pd.DataFrame:
    """Return basin.csv: a row per localizer and error of the start; none of other priors.

    Localized: within 10 m, or half of a log's segment, the best cluster comes within 1 m and 30° of
    the truth, and stays there to the end of the run. A failed run counts as never localized.
    """
    listed = list(records)
    size = metre(listed[0].unit) if listed else 1.0
    reached = [(record.trial, *_reached(record)) for record in listed]
    reached += [(trial, *_NEVER) for trial in failures]
    reached = [run for run in reached if run[0].assumed.keys() & {*_ERRORS}]
    labels = _labels([trial for trial, *_ in reached])
    runs = []
    for label, (trial, way, steps) in zip(labels, reached, strict=True):
        distance, angle = (trial.assumed.get(name, 0.0) for name in _ERRORS)
        within = min(WITHIN, trial.world.get("segment", math.inf) / size / 2)
        place = label, distance / size, round(math.degrees(angle), 1)
        runs.append((*place, way, steps, way <= within))
    frame = pd.DataFrame(runs, columns=[*_PLACE, "way", "steps", "localized"])
    frame["localizer"] = pd.Categorical(labels, list(dict.fromkeys(labels)))
    rows = []
    for cell, group in frame.groupby(_PLACE, observed=True):
        count, localized = len(group), int(group["localized"].sum())
        share = localized / count
        medians = median_high(group["way"]), median_high(group["steps"])
        rows.append((*cell, count, localized, share, *wilson(share, count), *medians))
    return pd.DataFrame(rows, columns=_COLUMNS)


def _reached(record: Finished) -> tuple[float, float]:
    """Metres and steps until a run is localized for good."""
    if record.journey is None:
        return _NEVER
    curves = record.journey.curves
    first = settled(NEAR[FOUND].holds(np.array(curves["distance"]), np.array(curves["angle"])))
    return _NEVER if first is None else (curves["way"][first], float(first))


def _labels(trials: Sequence[Trial]) -> list[str]:
    """Name the localizer of each trial, with what else its trials differ in than the error."""
    names = [trial.localizer for trial in trials]
    places = [{"scenario": t.scenario, **t.world, **t.assumed, **t.params}.items() for t in trials]
    short, shared = short_names(set(names)), dict[str, Set[tuple[str, Any]]]()
    for name, place in zip(names, places, strict=True):
        shared[name] = shared.get(name, place) & place
    labels = []
    for name, place in zip(names, places, strict=True):
        others = (f"{n} {v}" for n, v in sorted(place - shared[name]) if n not in _ERRORS)
        labels.append(" ".join([short[name], *others]))
    return labels
