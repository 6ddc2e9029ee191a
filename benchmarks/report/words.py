"""Numbers, verdicts and findings in words."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from benchmarks.report.decisions import BESIDE, ahead
from benchmarks.setup.names import plug_ins_of_agent
from benchmarks.sweeps.results import Results
from benchmarks.tables import stats
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import ALPHA, Estimate
from benchmarks.tables.table_1 import reading
from benchmarks.tables.text import (
    WORDS,
    capital,
    counted,
    interval,
    p_value,
    percent,
    short_name,
    short_names,
    significant,
)
from benchmarks.tables.verdict import BLIND, Verdict
from benchmarks.trials.scores import Score


class Said(NamedTuple):
    """A verdict: who is best in a few words, with which numbers, and further sentences."""

    short: str
    numbers: str = ""
    more: str = ""

    @property
    def text(self) -> str:
        """All of it."""
        first = f"{self.short}: {self.numbers}." if self.numbers else f"{self.short}."
        return f"{first} {self.more}".rstrip()

    @property
    def rest(self) -> str:
        """What stands below the first words."""
        return f"{capital(self.numbers)}{'.' * bool(self.numbers)} {self.more}".strip()


def overview(results: Results, panels: Sequence[Panel]) -> str:
    """What was run, in one paragraph."""
    methods = dict.fromkeys(row.method.name for panel in panels for row in panel.rows)
    listed = ", ".join(
        f"{name} ({WORDS[name]})" if name in WORDS else short_name(name) for name in methods
    )
    worlds = {row.worlds for panel in panels for row in panel.rows}
    seeds = {record.trial.filter_seed for record in results.records}
    several = f", each with {len(seeds)} filter seeds" if len(seeds) > 1 else ""
    settings = counted({len(panels)}, "setting")
    what = counted({len(methods)}, "localizer")
    agents = dict.fromkeys(agent for panel in panels for agent in panel.agents if agent)
    if len(agents) > 1:
        names = short_names({agent.name for agent in agents})
        driving = ", ".join(dict.fromkeys(names[agent.name] for agent in agents))
        what = f"{counted({len(names)}, 'agent')} ({driving}) with {what}"
    said = f"{what} on {settings}, {counted(worlds, 'world')} per setting{several}: "
    said += f"{listed or 'none'}. "
    if all(row.is_baseline for panel in panels for row in panel.present):
        return f"{said}There is nothing to compare."
    start = (
        "On the same world all agents start from the same place with the same sensor noise, and "
        "filters from the same cloud"
        if len(agents) > 1
        else "On the same world all methods see the same true path and the same scans, and filters "
        "start from the same cloud"
    )
    return (
        f"{said}{start}: differences are taken world by world, with {baseline_name(results)} as "
        "the baseline."
    )


def baseline_name(results: Results) -> str:
    """What the methods are compared with, in a word."""
    found = {
        panel.called(row.baseline)
        for panel in results.panels
        for row in panel.present
        if not row.is_baseline
    }
    return found.pop() if len(found) == 1 else short_name(results.baseline)


def progress(results: Results) -> str:
    """How far the sweep has come."""
    done = results.planned - len(results.failures) - results.missing
    words = f"{done} of {results.planned} trials finished"
    if results.failures:
        words += f", {len(results.failures)} failed"
    if results.missing:
        words += f", {results.missing} not run yet: this report is partial"
    return words + "."


_MANY = 100_000  # worlds
_COVERAGE_APART = 0.1  # difference of shares inside a region that is told


def conclusion(results: Results) -> Said:
    """The verdict on all that was run; of several settings, who is best in how many."""
    if len(results.panels) == 1:
        return spoken(results.panels[0])
    found = [(panel, one) for panel in results.panels if (one := panel.verdict) is not None]
    if not found:
        return Said("No trial is finished")
    settings, baseline = counted({len(found)}, "setting"), baseline_name(results)
    if all(row.is_baseline for panel, _ in found for row in panel.present):
        ends = sorted(found, key=lambda one: one[1].first.worse)
        told = (
            f"{_brief(panel, one.first)} in {where(panel)}"
            for panel, one in ends[:: max(len(ends) - 1, 1)]
        )
        return Said(f"{settings}, nothing to compare in them", " to ".join(told))
    best = Counter(p.labels[one.best.method] for p, one in found if one.best is not None)
    none = len(found) - best.total()
    if not best:
        short = f"In none of {settings} is a method confirmed to be better than {baseline}"
        return Said(short, more=_plug_ins(found))
    (leader, most), *others = best.most_common()
    rest = [", ".join(f"{one} in {n}" for one, n in others)] if others else []
    rest += [f"in {none} no method is confirmed to be better than {baseline}"] if none else []
    return Said(f"{leader} is best in {most} of {settings}", "; ".join(rest), _plug_ins(found))


def where(panel: Panel) -> str:
    """The title of a panel, which names the scenario and what differs from it."""
    return panel.title.removeprefix("scenario ")


def spoken(panel: Panel) -> Said:
    """The verdict on a panel; where the plan alone is best, on its filters, too."""
    found = panel.verdict
    if found is None:
        return Said("No error is known" if panel.records else "No trial is finished")
    said = _verdict(panel, found)
    if found.best is None:
        said = _on_a_log(panel) or said
    more = [*_unfitted(panel)]
    if found.best and found.best.method.name == BLIND and panel.of_filters is not None:
        scanning = _verdict(panel, panel.of_filters).text.replace("No method", "none", 1)
        more.append(f"Of the methods that use scans, {scanning}")
    more += _elsewhere(panel, found)
    return said._replace(more=" ".join([*more, _plug_ins([(panel, found)])]).strip())


def _on_a_log(panel: Panel) -> Said | None:
    """The verdict on whole logs where the share of successes separates no methods.

    By their errors, else by how often their 95 % regions hold the reference; None if neither does.
    """
    score = "position_median"
    rows = [row for row in panel.present if score in row.journey]
    others = [row for row in rows if not row.is_baseline and row.journey[score].significant]
    errors = {row.method: row.journey[score].value.mean for row in rows}
    if others:
        near = min(others, key=lambda row: errors[row.method])
        base, diff = panel.baseline_of(near), near.journey[score].diff
        first = near if diff.mean < 0 else base
        name = panel.labels[first.method]
        listed = ", ".join(
            f"{panel.labels[row.method]} {errors[row.method]:.3f} m"
            for row in sorted(rows, key=lambda row: errors[row.method])
        )
        return Said(
            f"{name} is nearest to the reference",
            f"median position error of a run, mean over runs: {listed}; "
            f"{panel.labels[near.method]} - {panel.labels[base.method]}: {diff.mean:+.3f} m (95 %: "
            f"{interval(diff, '+.3f')}), p (Holm) {p_value(near.journey[score].p_holm)}",
            "The share of runs that are localized to the end separates no methods.",
        )
    held = {
        panel.labels[method]: [
            share
            for one in records
            if one.track is not None and (share := one.track.scores.get("coverage_95")) is not None
        ]
        for method, records in panel.records.items()
    }
    shares = {label: sum(own) / len(own) for label, own in held.items() if own}
    if len(shares) < 2 or max(shares.values()) - min(shares.values()) < _COVERAGE_APART:
        return None
    listed = ", ".join(f"{percent(share)} of {label}" for label, share in shares.items())
    return Said(
        "Neither successes nor errors separate the methods, but the 95 % regions do",
        f"they hold the reference in {listed}",
    )


def _unfitted(panel: Panel) -> Iterator[str]:
    """Say where methods whose assumptions are fitted to a log are compared with one that is not."""
    methods = [row.method for row in panel.present]
    waits = [one for one in methods if one.name == "amcl" and "alpha1" not in one.params]
    if "scan.power" in panel.setting.assumed and waits and len(methods) > len(waits):
        yield (
            f"{panel.labels[waits[0]]} has Nav2's defaults, while the motion noise and the power "
            "of the scans that the others assume are fitted to this log: deqmcl tune fits it, too."
        )


def _plug_ins(found: Sequence[tuple[Panel, Verdict]]) -> str:
    """What is known of the reader's own methods, where no other sentence names them."""
    outcomes: dict[str, list[str]] = {}
    for panel, one in found:
        for row in panel.ranked:
            if not _is_ours(row) and not row.is_baseline and row is not one.winner:
                what = _outcome(panel, row)
                what = what[0].lower() + what[1:]
                brief = what if len(found) > 1 else f"{_brief(panel, row)}, {what}"
                outcomes.setdefault(panel.labels[row.method], []).append(brief)
    said = []
    for label, own in outcomes.items():
        counts = Counter(own).items()
        several = [
            f"{what} in {counted({n}, 'setting')}" if len(found) > 1 else what for what, n in counts
        ]
        said.append(f"Plug-in {label}: {', '.join(several)}.")
    return " ".join(said)


