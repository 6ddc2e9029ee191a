"""Who is best: one sentence a panel, and one on all that was run."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import pandas as pd

from benchmarks.setup.names import is_plug_in
from benchmarks.sweeps.results import Results
from benchmarks.tables import estimated, interval, p_value, percent, rounded, short_name, stats
from benchmarks.tables.comparison import RELATIONS
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import ALPHA, Interval
from deqmcl_gym.validation import amount

AT_ALL_LOOKS = "95 % at all looks"  # what an interval of a decided comparison is
_BLIND = "dead-reckoning"  # uses no scan, so that it localizes nothing
_COVERAGE_APART = 0.1  # difference of shares inside a region that is worth a sentence


def conclusion(results: Results) -> str:
    """Return the verdict on all that was run; of several settings, who is best in how many."""
    panels = results.panels
    parts = [verdict_on(panels[0]) if len(panels) == 1 else _of_several(panels, results)]
    return " ".join(filter(None, [*parts, decided(panels)]))


def verdict_on(panel: Panel) -> str:
    """Return the verdict on a panel; where the plan alone is best, on its filters, too."""
    ranked = panel.ranked
    if ranked["score"].isna().all():
        if not any(panel.records.values()):
            return "No trial is finished."
        measured = "position_median" in panel.present.dropna(axis="columns", how="all")
        return "Whether runs end localized is not known." if measured else "No error is known."
    winner = _winner(ranked)
    sentences = [_sentence(panel, ranked)]
    worse = ranked.loc[ranked["relation"] == "worse", "label"]
    if winner.relation == "better":
        if winner.method == _BLIND and len(filters := ranked[ranked["method"] != _BLIND]):
            sentences.append(f"Of the methods that use scans: {_sentence(panel, filters)}")
    elif worse.empty:
        sentences = [_on_a_log(panel) or sentences[0]]
    elif "position_median" in panel.present:  # on a log
        sentences.append(f"Worse: {', '.join(worse)}.")
    sentences += [
        f"{label} has Nav2's defaults, while the motion noise and the power of the scans that the "
        "others assume are fitted to this log: deqmcl tune fits it, too."
        for label in _unfitted(panel)
    ]
    sentences += [
        f"Plug-in {row.label}: {_reached(panel, row)}, {row.relation}."
        for row in _plug_ins(panel, winner)
    ]
    return " ".join(sentences)


def progress(results: Results) -> str:
    """Say how far a sweep has come."""
    return f"{results.progress}{': this report is partial' if results.missing else ''}."


def decided(panels: Sequence[Panel]) -> str:
    """Say how many comparisons are decided, and after how many worlds; "" if that was not asked."""
    rule = next((panel.rule for panel in panels if panel.rule), None)
    if rule is None:
        return ""
    rows = pd.concat([panel.present for panel in panels]).dropna(subset="decision")
    if rows.empty:
        return ""
    counts = rows["decision"].value_counts()
    kinds = ", ".join(f"{counts[kind]} {kind}" for kind in RELATIONS if kind in counts)
    worlds = sorted(rows.loc[rows["decision"] != "open", "decided_worlds"])
    half = f", half of the decisions within {worlds[(len(worlds) - 1) // 2]:.0f} worlds"
    return (
        f"Comparisons with the baseline: {kinds}{half if worlds else ''}. Better or worse: by more "
        f"than the margin of {100 * rule.margin:g} %; equivalent: by less."
    )


def _of_several(panels: Sequence[Panel], results: Results) -> str:
    settings = [(p, r) for p in panels if not (r := p.ranked)["score"].isna().all()]
    if not settings:
        return "No trial is finished."
    references = {
        label for p in panels for label in p.present.loc[~p.present["is_baseline"], "reference"]
    }
    baseline = references.pop() if len(references) == 1 else short_name(results.baseline)
    n = len(settings)
    if all(ranked["is_baseline"].all() for _, ranked in settings):
        ordered = sorted(settings, key=lambda setting: setting[1]["order"].iloc[0])
        extremes = [f"{_brief(p, _winner(r))} in {p.where}" for p, r in (ordered[0], ordered[-1])]
        return f"{n} settings, nothing to compare in them: {' to '.join(extremes)}."
    winners = [_winner(ranked) for _, ranked in settings]
    best = Counter(row.label for row in winners if row.relation == "better")
    others = ", ".join(f"{label} in {count}" for label, count in best.most_common()[1:])
    open_ = n - best.total()
    none = f"in {open_} no method is confirmed to be better than {baseline}" if open_ else ""
    if best:
        leader, most = best.most_common(1)[0]
        more = "; ".join(filter(None, (others, none)))
        sentence = f"{leader} is best in {most} of {n} settings{': ' * bool(more)}{more}."
    else:
        sentence = f"In none of {n} settings is a method confirmed to be better than {baseline}."
    plug_ins = Counter(
        (row.label, row.relation)
        for (panel, _), winner in zip(settings, winners, strict=True)
        for row in _plug_ins(panel, winner)
    )
    further = [f"Plug-in {label}: {what} in {k} of {n}." for (label, what), k in plug_ins.items()]
    return " ".join([sentence, *further])


def plug_in_labels(panel: Panel) -> set[str]:
    """Return the methods whose localizer or agent is somebody's own."""
    return {label for label, m in panel.methods.items() if is_plug_in(m.name, m.agent)}


