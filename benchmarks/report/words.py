"""Numbers and findings in words."""

import math
from collections.abc import Sequence

from benchmarks.sweeps.results import Results
from benchmarks.tables.comparison import ALPHA, Comparison
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import Estimate
from benchmarks.tables.table_1 import full_name, reading
from benchmarks.tables.text import percent

FEW = 20  # worlds below which an interval is called rough


def estimated(value: Estimate, form: str = ".2f", unit: str = "") -> str:
    """A mean and its interval, with a true minus; or n/a.

    Args:
        value: the mean, and its interval if it has one.
        form: of the mean, "+.2f" if its sign is to be seen; the ends have its digits.
        unit: behind the mean.
    """
    if math.isnan(value.mean):
        return "n/a"
    ends = "" if math.isnan(value.low) else f" ({interval(value, form.removeprefix('+'))})"
    return f"{value.mean:{form}}{unit}".replace("-", "−") + ends


def interval(value: Estimate, form: str = ".2f") -> str:
    """The ends of an interval."""
    return f"{value.low:{form}} to {value.high:{form}}".replace("-", "−")


def p_value(p: float) -> str:
    """A p-value with two digits."""
    if math.isnan(p):
        return "n/a"
    return "< 0.0001" if p < 1e-4 else f"{p:.2g}"


def findings(panel: Panel) -> list[str]:
    """A sentence per method on how it compares with its baseline, and what to mind."""
    compared = [row for row in panel.present if not row.is_baseline]
    sentences = [_capital(_finding(row, panel)) for row in compared]
    if warning := _few(panel.present):
        sentences.append(warning)
    if said := reading(panel.rows):
        sentences.append(said)
    return sentences


def overview(results: Results, panels: Sequence[Panel]) -> str:
    """What was run, in one paragraph."""
    methods = dict.fromkeys(row.method.localizer for panel in panels for row in panel.rows)
    named = ", ".join(full_name(name) for name in methods) or "none"
    worlds = {row.worlds for panel in panels for row in panel.rows}
    seeds = {record["trial"]["filter_seed"] for record in results.records}
    several = f", each with {len(seeds)} filter seeds" if len(seeds) > 1 else ""
    count = _range(worlds, "world", "worlds")
    settings = _range({len(panels)}, "setting", "settings")
    return (
        f"{_range({len(methods)}, 'localizer', 'localizers')} ({named}) on {settings}, "
        f"{count} per setting{several}. On the same world all methods see the same true path and "
        "the same scans, and filters start from the same cloud: differences are taken world by "
        f"world, with {full_name(results.baseline)} as the baseline."
    )


def progress(results: Results) -> str:
    """How far the sweep has come."""
    done = results.planned - len(results.failures) - results.missing
    words = f"{done} of {results.planned} trials finished"
    if results.failures:
        words += f", {len(results.failures)} failed"
    if results.missing:
        words += f", {results.missing} not run yet: this report is partial"
    return words + "."


def _finding(row: Comparison, panel: Panel) -> str:
    name, other = full_name(row.method.localizer), full_name(row.baseline.localizer)
    if row.method.localizer != panel.labels[row.method]:
        name = f"{name} ({panel.labels[row.method]})"
    diff = row.diff
    if math.isnan(diff.mean):
        unknown, none = "share a world whose error is unknown", "have no finished world in common"
        why = unknown if row.paired_worlds else none
        return f"{name} and {other} {why}, so they are not compared."
    if math.isnan(diff.low):
        found = f"{estimated(diff, '+.2f')} against {other}"
        return f"{name}: {found}, but one world is too few to compare them."
    if diff == (0, 0, 0):
        return f"{name} has exactly the error of {other} at x[t] in every world."
    numbers = (
        f"({estimated(Estimate(diff.mean), '+.2f')}, 95 % interval {interval(diff)}; smaller in "
        f"{percent(row.win_rate)} of {row.paired_worlds} worlds; p = {p_value(row.p_holm)})"
    ).replace("p = <", "p <")
    if diff.low <= 0 <= diff.high:
        return f"{name} is statistically indistinguishable from {other} {numbers}."
    better = "smaller" if diff.mean < 0 else "larger"
    if not row.significant:
        return (
            f"{name} has a {better} mean error than {other}, but the signed-rank test does not "
            f"confirm it {numbers}."
        )
    return f"{name} has a {better} error than {other} {numbers}."


def _few(rows: Sequence[Comparison]) -> str:
    """What to mind where there are few worlds; nothing where there are enough, or one."""
    tested = [row.paired_worlds for row in rows if not math.isnan(row.p)]
    worlds = set(tested or [row.worlds for row in rows])
    few = {count for count in worlds if 2 <= count < FEW}
    if not few:
        return ""
    corrected = len(tested) if max(worlds) < FEW else 1  # of the smallest p, or maybe the largest
    least_p = corrected * 2.0 ** (1 - max(few))  # all differences on one side
    detected = (
        "no difference, however large, can have p < 0.05"
        if least_p >= ALPHA
        else "only large differences can be detected"
    )
    return (
        f"With only {_range(few, 'world', 'worlds')} bootstrap intervals are somewhat too narrow, "
        f"and {detected}."
    )


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def _range(counts: set[int], one: str, many: str) -> str:
    if not counts:
        return f"no {many}"
    low, high = min(counts), max(counts)
    if low == high:
        return f"{low} {one if low == 1 else many}"
    return f"{low} to {high} {many}"
