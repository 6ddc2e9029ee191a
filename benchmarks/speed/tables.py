"""speed.csv, scaling.csv and the readable tables."""

import math
from collections.abc import Iterable, Sequence
from itertools import groupby

from tabulate import tabulate

from benchmarks.speed.figure import Figure, Measured, is_time
from benchmarks.speed.scaling import Scaling
from benchmarks.tables.text import csv_text

HOW = (
    "CPU time of one core (of trials: wall time), medians of turns taken one after the other in "
    "one process. The ratio is ours over the other's, of rates (more is faster) or of times (less "
    "is faster). A row without a ratio compares with a figure from another machine."
)


def speed_csv(rows: Iterable[Measured]) -> str:
    """Return speed.csv; rates per second, or times in their unit."""
    lines = ([row.figure.name, *map(_cell, (row.ours, row.other, row.ratio))] for row in rows)
    return csv_text(["figure", "ours", "other", "ratio"], lines)


def scaling_csv(curves: Iterable[Scaling]) -> str:
    """Return scaling.csv, one line per point."""
    points = (
        [curve.what, curve.who, curve.varied, value, _cell(result), curve.unit]
        for curve, results in curves
        for value, result in zip(curve.values, results, strict=True)
    )
    return csv_text(["task", "who", "varied", "value", "result", "unit"], points)


def speed_table(rows: Iterable[Measured], style: str) -> str:
    """Return the figures as a table; ``style`` is a format of tabulate."""
    lines = [
        [
            row.figure.name,
            amount(row.ours, row.figure.unit),
            amount(row.other, row.figure.unit),
            "" if math.isnan(row.ratio) else _three_digits(row.ratio),
            _aim(row.figure),
            row.verdict,
        ]
        for row in rows
    ]
    header = ["figure", "ours", "other", "ratio", "target", "reached"]
    align = ("left", "right", "right", "right", "right", "left")
    return tabulate(lines, header, tablefmt=style, disable_numparse=True, colalign=align)


def sides_table(figures: Iterable[Figure]) -> str:
    """Return what is compared as a Markdown table."""
    lines = [[figure.name, figure.what, figure.ours.who, figure.other.who] for figure in figures]
    return tabulate(lines, ["figure", "what", "ours", "other"], tablefmt="github")


def scaling_tables(curves: Sequence[Scaling]) -> str:
    """Return one Markdown table per task, a column per who."""
    tables = []
    for what, same in by_task(curves):
        curve, _ = same[0]
        columns = [[amount(result, curve.unit) for result in results] for _, results in same]
        lines = list(zip([f"{value:,}" for value in curve.values], *columns, strict=True))
        header = [curve.varied, *(curve.who for curve, _ in same)]
        body = tabulate(lines, header, "github", disable_numparse=True, stralign="right")
        tables.append(f"### {what}\n\n{body}")
    return "\n\n".join(tables)


def by_task(curves: Iterable[Scaling]) -> list[tuple[str, list[Scaling]]]:
    """Return the curves of each task, which follow each other."""
    return [(what, list(same)) for what, same in groupby(curves, lambda seen: seen[0].what)]


def amount(value: float, unit: str) -> str:
    """Three digits and the unit: 203 M rays/s."""
    if value >= 1e4 and not is_time(unit):
        size, prefix = (1e6, "M") if value >= 1e6 else (1e3, "k")
        return f"{_three_digits(value / size)} {prefix} {unit}"
    return f"{_three_digits(value)} {unit}"


def _aim(figure: Figure) -> str:
    if figure.target is None:
        return ""
    return f"{'≤' if is_time(figure.unit) else '≥'} {figure.target:,g}"


def _three_digits(value: float) -> str:
    digits = 0 if value >= 100 else 1 if value >= 10 else 2
    return f"{value:,.{digits}f}"


def _cell(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6g}"