def _plug_ins(panel: Panel, winner: Any) -> list[Any]:
    """The plug-ins of which the verdict on the winner says nothing."""
    rows, mentioned = panel.ranked, {winner.label, *panel.present.query("is_baseline")["label"]}
    rows = rows[rows["label"].isin(plug_in_labels(panel) - mentioned)]
    return [row for _, row in rows.iterrows()]


def _winner(ranked: pd.DataFrame) -> Any:
    """The first of those that are better than their baseline; where none is, the first."""
    better = ranked[ranked["relation"] == "better"]
    return (better if len(better) else ranked).iloc[0]


def _sentence(panel: Panel, ranked: pd.DataFrame) -> str:
    first, row = ranked.iloc[0], _winner(ranked)
    reached = _reached(panel, row)
    if row.relation == "better":
        sentence = f"{row.label} is best: {reached}, {_ahead(panel, row)}"
        if row.same_driver and not math.isnan(row.cost):
            sentence += f"; costs {rounded(row.cost, 2)} × the time"
        if first.label != row.label:
            sentence += f" ({first.label} has {_brief(panel, first)}, which is not confirmed)"
        return f"{sentence}."
    if ranked["is_baseline"].all():
        return f"{row.label} alone, nothing to compare it with: {reached}."
    if row.is_baseline:
        return f"No method is better than the baseline, {row.label}: {reached}."
    if row.relation == "not compared":
        return f"Too few {panel.world}s to compare methods: first is {row.label}, {reached}."
    ahead = f"first is {row.label}, {reached}, {_ahead(panel, row)}"
    if isinstance(row.decision, str):
        return f"No method is shown to be better than {row.reference}: {ahead}."
    base = panel.ranked[panel.ranked["label"] == row.reference].iloc[0]
    doubt = f"p = {p_value(row.p)}"
    if stats.least_p(row.paired_worlds, panel.tests) >= ALPHA:
        doubt = (
            f"p < {ALPHA:g} needs {stats.least_worlds(panel.tests)} {panel.world}s with the tests "
            f"of this section ({panel.tests})"
        )
    return (
        f"No method is confirmed to be better than {row.reference}, {_brief(panel, base)}: "
        f"{ahead}, {doubt}."
    )


def _brief(panel: Panel, row: Any) -> str:
    if panel.aim is None:
        return f"{rounded(row.score)} {panel.first.unit}"
    success, _, _ = panel.aim.words.partition(" (")  # without how that is measured
    return f"{success} in {percent(row.score)} of runs"


