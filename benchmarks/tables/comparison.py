"""results.csv: every method of a setting against the setting's baseline, over paired worlds."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields, replace

import numpy as np

from benchmarks.tables.auroc import Auroc, auroc_of
from benchmarks.tables.pairing import (
    BASELINE,
    METHOD_COLUMNS,
    SETTING_COLUMNS,
    Method,
    Record,
    Setting,
    method_of,
    per_world,
    setting_of,
)
from benchmarks.tables.stats import holm, paired_bootstrap, sample_sd, wilcoxon, wilson, win_rate
from benchmarks.tables.text import csv_text
from benchmarks.trials.scoring import SCORE_NAMES
from deqmcl_gym.numerics.types import Floats

Run = tuple[int, int]  # trial, filter seed

AVERAGED = tuple(name for name in SCORE_NAMES if name not in ("error", "lost"))


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One method of a setting at one offset; NaN is not available.

    Attributes:
        setting, method, offset: of what.
        worlds, runs: on how much; the runs on a world are averaged first.
        error, error_low, error_high, error_sd: mean over worlds of e, its 95 % bootstrap interval
            and the SD over worlds.
        means: of the other scores, by name.
        lost_rate, lost_low, lost_high: share of lost runs, with Wilson's 95 % interval for as
            many cases as worlds.
        detection: how well its quality tells that it is far off; only at offset 0.
        baseline: what it is compared with, at offset 0.
        paired_worlds: worlds that both have run.
        diff, diff_low, diff_high: mean over worlds of error - the baseline's, 95 % bootstrap.
        win_rate: share of worlds where its error is the smaller one.
        p, p_holm: Wilcoxon's signed-rank test of the differences, alone and corrected for all
            methods of the setting at this offset.
    """

    setting: Setting
    method: Method
    offset: int
    worlds: int
    runs: int
    error: float
    error_low: float
    error_high: float
    error_sd: float
    means: dict[str, float]
    lost_rate: float
    lost_low: float
    lost_high: float
    detection: Auroc
    baseline: Method
    paired_worlds: int
    diff: float = math.nan
    diff_low: float = math.nan
    diff_high: float = math.nan
    win_rate: float = math.nan
    p: float = math.nan
    p_holm: float = math.nan


def comparisons(records: Sequence[Record], baseline: str = BASELINE) -> list[Comparison]:
    """Compare what was run: settings, methods and offsets in the order in which they appear."""
    settings: dict[Setting, dict[Method, list[Record]]] = {}
    for record in records:
        methods = settings.setdefault(setting_of(record["trial"]), {})
        methods.setdefault(method_of(record["trial"]), []).append(record)
    rows = []
    for setting, methods in settings.items():
        rows += _corrected(_setting_rows(setting, methods, baseline))
    return rows


def baseline_of(method: Method, methods: Iterable[Method], name: str = BASELINE) -> Method:
    """The localizer of that name with the parameters it shares with the method; else the first."""
    listed = list(methods)
    candidates = [m for m in listed if m.localizer == name and m.agrees(method)]
    return (candidates or [m for m in listed if m.localizer == name] or listed)[0]


def results_csv(rows: Iterable[Comparison]) -> str:
    """Return results.csv: one line per setting, method and offset; nothing of the machine."""
    nested = ("setting", "method", "means", "detection")
    plain = [f.name for f in fields(Comparison) if f.name not in nested]
    at = plain.index("error_sd") + 1
    header = [*SETTING_COLUMNS, *METHOD_COLUMNS, *plain[:at], *AVERAGED, *plain[at:]]
    header += [f.name for f in fields(Auroc)]
    lines = []
    for row in rows:
        values = [getattr(row, name) for name in plain]
        values[plain.index("baseline")] = row.baseline.localizer
        lines.append(
            [
                *astuple(row.setting),
                *astuple(row.method),
                *values[:at],
                *(row.means[name] for name in AVERAGED),
                *values[at:],
                *astuple(row.detection),
            ]
        )
    return csv_text(header, lines)


def _setting_rows(
    setting: Setting, methods: dict[Method, list[Record]], name: str
) -> list[Comparison]:
    scores = {method: _by_offset(own) for method, own in methods.items()}
    detections = {method: auroc_of(own) for method, own in methods.items()}
    rows = []
    for method, offsets in scores.items():
        baseline = baseline_of(method, methods, name)
        present = _column(scores[baseline].get(0, {}), "error")
        for offset, runs in offsets.items():
            errors = _column(runs, "error")
            over_worlds = _world_means(errors)
            low, high = paired_bootstrap(over_worlds)
            lost = float(_world_means(_column(runs, "lost")).mean())
            lost_low, lost_high = wilson(lost, over_worlds.size)
            row = Comparison(
                setting=setting,
                method=method,
                offset=offset,
                worlds=over_worlds.size,
                runs=len(runs),
                error=float(over_worlds.mean()),
                error_low=low,
                error_high=high,
                error_sd=sample_sd(over_worlds),
                means={name: float(_world_means(_column(runs, name)).mean()) for name in AVERAGED},
                lost_rate=lost,
                lost_low=lost_low,
                lost_high=lost_high,
                detection=Auroc() if offset else detections[method],
                baseline=baseline,
                paired_worlds=0,
            )
            apart = {run: error - present[run] for run, error in errors.items() if run in present}
            itself = method == baseline and offset == 0
            rows.append(row if itself or not apart else _compared(row, _world_means(apart)))
    return rows


def _compared(row: Comparison, differences: Floats) -> Comparison:
    low, high = paired_bootstrap(differences)
    return replace(
        row,
        paired_worlds=differences.size,
        diff=float(differences.mean()),
        diff_low=low,
        diff_high=high,
        win_rate=win_rate(differences),
        p=_six_digits(wilcoxon(differences)),
    )


def _corrected(rows: list[Comparison]) -> list[Comparison]:
    """Fill in p_holm: a family is what one setting tests at one offset."""
    adjusted: dict[int, float] = {}
    for offset in {row.offset for row in rows}:
        family = [i for i, row in enumerate(rows) if row.offset == offset]
        adjusted |= dict(zip(family, holm([rows[i].p for i in family]), strict=True))
    return [replace(row, p_holm=_six_digits(adjusted[i])) for i, row in enumerate(rows)]


def _by_offset(records: Sequence[Record]) -> dict[int, dict[Run, Record]]:
    """Scores by offset and run."""
    offsets: dict[int, dict[Run, Record]] = {}
    for record in records:
        run = record["trial"]["trial"], record["trial"]["filter_seed"]
        for score in record["scores"]:
            offsets.setdefault(score["offset"], {})[run] = score
    return offsets


def _column(runs: dict[Run, Record], name: str) -> dict[Run, float]:
    values = {run: score.get(name) for run, score in runs.items()}
    return {run: math.nan if value is None else value for run, value in values.items()}


def _world_means(runs: dict[Run, float]) -> Floats:
    """Means over the filter seeds of each world, in the order of the worlds."""
    return np.array(list(per_world(runs).values()))


def _six_digits(p: float) -> float:
    """As many as do not depend on how the system computes erfc."""
    return p if math.isnan(p) else float(f"{p:.6g}")