def _is_ours(row: Comparison) -> bool:
    return row.method.name in WORDS and not plug_ins_of_agent(row.method.agent)


def runner_up(panel: Panel) -> str:
    """How far the next method is behind the best; "" without one, or if next is the baseline."""
    found = panel.verdict
    if found is None or found.best is None or found.following is None:
        return ""
    if found.following.method == found.best.baseline:
        return ""
    name, reached = panel.labels[found.following.method], _brief(panel, found.following)
    lead, form, unit = found.lead, ".2f", panel.unit
    if math.isnan(lead.low) or lead == (0, 0, 0):
        return f"Next is {name}: {reached}."
    if panel.aim is not None:
        lead, form, unit = lead.percent, ".0f", "points"
    doubt = ", an interval that includes 0" if lead.low <= 0 <= lead.high else ""
    behind = f"{lead.mean:{form}} {unit} behind (95 %: {interval(lead, form)})"
    return f"Next is {name}, {reached}: {behind}{doubt}."


def power_hint(panel: Panel) -> str:
    """How many worlds a small difference of errors would need; "" where nothing is known of it.

    Also where a sweep finds that out by itself.
    """
    rows = [row for row in panel.present if row.diff_sd > 0]
    if not rows or panel.aim is not None or panel.rule is not None:
        return ""
    base = panel.baseline_of(rows[0])
    small = stats.worth_seeing(base.error.mean)
    if math.isnan(small):
        return ""
    worlds = {row.method: stats.worlds_to_see(small, row.diff_sd, panel.tests) for row in rows}
    needed = ", ".join(f"{rounded(n)} for {panel.labels[method]}" for method, n in worlds.items())
    return (
        f"Worlds needed to detect a difference of {small:g} {panel.unit} to "
        f"{panel.labels[base.method]} with 80 % power: about {needed}."
    )


