"""results.csv and trials.csv of a replay, and the same as readable tables."""

import math
from collections.abc import Sequence

import numpy as np
from tabulate import tabulate

from benchmarks.replay.scoring import Row
from benchmarks.report.tables import Table
from benchmarks.tables.text import csv_text, percent

_RESULTS = (
    "position_median", "position_p95", "heading_median", "success_1m", "success_1m_low",
    "success_1m_high", "success_05m", "metres_to_localize", "lost", "ape_rmse", "rpe_rmse",
    "agreement_01", "agreement_03", "ms_per_step",
)  # fmt: skip
_TRIALS = tuple(name for name in _RESULTS if not name.endswith(("_low", "_high")))
_NONE = "n/a"


def results_csv(rows: Sequence[Row]) -> str:
    """Return results.csv: a line per localizer."""
    lines = (
        [row.localizer, row.seeds, row.failed, *(row.scores.get(name) for name in _RESULTS)]
        for row in rows
    )
    return csv_text(["localizer", "seeds", "failed", *_RESULTS], lines)


def trials_csv(rows: Sequence[Row]) -> str:
    """Return trials.csv: a line per run that came to its end."""
    lines = (
        [one.run.localizer, one.run.seed, *(one.scores[name] for name in _TRIALS)]
        for row in rows
        for one in row.played
    )
    return csv_text(["localizer", "seed", *_TRIALS], lines)


def results_table(rows: Sequence[Row], referenced: bool) -> Table:
    """Return the numbers of each localizer as a readable table."""
    if not referenced:
        header = ["localizer", "runs", "beams within 0.1 m", "within 0.3 m", "ms per step"]
        lines = [
            [row.localizer, str(row.seeds), *_words(row, "agreement_01 agreement_03 ms_per_step")]
            for row in rows
        ]
        caption = "How well the scans fit the map at the pose that each localizer estimates."
        return Table(caption, header, lines)
    header = ["localizer", "runs", "position, median", "95 %", "heading, median"]
    header += ["success (1 m, 30°)", "(0.5 m, 10°)", "metres to localize", "lost"]
    header += ["beams within 0.3 m", "ms per step"]
    names = "position_median position_p95 heading_median success_1m success_05m"
    names += " metres_to_localize lost agreement_03 ms_per_step"
    return Table(
        "Errors of the best cluster over all records of all runs, against the reference.",
        header,
        [[row.localizer, str(row.seeds), *_words(row, names)] for row in rows],
    )


def evo_table(rows: Sequence[Row]) -> Table:
    """Return APE and RPE of each localizer's median run, as evo computes them."""
    lines = []
    for row in rows:
        middle = row.middle
        for name, errors in (("APE", middle.errors), ("RPE", middle.relative)):
            if errors is not None:
                moved, turned = errors.translation, errors.rotation
                numbers = [errors.rmse, moved.mean(), float(np.median(moved))]
                lines.append(
                    [f"{row.localizer} {name}", str(middle.run.seed)]
                    + [f"{value:.3f} m" for value in (*numbers, moved.max())]
                    + [f"{math.degrees(turned.mean()):.2f}°"]
                )
    header = ["median run", "seed", "rmse", "mean", "median", "max", "rotation, mean"]
    return Table(
        "APE without alignment, RPE from record to record, as evo_ape tum and evo_rpe tum compute "
        "them from the trajectories in tracks/.",
        header,
        lines,
    )


def plain(table: Table) -> str:
    """Return a table as text for a terminal."""
    align = ("left", *["right"] * (len(table.header) - 1))
    return tabulate(
        table.lines, table.header, tablefmt="simple", disable_numparse=True, colalign=align
    )


def _words(row: Row, names: str) -> list[str]:
    scores, counted = row.scores, {"lost": len(row.played)}  # of a failed run it is not known
    return [
        _word(name, scores.get(name, math.nan), counted.get(name, row.seeds))
        for name in names.split()
    ]


def _word(name: str, value: float, runs: int) -> str:
    if math.isnan(value):
        return _NONE
    if name.startswith(("success", "lost")):
        return f"{round(value * runs)} of {runs}"
    if name == "metres_to_localize":
        return f"{value:.1f} m" if math.isfinite(value) else "never"
    if name.startswith("heading"):
        return f"{math.degrees(value):.2f}°"
    if name.startswith("agreement"):
        return percent(value)
    return f"{value:.2f}" if name.startswith("ms") else f"{value:.3f} m"
