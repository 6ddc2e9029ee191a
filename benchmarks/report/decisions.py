"""Comparisons that stop when they are decided: in words, and as cells of a table."""

import math
from collections import Counter
from collections.abc import Sequence

from benchmarks.tables.comparison import Comparison
from benchmarks.tables.deciding import RELATIONS, Decision
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import Estimate
from benchmarks.tables.text import counted, estimated, fixed, interval, percent
from benchmarks.trials.scores import Score

WITHIN = "95 % at all looks"  # what an interval of a decision is
BESIDE = {  # by relation: what a method is, and its baseline
    "better": "Better than",
    "worse": "Worse than",
    "equivalent": "Equivalent to",
    "open": "Not decided beside",
}


def standing(found: Decision) -> str:
    """How a comparison stands, and after how many worlds."""
    return f"{found.relation} after {found.worlds}"


def ahead(found: Decision, aim: Score | None, base: str = "") -> str:
    """By how much a method is better than its baseline, with its interval, and since when."""
    own = found.interval.percent
    unit, where = ("%", "below") if aim is None else ("points", "above")
    if aim is None:
        own = Estimate(-own.mean, -own.high, -own.low)
    form = ".0f" if abs(own.mean) >= 10 else ".1f"
    ends = f" ({WITHIN}: {interval(own, form)})" if _bounded(own) else ""
    apart = f"{own.mean:{form}}".replace("-", "−")
    done = "open" if found.relation == "open" else "decided"
    after = f"{done} after {counted({found.worlds}, 'world')}"
    return f"{apart} {unit} {where}{base}{ends}, {after}"


def summary(panels: Sequence[Panel]) -> str:
    """How many comparisons are decided, and after how many worlds; "" if that was not asked."""
    rule = next((panel.rule for panel in panels if panel.rule is not None), None)
    found = [row.decision for panel in panels for row in panel.present if row.decision is not None]
    if rule is None or not found:
        return ""
    counts = Counter(one.relation for one in found)
    kinds = ", ".join(f"{counts[kind]} {kind}" for kind in RELATIONS if counts[kind])
    worlds = sorted(one.worlds for one in found if one.relation != "open")
    half = f"; half of the decisions needed at most {worlds[(len(worlds) - 1) // 2]} worlds"
    said = f"{counted({len(found)}, 'comparison')}: {kinds}{half if worlds else ''}."
    unit = "%" if any(panel.aim is None for panel in panels) else "points"
    return (
        f"{said} Better or worse: by more than {100 * rule.margin:g} {unit}; equivalent: by less."
    )


def header(panel: Panel) -> list[str]:
    """What the columns of ``cells`` are of."""
    own = f"error e, {panel.unit} (SD)" if panel.aim is None else panel.aim.words
    return [f"difference to the baseline, {WITHIN}", "verdict, after worlds", own]


def cells(row: Comparison) -> list[str]:
    """Return the difference of a method to its baseline, how it stands, and its own score."""
    own = f"{fixed(row.error.mean)} ({fixed(row.error_sd)})"
    if row.aim is not None:
        own = percent(row.standing.value.mean)
    found = row.decision
    if found is None:
        return ["baseline", "–", own]
    apart = found.interval.percent
    unit = " %" if row.aim is None else " points"
    shown = apart if _bounded(apart) else Estimate(apart.mean)
    return [estimated(shown, "+.1f", unit), standing(found), own]


def caption(panel: Panel) -> str:
    """What a table with these cells shows."""
    what = "error" if panel.aim is None else "share of runs"
    return (
        f"Difference to the baseline's {what} on the same worlds, the best first and in bold. All "
        f"intervals of the sweep, at all looks, hold together with 95 %. Each method's own {what} "
        "is of the worlds that it needed."
    )


def _bounded(value: Estimate) -> bool:
    return math.isfinite(value.low) and math.isfinite(value.high)