def rounded(worlds: int) -> str:
    """A count of worlds or runs with two significant digits, as it is known no better."""
    return f"{int(float(f'{worlds:.2g}')):,}" if worlds <= _MANY else f"more than {_MANY:,}"


def _verdict(panel: Panel, found: Verdict) -> Said:
    row = found.winner
    name, reached = panel.labels[row.method], _reached(panel, row)
    if found.best is not None:
        aside = ""
        if found.first is not row:
            more = f"{panel.labels[found.first.method]} has {_brief(panel, found.first)}"
            aside = f" ({more}, which is not confirmed)"
        apart = _against(row, f" {panel.labels[panel.baseline_of(row).method]}")
        free = math.isnan(row.cost) or row.method.agent != row.baseline.agent
        price = "" if free else f"; costs {significant(row.cost, 2)} × the time"
        return Said(f"{name} is best", f"{reached}, {apart}{price}{aside}")
    if row.is_baseline:
        if all(one.is_baseline for one in panel.present):
            return Said(f"{name} alone, nothing to compare it with", reached)
        return Said(f"No method is better than the baseline, {name}", reached)
    base, own = panel.baseline_of(row), row.standing
    if row.decision is not None:
        return Said(
            f"No method is shown to be better than {panel.labels[base.method]}",
            f"{name} comes first: {_against(row, f' {panel.labels[base.method]}')}",
        )
    ahead = f"{'smallest error' if row.aim is None else 'largest share'}: {name}, {reached}"
    if math.isnan(own.diff.low):
        return Said("Too few worlds to compare methods", ahead)
    return Said(
        f"No method is confirmed to be better than {panel.labels[base.method]}",
        f"it {_standing(panel, base)}. {capital(ahead)}, {_against(row)}; "
        f"{_doubt(row.paired_worlds, own.p_holm, panel.tests)}",
    )


def _brief(panel: Panel, row: Comparison) -> str:
    """The error, or the share of runs that succeed."""
    mean = row.standing.value.mean
    if row.aim is None:
        return f"{significant(mean)} {panel.unit}"
    return f"{percent(mean)} of runs"