def _reached(panel: Panel, row: Any) -> str:
    """The error, or the share of runs that succeed with its interval."""
    if panel.aim is None:
        return _brief(panel, row)
    ends = interval(Interval(row.score, row.score_low, row.score_high).percent, ".0f")
    return f"{_brief(panel, row)} (95 %: {ends})"


def _ahead(panel: Panel, row: Any) -> str:
    """By how much a method is better than its baseline, with the interval."""
    unit, side = ("%", "below") if panel.aim is None else ("percentage points", "above")
    gain, within, after = Interval(row.apart, row.apart_low, row.apart_high), "95 %", ""
    if isinstance(row.decision, str):
        gain = Interval(row.decided, row.decided_low, row.decided_high)
        word = "open" if row.decision == "open" else "decided"
        within, after = AT_ALL_LOOKS, f", {word} after {row.decided_worlds:.0f} {panel.world}s"
    elif panel.aim is None:
        gain = Interval(row.relative, row.relative_low, row.relative_high)
        after = f", smaller in {row.win_rate * row.paired_worlds:g} of {row.paired_worlds} worlds"
    if panel.aim is None:
        gain = Interval(-gain.mean, -gain.high, -gain.low)
    gain = gain.percent
    form = ".0f" if abs(gain.mean) >= 10 or panel.aim else ".1f"
    ends = f" ({within}: {interval(gain, form)})" if abs(gain.low) + abs(gain.high) < 1e9 else ""
    return f"{gain.mean:{form}}".replace("-", "−") + f" {unit} {side} {row.reference}{ends}{after}"


def _on_a_log(panel: Panel) -> str:
    """The verdict on whole logs of equal success: by errors, else by coverage of 95 % regions."""
    score, rows = "position_median", panel.present
    if score not in rows or len(rows) == 1:
        return ""
    runs = int(rows["worlds"].max())
    tests = (len(rows) - 1) * (1 + sum(score.tested for score in panel.scores))
    if stats.least_p(runs, tests) >= ALPHA:
        least = stats.least_worlds(tests)
        return f"{amount(runs, 'run')} each cannot decide: give --seeds {least} or more."
    rows = rows.sort_values(score)
    low, high = rows[f"{score}_diff_low"], rows[f"{score}_diff_high"]
    clear = rows[((low > 0) | (high < 0)) & (rows[f"{score}_p_holm"] < ALPHA)]
    if len(clear):
        near = clear.iloc[0]
        diff = Interval(*(near[f"{score}_diff{end}"] for end in ("", "_low", "_high")))
        first = near.label if diff.mean < 0 else near.reference
        errors = rows[["label", score]].itertuples(index=False)
        listed = ", ".join(f"{label} {error:.3f} m" for label, error in errors)
        return (
            f"{first} is nearest to the reference: median position error of a run, mean over runs: "
            f"{listed}; {near.label} - {near.reference}: "
            f"{estimated(diff, '+.3f', ' m')}, p (Holm) "
            f"{p_value(near[f'{score}_p_holm'])}. The share of runs that are localized to "
            "the end separates no methods."
        )
    held = {}
    for label, records in panel.records.items():
        shares = [r.track.scores.get("coverage_95") for r in records if r.track is not None]
        if values := [share for share in shares if share is not None]:
            held[label] = sum(values) / len(values)
    if len(held) < 2 or max(held.values()) - min(held.values()) < _COVERAGE_APART:
        return ""
    listed = ", ".join(f"{percent(share)} of {label}'s records" for label, share in held.items())
    return (
        "Neither successes nor errors separate the methods, but the 95 % regions do: they hold the "
        f"reference in {listed}."
    )


def _unfitted(panel: Panel) -> list[str]:
    """Methods with default assumptions beside others that are fitted to a part of the log."""
    methods = panel.methods.items()
    untuned = [name for name, m in methods if m.name == "amcl" and "alpha1" not in m.params]
    fitted = "scan.power" in panel.setting.assumed and "judged" in panel.setting.world
    return untuned[:1] if fitted and len(panel.methods) > len(untuned) else []
