"""From the records of trials to table.csv, trials.csv, timings.csv and a readable Table 1."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields

import numpy as np
from tabulate import tabulate

from benchmarks.tables.pairing import BASELINE, METHOD_COLUMNS, SETTING_COLUMNS, Record, identity
from benchmarks.tables.published import TABLE_1
from benchmarks.tables.stats import paired_bootstrap, sample_sd
from benchmarks.tables.text import csv_text, fixed
from benchmarks.trials.scoring import SCORE_NAMES

_IDENTITY = (*SETTING_COLUMNS, *METHOD_COLUMNS, "trial", "filter_seed")

TITLES = {name: row.title for name, row in TABLE_1.items()} | {
    "mcl-map-smoother": "map-based MCL with smoother",
    "deq-mcl-rejuvenated": "DEQ-MCL, rejuvenated",
    "mcl-h": "map-based MCL with tabulated look-ahead",
    "mcl-pilots": "map-based MCL with pilots",
    "dead-reckoning": "dead reckoning on the plan",
}


@dataclass(frozen=True, kw_only=True)
class Row:
    """One method at one offset, averaged over trials; NaN is not available."""

    method: str
    offset: int
    error: float
    error_sd: float
    error_window: float
    entropy: float
    var_x: float
    var_y: float
    var_cos: float
    var_sin: float
    position_rmse: float
    heading_rmse: float
    wall_share: float
    diff_vs_mcl: float
    diff_low: float
    diff_high: float
    trials: int


def table_rows(records: Sequence[Record]) -> list[Row]:
    """Average the records over trials, in the order in which methods first appear."""
    methods = list(dict.fromkeys(record["trial"]["localizer"] for record in records))
    baseline = {
        _world(record): score["error"]
        for record in records
        if record["trial"]["localizer"] == BASELINE
        for score in record["scores"]
        if score["offset"] == 0
    }
    rows = []
    for method in methods:
        own = [record for record in records if record["trial"]["localizer"] == method]
        offsets = dict.fromkeys(score["offset"] for record in own for score in record["scores"])
        rows += [_row(method, offset, own, baseline) for offset in offsets]
    return rows


def table_csv(rows: Iterable[Row]) -> str:
    """Return table.csv."""
    return csv_text([field.name for field in fields(Row)], map(astuple, rows))


def trials_csv(records: Iterable[Record]) -> str:
    """Return trials.csv: one line per trial, method and offset."""
    counts = ("weight_collapses", "replanned_steps", "skipped_beams", "blind_scans")
    header = [*_IDENTITY, "offset", *SCORE_NAMES, "steps_done", "scans_used"]
    lines = [
        [
            *identity(record["trial"]),
            record["trial"]["trial"],
            record["trial"]["filter_seed"],
            score["offset"],
            *(score.get(name) for name in SCORE_NAMES),
            record["steps_done"],
            record["scans_used"],
            *(record["events"].get(name) for name in counts),
        ]
        for record in records
        for score in record["scores"]
    ]
    return csv_text([*header, *counts], lines)


def timings_csv(records: Iterable[Record]) -> str:
    """Return timings.csv: the localizer's own time, reset left out."""
    lines = [
        [
            *identity(record["trial"]),
            record["trial"]["trial"],
            record["trial"]["filter_seed"],
            record["seconds"],
            1000 * record["seconds"] / record["steps_done"] if record["seconds"] else None,
        ]
        for record in records
    ]
    return csv_text([*_IDENTITY, "seconds", "ms_per_step"], lines)


def table_1(rows: Sequence[Row], style: str) -> str:
    """Return our Table 1 with the paper's printed values beside ours.

    Args:
        rows: of ``table_rows``.
        style: a format of tabulate: "simple" for a terminal, "github" for Markdown.
    """
    header = ["method", "belief about", "error (SD)", "paper", "entropy", "paper"]
    for name in ("x", "y", "cos θ", "sin θ"):
        header += [f"var {name}", "paper"]
    header += ["error - MCL's, 95 % interval", "in walls"]
    lines = []
    for row in rows:
        printed = TABLE_1.get(row.method) if row.offset <= 0 else None
        line = [
            TITLES.get(row.method, row.method),
            state_name(row.offset),
            f"{fixed(row.error)} ({fixed(row.error_sd)})",
            f"{printed.error:.2f} ({printed.error_sd:.2f})" if printed else "",
            fixed(row.entropy),
            f"{printed.entropy:.2f}" if printed else "",
        ]
        for name, digits in (("var_x", 1), ("var_y", 1), ("var_cos", 3), ("var_sin", 3)):
            line += [
                fixed(getattr(row, name), digits),
                f"{getattr(printed, name):g}" if printed else "",
            ]
        line += [_interval(row), _percent(row.wall_share)]
        lines.append(line)
    return tabulate(
        lines,
        header,
        tablefmt=style,
        disable_numparse=True,
        stralign="right",
        colalign=("left", "left"),
    )


def state_name(offset: int) -> str:
    """x_t, x_{t-20}, … in plain characters."""
    return f"x[t{offset:+d}]" if offset else "x[t]"


def reading(rows: Sequence[Row]) -> str:
    """Return one honest sentence on what the dead-reckoning row means for the others."""
    present = {row.method: row.error for row in rows if row.offset == 0}
    filters = {name: error for name, error in present.items() if name != "dead-reckoning"}
    if "dead-reckoning" not in present or not filters:
        return ""
    best = min(filters, key=lambda name: filters[name])
    blind = present["dead-reckoning"]
    ours = f"the best filter at x[t] ({TITLES.get(best, best)}: {filters[best]:.2f})"
    if blind < filters[best]:
        return (
            f"Dead reckoning on the plan (error {blind:.2f}) beats {ours}: the world's motion is "
            "far less noisy than the filters assume, so this table compares how filters bear "
            "with wrong assumptions, not whether localization is needed here."
        )
    return f"Dead reckoning on the plan (error {blind:.2f}) is beaten by {ours}."


def _row(
    method: str, offset: int, records: Sequence[Record], baseline: dict[tuple[int, int], float]
) -> Row:
    scored = {
        _world(record): score
        for record in records
        for score in record["scores"]
        if score["offset"] == offset
    }
    columns = {
        name: np.array(
            [math.nan if score[name] is None else score[name] for score in scored.values()]
        )
        for name in SCORE_NAMES
        if name in Row.__annotations__
    }
    shared = [world for world in scored if world in baseline]
    errors = dict(zip(scored, columns["error"], strict=True))  # NaN where a score is None
    differences = np.array([errors[world] - baseline[world] for world in shared])
    low, high = paired_bootstrap(differences)
    return Row(
        method=method,
        offset=offset,
        **{name: float(values.mean()) for name, values in columns.items()},
        error_sd=sample_sd(columns["error"]),
        diff_vs_mcl=float(differences.mean()) if shared else math.nan,
        diff_low=low,
        diff_high=high,
        trials=len(scored),
    )


def _world(record: Record) -> tuple[int, int]:
    return record["trial"]["trial"], record["trial"]["filter_seed"]


def _percent(share: float) -> str:
    return "n/a" if math.isnan(share) else f"{100 * share:.1f} %"


def _interval(row: Row) -> str:
    if math.isnan(row.diff_vs_mcl):
        return "n/a"
    if math.isnan(row.diff_low):
        return f"{row.diff_vs_mcl:+.2f}"
    return f"{row.diff_vs_mcl:+.2f} [{row.diff_low:+.2f}, {row.diff_high:+.2f}]"
