"""The verdict in words: one sentence that a reader has in ten seconds."""

import math
from collections import Counter

from benchmarks.report.words import (
    capital,
    interval,
    named,
    p_value,
    significant,
)
from benchmarks.sweeps.results import Results
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.panels import Panel
from benchmarks.tables.power import least_p, least_worlds, worlds_to_see, worth_seeing
from benchmarks.tables.stats import ALPHA, Estimate
from benchmarks.tables.table_1 import full_name
from benchmarks.tables.text import percent
from benchmarks.tables.verdict import (
    BLIND,
    Verdict,
    aim_of,
    baseline_row,
    cost,
    standing,
    tests_in,
    verdict,
)
from benchmarks.trials.journeys import Score

_MANY = 100_000  # worlds


def conclusion(results: Results) -> str:
    """The verdict on all that was run; of several settings, who is best in how many."""
    if len(results.panels) == 1:
        return spoken(results.panels[0])
    found = [(panel, one) for panel in results.panels if (one := verdict(panel)) is not None]
    if not found:
        return "No trial is finished."
    best = Counter(named(one.best, panel) for panel, one in found if one.best is not None)
    none, baseline = len(found) - best.total(), full_name(results.baseline)
    if not best:
        return f"In none of {none} settings is a method confirmed to be better than {baseline}."
    (leader, most), *others = best.most_common()
    said = ", ".join([f"{leader} is best in {most}", *(f"{one} in {n}" for one, n in others)])
    rest = f"; in {none} no method is confirmed to be better than {baseline}" if none else ""
    return f"Of {len(found)} settings, {said}{rest}."


def spoken(panel: Panel) -> str:
    """The verdict on a panel; where the plan alone is best, on its filters, too."""
    found = verdict(panel)
    if found is None:
        return "No error is known." if panel.records else "No trial is finished."
    said = capital(_sentence(panel, found))
    filters = verdict(panel, filters=True)
    if found.best and found.best.method.localizer == BLIND and filters is not None:
        scanning = _sentence(panel, filters).replace("No method", "none", 1)
        said += f" Of the methods that use scans, {scanning}"
    return said


def runner_up(panel: Panel) -> str:
    """How far the next method is behind the winner; "" if there is none, or it is the baseline."""
    found = verdict(panel)
    if found is None or found.following is None or found.following.method == found.winner.baseline:
        return ""
    name, reached = named(found.following, panel), _brief(panel, found.following, found.aim)
    lead, form, unit = found.lead, ".2f", panel.thresholds.unit
    if math.isnan(lead.low) or lead == (0, 0, 0):
        return f"Next is {name}: {reached}."
    if found.aim is not None:
        lead, form, unit = lead.percent, ".0f", "points"
    doubt = ", an interval that includes 0" if lead.low <= 0 <= lead.high else ""
    behind = f"{lead.mean:{form}} {unit} behind (95 %: {interval(lead, form)})"
    return f"Next is {name}, {reached}: {behind}{doubt}."


def power_hint(panel: Panel) -> str:
    """How many worlds a small difference of errors would need; "" where nothing is known of it."""
    rows = [row for row in panel.present if row.diff_sd > 0]
    if not rows or aim_of(panel) is not None:
        return ""
    tests = tests_in(panel)
    base = baseline_row(panel, rows[0])
    small = worth_seeing(base.error.mean)
    if math.isnan(small):
        return ""
    needed = ", ".join(
        f"{rounded(worlds_to_see(small, row.diff_sd, tests))} for {panel.labels[row.method]}"
        for row in rows
    )
    return (
        f"Worlds needed to detect a difference of {small:g} {panel.thresholds.unit} to "
        f"{named(base, panel)} with 80 % power: about {needed}."
    )


def rounded(worlds: int) -> str:
    """A count of worlds or runs with two significant digits, as it is known no better."""
    return f"{int(float(f'{worlds:.2g}')):,}" if worlds <= _MANY else f"more than {_MANY:,}"


def _sentence(panel: Panel, found: Verdict) -> str:
    row, aim = found.winner, found.aim
    name, reached = named(row, panel), _reached(panel, row, aim)
    if found.best is not None:
        aside = ""
        if found.first is not row:
            more = _brief(panel, found.first, aim)
            aside = f" ({named(found.first, panel)} has {more}, which is not confirmed)"
        apart = _against(row, aim, f" {named(baseline_row(panel, row), panel)}")
        return f"{name} is best: {reached}, {apart}{_price(panel, row)}{aside}."
    if row.is_baseline:
        if found.tests == 0:
            return f"{name}: {reached}; nothing to compare it with."
        return f"No method is better than the baseline, {name}: {reached}."
    base, own = baseline_row(panel, row), standing(row, aim)
    ahead = f"{'smallest error' if aim is None else 'largest share'}: {name}, {reached}"
    if math.isnan(own.diff.low):
        return f"{ahead}, on too few worlds to compare it."
    return (
        f"No method is confirmed to be better than {named(base, panel)} "
        f"({_brief(panel, base, aim)}). {capital(ahead)}, {_against(row, aim)}; "
        f"{_doubt(row.paired_worlds, own.p_holm, found.tests)}."
    )


def _brief(panel: Panel, row: Comparison, aim: Score | None) -> str:
    """The error, or the share of runs that succeed."""
    mean = standing(row, aim).value.mean
    if aim is None:
        return f"{significant(mean)} {panel.thresholds.unit}"
    return f"{percent(mean)} of runs"


def _reached(panel: Panel, row: Comparison, aim: Score | None) -> str:
    """The error, or what share of runs does what they are about, with its interval."""
    brief = _brief(panel, row, aim)
    if aim is None:
        return brief
    ends = interval(standing(row, aim).value.percent, ".0f")
    return f"{done(aim)} in {brief} (95 %: {ends})"


def done(aim: Score) -> str:
    """What a run that succeeds is, without how that is measured."""
    return aim.words.partition(" (")[0]


def _against(row: Comparison, aim: Score | None, base: str = "") -> str:
    """How far a method is from its baseline, and how often its error is the smaller one."""
    if aim is not None:
        points = standing(row, aim).diff.percent
        return f"{points.mean:.0f} points above{base} (95 %: {interval(points, '.0f')})"
    worlds = f"smaller in {row.wins:g} of {row.paired_worlds} worlds"
    if math.isnan(row.relative.low):
        return worlds
    below = Estimate(-row.relative.mean, -row.relative.high, -row.relative.low).percent
    form = ".0f" if abs(below.mean) >= 10 else ".1f"
    ends = interval(below, form)
    share = f"{below.mean:{form}}".replace("-", "−")
    return f"{share} % below{base} (95 %: {ends}), {worlds}"


def _price(panel: Panel, row: Comparison) -> str:
    ratio = cost(panel, row)
    return "" if math.isnan(ratio) else f"; costs {significant(ratio, 2)} × the time"


def _doubt(worlds: int, p_holm: float, tests: int) -> str:
    """Why what is better is not confirmed."""
    if least_p(worlds, tests) < ALPHA:
        return f"p = {p_value(p_holm)}"
    return (
        f"{worlds} worlds cannot give p < {ALPHA:g} in "
        f"{tests} {'test' if tests == 1 else 'tests'}, {least_worlds(tests)} can"
    )
