"""Trials as rows of a frame, a row per trial and offset, and their means over worlds.

A trial is identified by its setting, its method, its world (``trial``) and its filter seed. Runs
are a series indexed by the latter two, of one method on one setting; named parts are JSON.
"""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.setup.overrides import jsonable
from benchmarks.tables.stats import NOT_KNOWN, Interval, estimate, wilson
from benchmarks.trials import Method, Setting, Trial
from benchmarks.trials.scores import JOURNEY_SCORES, Score
from benchmarks.trials.scoring import SCORE_NAMES, Finished

SETTING = tuple(field.name for field in fields(Setting))
METHOD = ("method", "params")
PANEL = (*SETTING, "swept", *METHOD)
RUN = ("trial", "filter_seed")
_COUNTS = (
    "steps_done", "scans_used", "weight_collapses", "replanned_steps", "infeasible_plans",
    "skipped_beams", "blind_scans",
)  # fmt: skip
_WHOLE = dict.fromkeys((*_COUNTS, "far_worlds", "conflict_worlds", "worlds"), "Int64")
INNER = ("way", "failed")  # columns that are not in trials.csv


def trials_frame(records: Iterable[Finished], failures: Iterable[Trial] = ()) -> pd.DataFrame:
    """Return a row per trial and offset; scores of whole runs at offset 0.

    Beside the columns of trials.csv there are ``way``, what the robot drove in m, and ``failed``: a
    trial that failed is a row with the scores of a whole run in which nothing happened; it is of
    the same setting as the records.
    """
    listed = list(records)
    whole = scores_in(listed)
    rows = [
        run_columns(record.trial)
        | {name: row.get(name) for name in ("offset", *SCORE_NAMES)}
        | {name: record.events.get(name) for name in _COUNTS}
        | {"steps_done": record.steps_done, "scans_used": record.scans_used}
        | {score.name: value_in(record, score) for score in whole if row["offset"] == 0}
        | {"way": record.journey.curves["way"][-1] if record.journey else None, "failed": False}
        for record in listed
        for row in record.scores
    ]
    failed = {"offset": 0, "failed": True} | {score.name: score.failed for score in whole}
    rows += [run_columns(trial) | failed for trial in failures]
    names = [score.name for score in whole]
    columns = [*SETTING, *METHOD, *RUN, "offset", *SCORE_NAMES, *_COUNTS, *names, *INNER]
    frame = pd.DataFrame(rows, columns=columns)
    frame[[*_COUNTS]] = frame[[*_COUNTS]].apply(pd.to_numeric)
    types = dict.fromkeys((*SCORE_NAMES, *names, "way"), "float64")
    types |= dict.fromkeys(("lag", "seed", *RUN, "offset"), "int64")
    return frame.astype(types | {"failed": "bool"})


def timings_table(records: Iterable[Finished]) -> pd.DataFrame:
    """Return timings.csv: the localizer's own time, reset left out."""
    rows = [
        run_columns(r.trial) | {"seconds": r.seconds, "ms_per_step": milliseconds_per_step([r])}
        for r in records
    ]
    return pd.DataFrame(rows, columns=[*SETTING, *METHOD, *RUN, "seconds", "ms_per_step"])


def csv_of(table: pd.DataFrame, without: Iterable[str] = ("panel", "label")) -> str:
    """Return a table as CSV with exact numbers; what is not available is an empty cell."""
    plain = table.drop(columns=[name for name in without if name in table])
    plain = plain.astype({name: kind for name, kind in _WHOLE.items() if name in plain})
    return plain.to_csv(index=False, lineterminator="\n")


def setting_columns(setting: Setting) -> dict[str, Any]:
    """Return a setting as the columns of a row."""
    parts = {name: jsonable(getattr(setting, name)) for name in SETTING}
    return {name: v if isinstance(v, str | int) else as_json(v) for name, v in parts.items()}


def method_columns(method: Method, name: str = "method", params: str = "params") -> dict[str, str]:
    """Return a method as the columns of a row."""
    agent = {"agent": method.agent.name} if method.agent else {}
    return {name: method.name, params: as_json(agent | method.values.json())}


def ends(name: str, interval: Sequence[float] = NOT_KNOWN, mean: str = "") -> dict[str, float]:
    """Return an estimate as columns: its mean, and its interval as name_low and name_high."""
    return dict(zip((mean or name, f"{name}_low", f"{name}_high"), interval, strict=True))


