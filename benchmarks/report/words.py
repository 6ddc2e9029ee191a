"""Numbers, names and counts in words."""

import math
from collections.abc import Sequence

from benchmarks.sweeps.results import Results
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import Estimate
from benchmarks.tables.text import full_name


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


def significant(value: float, digits: int = 3) -> str:
    """A number with this many significant digits, without an exponent."""
    if math.isnan(value):
        return "n/a"
    places = digits - 1 - math.floor(math.log10(abs(value))) if value else 0
    return f"{round(value, places):.{max(places, 0)}f}".replace("-", "−")


def capital(sentence: str) -> str:
    """The sentence with a capital letter."""
    return sentence[:1].upper() + sentence[1:]


def named(row: Comparison, panel: Panel) -> str:
    """The method's name in words, with the parameters that tell it from others of the name."""
    localizer, label = row.method.name, panel.labels[row.method]
    name = full_name(localizer)
    variant = label.removeprefix(localizer).removeprefix(name).strip()
    return f"{name} ({variant})" if variant else name


def p_value(p: float) -> str:
    """A p-value with two digits."""
    if math.isnan(p):
        return "n/a"
    return "< 0.0001" if p < 1e-4 else f"{p:.2g}"


def overview(results: Results, panels: Sequence[Panel]) -> str:
    """What was run, in one paragraph."""
    methods = dict.fromkeys(row.method.name for panel in panels for row in panel.rows)
    named = ", ".join(full_name(name) for name in methods) or "none"
    worlds = {row.worlds for panel in panels for row in panel.rows}
    seeds = {record.trial.filter_seed for record in results.records}
    several = f", each with {len(seeds)} filter seeds" if len(seeds) > 1 else ""
    count = counted(worlds, "world", "worlds")
    settings = counted({len(panels)}, "setting", "settings")
    return (
        f"{counted({len(methods)}, 'localizer', 'localizers')} ({named}) on {settings}, "
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


def counted(counts: set[int], one: str, many: str) -> str:
    """From the least to the largest count of a thing."""
    if not counts:
        return f"no {many}"
    low, high = min(counts), max(counts)
    if low == high:
        return f"{low} {one if low == 1 else many}"
    return f"{low} to {high} {many}"
