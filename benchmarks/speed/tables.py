"""speed.csv, scaling.csv and the readable tables."""

from collections.abc import Iterable, Sequence

from tabulate import tabulate

from benchmarks.speed.figure import Measured
from benchmarks.speed.scaling import Measurement
from benchmarks.tables.text import csv_text

HOW = (
    "CPU time of one core, medians of turns taken one after the other in one process. "
    "The ratio is ours over the other's, of rates (more is faster) or of µs (less is faster). "
    "The other side of amcl_step is a number from another machine."
)


def speed_csv(rows: Iterable[Measured]) -> str:
    """Return speed.csv; rates per second, or µs per step."""
    numbers = (
        [row.figure.name, *map(_six_digits, (row.ours, row.other, row.ratio))] for row in rows
    )
    return csv_text(["figure", "ours", "other", "ratio"], numbers)


def scaling_csv(measurements: Iterable[Measurement]) -> str:
    """Return scaling.csv, one line per point."""
    points = [
        [curve.task, curve.who, curve.varied, value, _six_digits(result), curve.unit]
        for curve, results in ((m.curve, m.results) for m in measurements)
        for value, result in zip(curve.values, results, strict=True)
    ]
    return csv_text(["task", "who", "varied", "value", "result", "unit"], points)


def speed_table(rows: Sequence[Measured], style: str) -> str:
    """Return the figures as a table; ``style`` is a format of tabulate."""
    lines = [
        [
            row.figure.name,
            row.figure.task,
            f"{row.figure.ours}: {amount(row.ours, row.figure.unit)}",
            f"{row.figure.other}: {amount(row.other, row.figure.unit)}",
            ratio(row.ratio),
            row.figure.aim,
            {True: "yes", False: "MISSED", None: ""}[row.reached],
        ]
        for row in rows
    ]
    header = ["figure", "what", "ours", "other", "ratio", "target", "reached"]
    right = ("left", "left", "left", "left", "right", "right", "left")
    return tabulate(lines, header, tablefmt=style, disable_numparse=True, colalign=right)


def terminal_table(rows: Sequence[Measured]) -> str:
    """Return the figures as a narrow table for a terminal."""
    lines = [
        [
            row.figure.name,
            amount(row.ours, row.figure.unit),
            amount(row.other, row.figure.unit),
            ratio(row.ratio),
            row.figure.aim,
            "MISSED" if row.reached is False else "",
        ]
        for row in rows
    ]
    right = ("left", "right", "right", "right", "right", "left")
    header = ["figure", "ours", "other", "ratio", "target", ""]
    return tabulate(lines, header, tablefmt="simple", disable_numparse=True, colalign=right)


def scaling_tables(measurements: Sequence[Measurement]) -> str:
    """Return one Markdown table per task, a column per who."""
    tables = []
    for task in dict.fromkeys(m.curve.task for m in measurements):
        same = [m for m in measurements if m.curve.task == task]
        curve = same[0].curve
        columns = [[amount(result, curve.unit) for result in m.results] for m in same]
        lines = zip([f"{value:,}" for value in curve.values], *columns, strict=True)
        header = [curve.varied, *(m.curve.who for m in same)]
        body = tabulate(
            list(lines), header, tablefmt="github", disable_numparse=True, stralign="right"
        )
        tables.append(f"### {task}\n\n{body}")
    return "\n\n".join(tables)


def amount(value: float, unit: str) -> str:
    """Three digits and the unit: 203 M rays/s."""
    for size, prefix in ((1e6, "M "), (1e4, "k ")):
        if value >= size and not unit.startswith("µs"):
            scaled = value / (1e3 if prefix == "k " else size)
            return f"{_three_digits(scaled)} {prefix}{unit}"
    return f"{_three_digits(value)} {unit}"


def ratio(value: float) -> str:
    """Three digits."""
    return _three_digits(value)


def _three_digits(value: float) -> str:
    digits = 0 if value >= 100 else 1 if value >= 10 else 2
    return f"{value:,.{digits}f}"


def _six_digits(value: float) -> str:
    return f"{value:.6g}"
