"""results.csv and trials.csv of a replay, and the same as readable tables."""

import math
from collections.abc import Sequence

import numpy as np
from tabulate import tabulate

from benchmarks.replay.scoring import Row
from benchmarks.report.tables import Table
from benchmarks.tables.text import csv_text, percent
from benchmarks.trials.metrics import LEVELS

_RESULTS = (
    "position_median", "position_p95", "heading_median", "position_median_stamps",
    "heading_median_stamps", "success_1m", "success_1m_low", "success_1m_high", "success_05m",
    "within_1m", "within_05m", "metres_to_localize", "lost", "coverage_50", "coverage_80",
    "coverage_95", "nees", "ape_rmse", "rpe_rmse", "agreement_01", "agreement_03", "ms_per_step",
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
    header = ["localizer", "runs", "within 1 m, 30°", "0.5 m, 10°", "localized to the end", "lost"]
    header += ["position, median", "95 %", "heading, median", "metres to localize", "ms per step"]
    names = "within_1m within_05m success_1m lost position_median position_p95 heading_median"
    names += " metres_to_localize ms_per_step"
    return Table(
        "Best cluster against the reference: share of records within a distance and an angle, runs "
        "localized to the end, errors over all records of all runs.",
        header,
        [[row.localizer, str(row.seeds), *_words(row, names)] for row in rows],
    )


def belief_table(rows: Sequence[Row]) -> Table:
    """What the beliefs of each localizer are worth, and how well its scans fit the map."""
    header = ["localizer", *(f"inside {level} %" for level in LEVELS), "NEES (3)"]
    names = [f"coverage_{level}" for level in LEVELS] + ["nees", "agreement_01", "agreement_03"]
    header += ["beams within 0.1 m", "0.3 m"]
    between = any(one.at_stamps.size < one.known.size for row in rows for one in row.played)
    if between:
        header += ["position, median, at stamps", "heading"]
        names += ["position_median_stamps", "heading_median_stamps"]
    return Table(
        "Share of records whose reference lies in the credible region of so many per cent, and "
        "normalized estimation error squared, 3 if the belief is as sure as it may be; n/a: it has "
        "no spread." + (" At stamps: at the reference's own times." if between else ""),
        header,
        [[row.localizer, *_words(row, " ".join(names))] for row in rows],
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
    if name == "metres_to_localize":
        return f"{value:.1f} m" if math.isfinite(value) else "never"
    return _known_word(name, value, runs)


def _known_word(name: str, value: float, runs: int) -> str:
    if name.startswith(("success", "lost")):
        return f"{round(value * runs)} of {runs}"
    if name.startswith("heading"):
        return f"{math.degrees(value):.2f}°"
    if name.startswith(("agreement", "within", "coverage")):
        return percent(value)
    if name == "nees":
        value = value if value < 100 else float(f"{value:.3g}")
        return f"{value:,.{1 if value < 100 else 0}f}"
    return f"{value:.2f}" if name.startswith("ms") else f"{value:.3f} m"
