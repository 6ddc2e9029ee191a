"""How the methods of a panel compare with their baseline: a sentence per outcome."""

import math
from collections.abc import Sequence

from benchmarks.report.verdicts import done
from benchmarks.report.words import capital, counted, named
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.panels import Panel
from benchmarks.tables.power import least_p
from benchmarks.tables.stats import ALPHA
from benchmarks.tables.table_1 import reading
from benchmarks.tables.text import full_name

FEW = 20  # worlds below which an interval is called rough


def findings(panel: Panel) -> list[str]:
    """Which methods are better or worse than their baseline, or neither, and what to mind."""
    outcomes: dict[str, list[str]] = {}
    for row in panel.ranked:
        if not row.is_baseline:
            outcomes.setdefault(_outcome(row), []).append(named(row, panel))
    sentences = [f"{outcome}: {', '.join(names)}." for outcome, names in outcomes.items()]
    if warning := _few(panel.present):
        sentences.append(warning)
    if said := reading(panel.rows):
        sentences.append(said)
    return sentences


def _outcome(row: Comparison) -> str:
    """What is known of a method beside its baseline."""
    other, own, aim = full_name(row.baseline.name), row.standing, row.aim
    diff = own.diff
    if math.isnan(diff.mean):
        unknown, none = "a shared world's error is unknown", "no finished world in common"
        return f"Not compared with {other} ({unknown if row.paired_worlds else none})"
    if math.isnan(diff.low):
        return f"Not compared with {other} (one world is too few)"
    if diff == (0, 0, 0):
        if aim is None:
            return f"Exactly the error of {other} at x[t] in every world"
        return f"{capital(done(aim))} exactly as often as {other}"
    if diff.low <= 0 <= diff.high:
        return f"Statistically indistinguishable from {other}"
    if aim is None:
        said, test = f"{'Smaller' if diff.mean < 0 else 'Larger'} error than {other}", "signed-rank"
    else:
        often = "more" if diff.mean > 0 else "less"
        said, test = f"{capital(done(aim))} {often} often than {other}", "sign"
    return said if own.significant else f"{said}, but not confirmed by the {test} test"


def _few(rows: Sequence[Comparison]) -> str:
    """What to mind where there are few worlds; nothing where there are enough, or one."""
    tested = [row.paired_worlds for row in rows if not math.isnan(row.p)]
    worlds = set(tested or [row.worlds for row in rows])
    few = {count for count in worlds if 2 <= count < FEW}
    if not few:
        return ""
    corrected = len(tested) if max(worlds) < FEW else 1  # of the smallest p, or maybe the largest
    detected = (
        "no difference, however large, can have p < 0.05"
        if least_p(max(few), corrected) >= ALPHA
        else "only large differences can be detected"
    )
    return (
        f"With only {counted(few, 'world', 'worlds')} bootstrap intervals are somewhat too narrow, "
        f"and {detected}."
    )
