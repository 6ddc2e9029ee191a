"""The verdict in words: one sentence that a reader has in ten seconds."""

import math
from collections import Counter
from collections.abc import Sequence

from benchmarks.report.words import (
    capital,
    counted,
    estimated,
    interval,
    named,
    p_value,
    significant,
)
from benchmarks.sweeps.results import Results
from benchmarks.tables.comparison import ALPHA, Comparison
from benchmarks.tables.panels import Panel
from benchmarks.tables.power import least_p, least_worlds, worlds_to_see, worth_seeing
from benchmarks.tables.stats import Estimate
from benchmarks.tables.table_1 import full_name, reading
from benchmarks.tables.text import percent
from benchmarks.tables.verdict import BLIND, Verdict, baseline_row, cost, verdict

FEW = 20  # worlds below which an interval is called rough
_MANY = 100_000  # worlds


def conclusion(results: Results) -> str:
    """The verdict on all that was run; of several settings, who is best in how many."""
    if len(results.panels) == 1:
        return spoken(results.panels[0])
    found = [one for panel in results.panels if (one := verdict(panel)) is not None]
    if not found:
        return "No trial is finished."
    best = Counter(full_name(one.best.method.localizer) for one in found if one.best is not None)
    parts = [f"{name} in {count}" for name, count in best.most_common()]
    baseline = full_name(results.baseline)
    if not parts:
        return (
            f"In none of {len(found)} settings is a method confirmed to be better than {baseline}."
        )
    if none := len(found) - best.total():
        parts.append(f"no method is confirmed to be better than {baseline} in {none}")
    return f"Best in {len(found)} settings: {'; '.join(parts)}."


def spoken(panel: Panel) -> str:
    """The verdict on a panel; where the plan alone is best, on its filters, too."""
    found = verdict(panel)
    if found is None:
        return "No trial is finished."
    said = capital(_sentence(panel, found))
    filters = verdict(panel, filters=True)
    if found.best and found.best.method.localizer == BLIND and filters is not None:
        scanning = _sentence(panel, filters).replace("No method", "none", 1)
        said += f" Of the methods that use scans: {scanning}"
    return said


def runner_up(panel: Panel) -> str:
    """How far the next method is behind the winner; "" if there is none, or it is the baseline."""
    found = verdict(panel)
    if found is None or found.following is None or found.following.method == found.winner.baseline:
        return ""
    name, unit = named(found.following, panel), panel.thresholds.unit
    error = f"{significant(found.following.error.mean)} {unit}"
    lead = found.lead
    if math.isnan(lead.low):
        return f"Next is {name}: {error}."
    doubt = ", an interval that includes 0" if lead.low <= 0 <= lead.high else ""
    behind = f"{lead.mean:.2f} {unit} behind (95 %: {interval(lead)})"
    return f"Next is {name}, {error}: {behind}{doubt}."


def power_hint(panel: Panel) -> str:
    """How many worlds a small difference to the baseline would need; "" where nothing is known."""
    rows = [row for row in panel.present if row.diff_sd > 0]
    if not rows:
        return ""
    tests = sum(not math.isnan(row.p) for row in panel.present)
    base = baseline_row(panel, rows[0])
    small = worth_seeing(base.error.mean)
    if math.isnan(small):
        return ""
    needed = ", ".join(
        f"{_round(worlds_to_see(small, row.diff_sd, tests))} for {panel.labels[row.method]}"
        for row in rows
    )
    return (
        f"To see a difference of {small:g} {panel.thresholds.unit} to {named(base, panel)} in "
        f"four of five repetitions, about so many worlds are needed: {needed}."
    )


def _round(worlds: int) -> str:
    """A count with two significant digits, as it is known no better."""
    return f"{int(float(f'{worlds:.2g}')):,}" if worlds <= _MANY else f"more than {_MANY:,}"


def _sentence(panel: Panel, found: Verdict) -> str:
    row, unit = found.winner, panel.thresholds.unit
    name, error = named(row, panel), f"{significant(row.error.mean)} {unit}"
    if found.best is not None:
        aside = ""
        if found.first is not row:
            smaller = f"{significant(found.first.error.mean)} {unit}"
            aside = f" ({named(found.first, panel)} has {smaller}, which is not confirmed)"
        return f"{name} is best: {error}, {_against(panel, row)}{_price(panel, row)}{aside}."
    if row.is_baseline:
        if found.tests == 0:
            return f"{name}: {error}; nothing to compare it with."
        return f"No method is better than the baseline, {name}: {error}."
    base = baseline_row(panel, row)
    theirs = f"{named(base, panel)} ({significant(base.error.mean)} {unit})"
    if math.isnan(row.diff.low):
        return f"{name} has the smallest error, {error}, on too few worlds to compare it."
    return (
        f"No method is confirmed to be better than {theirs}: {name} has the smallest error, "
        f"{error}, {_against(panel, row)}; {_doubt(row, found.tests)}."
    )


def _against(panel: Panel, row: Comparison) -> str:
    """How far a method is from its baseline, and how often it is the better one."""
    base = named(baseline_row(panel, row), panel)
    worlds = f"in {row.wins:g} of {row.paired_worlds} worlds"
    if math.isnan(row.relative.low):
        return worlds
    below = Estimate(-row.relative.mean, -row.relative.high, -row.relative.low).percent
    form = ".0f" if abs(below.mean) >= 10 else ".1f"
    ends = interval(below, form)
    share = f"{below.mean:{form}}".replace("-", "−")
    return f"{share} % below {base} (95 %: {ends}), {worlds}"


def _price(panel: Panel, row: Comparison) -> str:
    ratio = cost(panel, row)
    return "" if math.isnan(ratio) else f"; costs {significant(ratio, 2)} ×"


def _doubt(row: Comparison, tests: int) -> str:
    """Why a smaller error is not confirmed."""
    if least_p(row.paired_worlds, tests) < ALPHA:
        return f"p = {p_value(row.p_holm)}"
    return (
        f"{row.paired_worlds} worlds cannot give p < {ALPHA:g} in "
        f"{tests} {'test' if tests == 1 else 'tests'}, {least_worlds(tests)} can"
    )


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
    name, other = named(row, panel), full_name(row.baseline.localizer)
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
    detected = (
        "no difference, however large, can have p < 0.05"
        if least_p(max(few), corrected) >= ALPHA
        else "only large differences can be detected"
    )
    return (
        f"With only {counted(few, 'world', 'worlds')} bootstrap intervals are somewhat too narrow, "
        f"and {detected}."
    )