def run_columns(trial: Trial) -> dict[str, Any]:
    """Return what identifies a trial as the columns of a row."""
    run = dict(zip(RUN, trial.run, strict=True))
    return setting_columns(trial.setting) | method_columns(trial.method) | run


def as_json(value: Any) -> str:
    """Return a value as it stands in a cell."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def by_run(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows by world and filter seed."""
    return rows.set_index([*RUN]).sort_index()


def scored(rows: pd.DataFrame, offset: int = 0) -> pd.DataFrame:
    """Return the rows at an offset of the runs that came to their end."""
    return rows[(rows["offset"] == offset) & ~rows["failed"]]


def by_world(runs: pd.Series) -> pd.Series:
    """Return means over the filter seeds of each world; NaN where one run's is not known."""
    worlds, place = np.unique(runs.index.get_level_values("trial"), return_inverse=True)
    return pd.Series(np.bincount(place, runs) / np.bincount(place), worlds, "float64")


def paired_worlds(ours: pd.Series, theirs: pd.Series) -> pd.DataFrame:
    """Return ours - theirs (apart), and theirs, over the runs in both: a row per world."""
    both = ours.index.intersection(theirs.index).sort_values()
    differences = ours[both] - theirs[both]
    return pd.DataFrame({"apart": by_world(differences), "theirs": by_world(theirs[both])})


def whole_runs(rows: pd.DataFrame, score: Score) -> pd.Series:
    """Return a score of whole runs, failed ones too, where it is known; infinite if censored."""
    values = rows.get(score.name, pd.Series(index=rows.index, dtype="float64"))
    return pd.Series(values[rows["offset"] == 0].dropna())


def restricted(rows: pd.DataFrame, score: Score, longest: pd.Series) -> pd.Series:
    """Return ``whole_runs``, metres at most the longest way in their world (``longest_ways``)."""
    runs = whole_runs(rows, score)
    if not score.censored:
        return runs
    most = longest.reindex(runs.index.get_level_values("trial")).fillna(0.0)
    return pd.Series(np.minimum(runs, most.to_numpy()))


def longest_ways(rows: Iterable[pd.DataFrame]) -> pd.Series:
    """Return the longest way that any of these runs drove in each world, m."""
    ways = pd.concat([frame["way"] for frame in rows])
    return pd.Series(ways.groupby("trial").max().dropna())


def scores_in(records: Iterable[Finished]) -> list[Score]:
    """Return the scores of whole runs that any of these records has, in their order."""
    names = {name for record in records if record.journey for name in record.journey.scores}
    return [score for name, score in JOURNEY_SCORES.items() if name in names]


def value_in(record: Finished, score: Score) -> float:
    """Return a score of a run; infinite if it is censored, NaN if it is unknown."""
    if record.journey is None or score.name not in record.journey.scores:
        return math.nan
    value = record.journey.scores[score.name]
    return float((math.inf if score.censored else math.nan) if value is None else value)


def milliseconds_per_step(records: Sequence[Finished]) -> float:
    """Median over runs of the localizer's time per step, ms; NaN if none was timed."""
    times = [1000 * r.seconds / r.steps_done for r in records if r.seconds and r.steps_done]
    return float(np.median(times)) if times else math.nan


def share_curve(runs: pd.Series) -> pd.DataFrame:
    """Return the share of runs with at most so many metres, ∞ is never: metres, share, low, high.

    Runs on a world are averaged first; Wilson's 95 % interval is of as many cases as worlds.
    """
    metres = np.unique([0.0, *runs[np.isfinite(runs)]])
    worlds = [by_world(runs <= most) for most in metres]
    shares = [float(values.to_numpy().mean()) for values in worlds]
    bands = [wilson(share, len(worlds[0])) for share in shares]
    low, high = zip(*bands, strict=True)
    return pd.DataFrame({"metres": metres, "share": shares, "low": low, "high": high})


def errors_by_offset(records: Iterable[Finished]) -> pd.DataFrame:
    """Return the error by offset, each over the same states: offset, mean, low, high."""
    rows = [(k, *record.trial.run, e) for record in records for k, e in record.profile.items()]
    errors = by_run(pd.DataFrame(rows, columns=["offset", *RUN, "error"]))
    each = errors.groupby("offset")["error"]
    means = [(k, *estimate(by_world(group).to_numpy())) for k, group in each]
    return pd.DataFrame(means, columns=["offset", *Interval._fields])
