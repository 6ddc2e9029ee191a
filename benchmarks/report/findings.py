"""How each method of a panel compares with its baseline, in a sentence each."""

import math
from collections.abc import Sequence

from benchmarks.report.verdicts import done
from benchmarks.report.words import capital, counted, estimated, interval, named, p_value
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.panels import Panel
from benchmarks.tables.power import least_p
from benchmarks.tables.stats import ALPHA, Estimate
from benchmarks.tables.table_1 import full_name, reading
from benchmarks.tables.text import percent
from benchmarks.tables.verdict import aim_of, standing
from benchmarks.trials.journeys import Score

FEW = 20  # worlds below which an interval is called rough


def findings(panel: Panel) -> list[str]:
    """A sentence per method on how it compares with its baseline, and what to mind."""
    compared = [row for row in panel.present if not row.is_baseline]
    sentences = [capital(_finding(row, panel)) for row in compared]
    if warning := _few(panel.present):
        sentences.append(warning)
    if said := reading(panel.rows):
        sentences.append(said)
    return sentences


def _finding(row: Comparison, panel: Panel) -> str:
    name, other, aim = named(row, panel), full_name(row.baseline.localizer), aim_of(panel)
    own = standing(row, aim)
    diff = own.diff if aim is None else own.diff.percent
    if math.isnan(diff.mean):
        unknown, none = "share a world whose error is unknown", "have no finished world in common"
        why = unknown if row.paired_worlds else none
        return f"{name} and {other} {why}, so they are not compared."
    if math.isnan(diff.low):
        found = f"{_apart(diff, aim)} against {other}"
        return f"{name}: {found}, but one world is too few to compare them."
    if diff == (0, 0, 0):
        if aim is None:
            return f"{name} has exactly the error of {other} at x[t] in every world."
        return f"{name} {done(aim)} exactly as often as {other} in every world."
    wins = f"; smaller in {percent(row.win_rate)} of {row.paired_worlds} worlds"
    numbers = (
        f"({_apart(Estimate(diff.mean), aim)}, 95 % interval {interval(diff, _form(aim))}"
        f"{wins if aim is None else ''}; p = {p_value(own.p_holm)})"
    ).replace("p = <", "p <")
    if diff.low <= 0 <= diff.high:
        return f"{name} is statistically indistinguishable from {other} {numbers}."
    if aim is None:
        size, mean = "smaller" if diff.mean < 0 else "larger", "" if own.significant else "mean "
        said, test = f"has a {size} {mean}error than {other}", "signed-rank"
    else:
        often = "more often" if diff.mean > 0 else "less often"
        said, test = f"{done(aim)} {often} than {other}", "sign"
    doubt = "" if own.significant else f", but the {test} test does not confirm it"
    return f"{name} {said}{doubt} {numbers}."


def _apart(diff: Estimate, aim: Score | None) -> str:
    return estimated(diff, f"+{_form(aim)}", "" if aim is None else " points")


def _form(aim: Score | None) -> str:
    return ".2f" if aim is None else ".0f"


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
