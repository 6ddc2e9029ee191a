"""Who is best: one sentence a panel, and one on all that was run."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import pandas as pd

from benchmarks.report.frames import PanelFrames, each, frames_of
from benchmarks.sweeps.results import Results
from benchmarks.tables import stats
from benchmarks.tables.deciding import RELATIONS
from benchmarks.tables.panels import BLIND
from benchmarks.tables.stats import ALPHA, Estimate
from benchmarks.tables.text import interval, p_value, percent, short_name, significant

WITHIN = "95 % at all looks"  # what an interval of a decided comparison is

Row = Any  # of a frame, as ``itertuples`` gives it


def conclusion(results: Results) -> str:
    """Return the verdict on all that was run; of several settings, who is best in how many."""
    panels = frames_of(results)
    parts = [verdict(panels[0]) if len(panels) == 1 else _of_several(panels, results)]
    return " ".join(filter(None, [*parts, decided(panels)]))


def verdict(panel: PanelFrames) -> str:
    """Return the verdict on a panel; where the plan alone is best, on its filters, too."""
    ranked = panel.ranked
    if ranked["score"].isna().all():
        return "No error is known." if any(panel.records.values()) else "No trial is finished."
    said, winner = _sentence(panel, ranked), _winner(ranked)
    if winner.relation != "better":
        return _nearest(panel.present) or said
    filters = ranked[ranked["method"] != BLIND]
    if winner.method == BLIND and len(filters):
        said += f" Of the methods that use scans: {_sentence(panel, filters)}"
    return said


def progress(results: Results) -> str:
    """Say how far a sweep has come."""
    done = results.planned - len(results.failures) - results.missing
    said = f"{done} of {results.planned} trials finished"
    if results.failures:
        said += f", {len(results.failures)} failed"
    if results.missing:
        said += f", {results.missing} not run yet: this report is partial"
    return said + "."


def baseline_of(panels: Sequence[PanelFrames], results: Results) -> str:
    """Return what the methods are compared with, by its label if it has one only."""
    names = {
        label for p in panels for label in p.present.loc[~p.present["is_baseline"], "reference"]
    }
    return names.pop() if len(names) == 1 else short_name(results.baseline)


def decided(panels: Sequence[PanelFrames]) -> str:
    """Say how many comparisons are decided, and after how many worlds; "" if that was not asked."""
    rows = pd.concat([p.present for p in panels]) if panels else pd.DataFrame({"decision": []})
    rows = rows[rows["decision"].notna()]
    margin = next((panel.margin for panel in panels if panel.margin is not None), None)
    if margin is None or rows.empty:
        return ""
    counts = rows["decision"].value_counts()
    kinds = ", ".join(f"{counts[kind]} {kind}" for kind in RELATIONS if kind in counts)
    worlds = sorted(rows.loc[rows["decision"] != "open", "decided_worlds"])
    half = f", half of the decisions within {worlds[(len(worlds) - 1) // 2]:.0f} worlds"
    return (
        f"Comparisons with the baseline: {kinds}{half if worlds else ''}. Better or worse: by more "
        f"than the margin of {100 * margin:g} %; equivalent: by less."
    )


def rounded(worlds: int) -> str:
    """A count of worlds or runs with two significant digits, as it is known no better."""
    return f"{int(float(f'{worlds:.2g}')):,}" if worlds <= 100_000 else "more than 100,000"


def _of_several(panels: Sequence[PanelFrames], results: Results) -> str:
    known = [(p, r) for p in panels if not (r := p.ranked)["score"].isna().all()]
    if not known:
        return "No trial is finished."
    n, baseline = len(known), baseline_of(panels, results)
    if all(ranked["is_baseline"].all() for _, ranked in known):
        ends = sorted(known, key=lambda one: one[1]["order"].iloc[0])
        told = [f"{_brief(p, _winner(r))} in {p.where}" for p, r in (ends[0], ends[-1])]
        return f"{n} settings, nothing to compare in them: {' to '.join(told)}."
    winners = [_winner(ranked) for _, ranked in known]
    best = Counter(row.label for row in winners if row.relation == "better")
    open_ = n - best.total()
    if not best:
        return f"In none of {n} settings is a method confirmed to be better than {baseline}."
    (leader, most), *others = best.most_common()
    more = [", ".join(f"{label} in {count}" for label, count in others)] if others else []
    more += [f"in {open_} no method is confirmed to be better than {baseline}"] if open_ else []
    return f"{leader} is best in {most} of {n} settings{': ' * bool(more)}{'; '.join(more)}."


def _winner(ranked: pd.DataFrame) -> Row:
    """The first of those that are better than their baseline; where none is, the first."""
    better = ranked[ranked["relation"] == "better"]
    return next(each(better if len(better) else ranked))


def _sentence(panel: PanelFrames, ranked: pd.DataFrame) -> str:
    first, row = next(each(ranked)), _winner(ranked)
    reached, reference = _reached(panel, row), row.reference
    if row.relation == "better":
        said = f"{row.label} is best: {reached}, {_ahead(panel, row)}"
        if row.same_driver and not math.isnan(row.cost):
            said += f"; costs {significant(row.cost, 2)} × the time"
        if first.label != row.label:
            said += f" ({first.label} has {_brief(panel, first)}, which is not confirmed)"
        return f"{said}."
    if ranked["is_baseline"].all():
        return f"{row.label} alone, nothing to compare it with: {reached}."
    if row.is_baseline:
        return f"No method is better than the baseline, {row.label}: {reached}."
    if row.relation == "not compared":
        return f"Too few worlds to compare methods: first is {row.label}, {reached}."
    ahead = f"first is {row.label}, {reached}, {_ahead(panel, row)}"
    if isinstance(row.decision, str):
        return f"No method is shown to be better than {reference}: {ahead}."
    base = next(one for one in each(panel.ranked) if one.label == reference)
    doubt = f"p = {p_value(row.p)}"
    if stats.least_p(row.paired_worlds, panel.tests) >= ALPHA:
        doubt = (
            f"p < {ALPHA:g} needs {stats.least_worlds(panel.tests)} worlds with the tests of this "
            f"section ({panel.tests})"
        )
    return (
        f"No method is confirmed to be better than {reference}, {_brief(panel, base)}: {ahead}, "
        f"{doubt}."
    )


def _brief(panel: PanelFrames, row: Row) -> str:
    """The error, or the share of runs that succeed."""
    if panel.aim is None:
        return f"{significant(row.score)} {panel.unit}"
    return f"{panel.aim.words.partition(' (')[0]} in {percent(row.score)} of runs"


def _reached(panel: PanelFrames, row: Row) -> str:
    """The same; a share with its interval."""
    if panel.aim is None:
        return _brief(panel, row)
    ends = interval(Estimate(row.score, row.score_low, row.score_high).percent, ".0f")
    return f"{_brief(panel, row)} (95 %: {ends})"


def _ahead(panel: PanelFrames, row: Row) -> str:
    """By how much a method is better than its baseline, with the interval."""
    unit, side = ("%", "below") if panel.aim is None else ("points", "above")
    name, within, after = "apart", "95 %", ""
    if isinstance(row.decision, str):
        word = "open" if row.decision == "open" else "decided"
        name, within, after = "decided", WITHIN, f", {word} after {row.decided_worlds:.0f} worlds"
    elif panel.aim is None:
        name = "relative"
        after = f", smaller in {row.win_rate * row.paired_worlds:g} of {row.paired_worlds} worlds"
    own = _estimate(row, name).percent
    if panel.aim is None:
        own = Estimate(-own.mean, -own.high, -own.low)
    form = ".0f" if abs(own.mean) >= 10 or panel.aim else ".1f"
    ends = f" ({within}: {interval(own, form)})" if abs(own.low) + abs(own.high) < 1e9 else ""
    return f"{own.mean:{form}}".replace("-", "−") + f" {unit} {side} {row.reference}{ends}{after}"


def _estimate(row: Row, name: str) -> Estimate:
    return Estimate(*(getattr(row, f"{name}{end}") for end in ("", "_low", "_high")))


def _nearest(present: pd.DataFrame) -> str:
    """The verdict on whole logs by position errors; "" if these separate no methods, either."""
    score = "position_median"
    if score not in present:
        return ""
    rows = present.sort_values(score)
    low, high = rows[f"{score}_diff_low"], rows[f"{score}_diff_high"]
    clear = rows[((low > 0) | (high < 0)) & (rows[f"{score}_p_holm"] < ALPHA)]
    if clear.empty:
        return ""
    near = next(each(clear))
    apart = _estimate(near, f"{score}_diff")
    first = near.label if apart.mean < 0 else near.reference
    listed = ", ".join(f"{row.label} {getattr(row, score):.3f} m" for row in each(rows))
    return (
        f"{first} is nearest to the reference: median position error of a run, mean over runs: "
        f"{listed}; {near.label} - {near.reference}: {apart.mean:+.3f} m (95 %: "
        f"{interval(apart, '+.3f')}), p (Holm) {p_value(getattr(near, f'{score}_p_holm'))}."
    )