def _standing(panel: Panel, row: Comparison) -> str:
    """What a method does, after its name: "has 20 px", "arrives in 50 % of runs"."""
    brief = _brief(panel, row)
    if row.aim is None:
        return f"has {brief}"
    does = "arrives" if done(row.aim) == "arrived" else f"is {done(row.aim)}"
    return f"{does} in {brief}"


def _elsewhere(panel: Panel, found: Verdict) -> Iterator[str]:
    """Which agent comes first with each other localizer, where several agents are compared.

    Those of the reader's own have a sentence anyway.
    """
    if len({row.method.agent for row in panel.present}) < 2:
        return
    told = panel.baseline_of(found.winner).method
    for base in (row for row in panel.present if row.is_baseline and row.method != told):
        rows = [row for row in panel.ranked if panel.baseline_of(row).method == base.method]
        first, against = rows[0], panel.labels[base.method]
        if first.is_baseline:
            yield f"With {base.method.name}, no agent comes before {against}."
            continue
        if not _is_ours(first):
            continue
        name = panel.labels[first.method]
        sure = "confirmed" if first.confirmed else "not confirmed"
        apart = _against(first, f" {against}")
        yield f"{capital(name)} {_standing(panel, first)}, {apart}, {sure}."


def _reached(panel: Panel, row: Comparison) -> str:
    """The error, or what share of runs does what they are about, with its interval."""
    brief = _brief(panel, row)
    if row.aim is None:
        return brief
    ends = interval(row.standing.value.percent, ".0f")
    return f"{done(row.aim)} in {brief} (95 %: {ends})"


def done(aim: Score) -> str:
    """What a run that succeeds is, without how that is measured."""
    return aim.words.partition(" (")[0]


def _against(row: Comparison, base: str = "") -> str:
    """How far a method is from its baseline, and how often its error is the smaller one."""
    if row.decision is not None:
        return ahead(row.decision, row.aim, base)
    if row.aim is not None:
        points = row.standing.diff.percent
        return f"{points.mean:.0f} points above{base} (95 %: {interval(points, '.0f')})"
    worlds = f"smaller in {row.wins:g} of {row.paired_worlds} worlds"
    if math.isnan(row.relative.low):
        return worlds
    below = Estimate(-row.relative.mean, -row.relative.high, -row.relative.low).percent
    form = ".0f" if abs(below.mean) >= 10 else ".1f"
    ends = interval(below, form)
    share = f"{below.mean:{form}}".replace("-", "−")
    return f"{share} % below{base} (95 %: {ends}), {worlds}"


def _doubt(worlds: int, p_holm: float, tests: int) -> str:
    """Why what is better is not confirmed."""
    if stats.least_p(worlds, tests) < ALPHA:
        return f"p = {p_value(p_holm)}"
    return (
        f"{worlds} worlds cannot give p < {ALPHA:g} in "
        f"{tests} {'test' if tests == 1 else 'tests'}, {stats.least_worlds(tests)} can"
    )


FEW = 20  # worlds below which an interval is called rough


def findings(panel: Panel) -> list[str]:
    """Which methods are better or worse than their baseline, or neither, and what to mind."""
    outcomes: dict[str, list[str]] = {}
    for row in panel.ranked:
        if not row.is_baseline:
            outcomes.setdefault(_outcome(panel, row), []).append(panel.labels[row.method])
    sentences = [f"{outcome}: {', '.join(names)}." for outcome, names in outcomes.items()]
    return [*sentences, *filter(None, (_few(panel.present), reading(panel.rows)))]


def _outcome(panel: Panel, row: Comparison) -> str:
    """What is known of a method beside its baseline."""
    other = panel.called(row.baseline)
    if row.decision is not None:
        return f"{BESIDE[row.decision.relation]} {other}"
    return _tested(row, other)


def _tested(row: Comparison, other: str) -> str:
    """The same on a number of worlds that was fixed before."""
    own, aim = row.standing, row.aim
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
        if stats.least_p(max(few), corrected) >= ALPHA
        else "only large differences can be detected"
    )
    return (
        f"With only {counted(few, 'world')} bootstrap intervals are somewhat too narrow, "
        f"and {detected}."
    )
