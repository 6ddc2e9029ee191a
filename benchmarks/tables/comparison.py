"""Every method of a panel against its baseline, over paired worlds, and when that is decided.

The columns are those of results.csv and decisions.csv, and a few more, which are described at
each table. NaN is not available. The runs on a world are averaged first.
"""

import math
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, get_args

import pandas as pd

from benchmarks.tables import frames, stats
from benchmarks.tables.frames import PANEL, ends
from benchmarks.tables.panels import Panel, score_columns
from benchmarks.tables.signals import detection
from benchmarks.tables.stats import ALPHA, NOT_KNOWN, Interval, Rule
from benchmarks.trials.scores import Score
from benchmarks.trials.scoring import SCORE_NAMES

AVERAGED = tuple(name for name in SCORE_NAMES if name not in ("error", "lost"))
RANGED = ("coverage_50", "coverage_80", "coverage_95", "nees")  # scores with an interval
RESULTS = (
    *PANEL, "offset", "worlds", "runs", *ends("error"), "error_sd", *AVERAGED,
    *ends("lost", mean="lost_rate"), "baseline", "paired_worlds", *ends("diff"), "win_rate", "p",
    "p_holm", *ends("auroc"), "far_steps", "far_worlds",
    *(f"{name}_{end}" for name in RANGED for end in ("low", "high")), "diff_sd", *ends("relative"),
)  # fmt: skip
FURTHER = (
    "panel", "label", "reference", "is_baseline", "same_driver", "ms_per_step", "cost", "decision",
    "decided_worlds", *ends("decided"), "expected",
)  # fmt: skip
DECISIONS = (
    *PANEL, "baseline", "baseline_params", "score", "margin", "worlds", "difference", "low", "high",
    "verdict",
)  # fmt: skip

Members = dict[str, pd.DataFrame]  # the runs of methods by label, each by world and filter seed
Relation = Literal["better", "worse", "equivalent", "open"]
RELATIONS: tuple[Relation, ...] = get_args(Relation)


class Look(NamedTuple):
    """What is known after so many worlds: the relative error, or the difference of shares."""

    worlds: int = 0
    interval: Interval = NOT_KNOWN
    # better or worse by more than the margin, equivalent if within it on both sides, or open
    relation: Relation = "open"


def results_table(panels: Sequence[Panel]) -> pd.DataFrame:
    """Return a row per panel, method and offset: the columns of results.csv, and ``FURTHER``.

    docs/reports.md defines the former. Of the latter ``panel`` is its number, ``label`` and
    ``reference`` are what method and baseline are called, ``cost`` is ``ms_per_step`` over the
    baseline's. With a rule there are no tests, and no interval of a difference but that of the last
    look: ``decided`` after ``decided_worlds``, which makes the ``decision``, and ``expected``, the
    error or share to be expected on all worlds of the baseline, as methods have run on different
    ones.
    """
    rows = [row for panel in panels for row in _panel_rows(panel)]
    scores = dict.fromkeys(score for panel in panels for score in panel.scores)
    journeys = (name for score in scores for name in score_columns(score))
    table = pd.DataFrame(rows, columns=[*RESULTS, *journeys, *FURTHER]).infer_objects()
    return table.astype({"decision": object})


def _panel_rows(panel: Panel) -> list[dict[str, Any]]:
    members = {label: panel.runs_of(label) for label in panel.methods}
    longest = frames.longest_ways(members.values())
    rows = []
    for label, runs in members.items():
        for offset in runs.loc[~runs["failed"], "offset"].unique():
            row = _row(panel, label, offset, members)
            if offset == 0:
                row |= detection(panel.records[label])
                for score in panel.scores:
                    row |= _journey(score, members, row, longest)
            rows.append(row)
    return _corrected(panel, rows) if panel.rule is None else _decided(panel, rows)


def _row(panel: Panel, label: str, offset: int, members: Members) -> dict[str, Any]:
    """Return the row of a method at an offset, without what needs the other rows."""
    reference = panel.baselines[label]
    method, baseline = panel.methods[label], panel.methods[reference]
    times = [frames.milliseconds_per_step(panel.records[name]) for name in (label, reference)]
    runs = frames.scored(members[label], offset)
    worlds = {name: frames.by_world(runs[name]).to_numpy() for name in SCORE_NAMES}
    n, lost = len(worlds["error"]), float(worlds["lost"].mean())
    row = {
        **panel.columns(label),
        "offset": offset,
        "worlds": n,
        "runs": len(runs),
        **{name: float(worlds[name].mean()) for name in AVERAGED},
        **ends("error", stats.estimate(worlds["error"])),
        "error_sd": stats.sample_sd(worlds["error"]),
        **ends("lost", (lost, *stats.wilson(lost, n)), mean="lost_rate"),
        "baseline": baseline.reference,
        "paired_worlds": 0,
        "reference": reference,
        "is_baseline": label == reference and offset == 0,
        "same_driver": method.agent == baseline.agent,
        "ms_per_step": times[0],
        "cost": times[0] / times[1] if times[1] > 0 else math.nan,
    }
    for name in RANGED:
        row |= ends(name, stats.estimate(worlds[name]))
    if row["is_baseline"]:
        return row
    pairs = frames.paired_worlds(runs["error"], frames.scored(members[reference])["error"])
    differences, theirs = pairs.to_numpy().T
    return row | {
        "paired_worlds": differences.size,
        **ends("diff", stats.estimate(differences)),
        "diff_sd": stats.sample_sd(differences),
        **ends("relative", stats.relative_change(differences, theirs)),
        "win_rate": stats.win_rate(differences),
        "p": _six_digits(stats.wilcoxon(differences)),
    }


def _journey(
    score: Score, members: Members, row: dict[str, Any], longest: pd.Series
) -> dict[str, float]:
    """Return a score of whole runs over worlds, and beside the baseline's if it is tested.

    Of shares and other numbers it is the mean over worlds, with Wilson's interval for as many cases
    as worlds, or a bootstrap interval. Metres are censored where a run ends before it happens, as
    it does in runs that failed: they count as infinite in the median, which has its interval by
    ranks, and in means (``…_restricted``) and differences as the longest way that any method drove
    in the world. ``…_p`` is of the sign test for shares, with one run on each world McNemar's exact
    test; else of the signed-rank test.
    """
    name, rows = score.name, members[row["label"]]
    if frames.whole_runs(frames.scored(rows), score).empty:
        return {}
    runs = frames.whole_runs(rows, score)
    values = frames.by_world(runs).to_numpy()
    if score.censored:
        columns = ends(name, stats.median_estimate(runs.groupby("trial").median().to_numpy()))
        limited = frames.restricted(rows, score, longest)
        columns[f"{name}_restricted"] = frames.by_world(limited).to_numpy().mean()
    elif score.unit == "share":
        share = float(values.mean())
        columns = ends(name, (share, *stats.wilson(share, values.size)))
    else:
        columns = ends(name, stats.estimate(values))
    if row["is_baseline"] or not score.tested:
        return columns
    pair = (rows, members[row["reference"]])
    pairs = frames.paired_worlds(*(frames.restricted(side, score, longest) for side in pair))
    differences = pairs["apart"].to_numpy()
    p = stats.sign_test(differences) if score.unit == "share" else stats.wilcoxon(differences)
    return columns | ends(f"{name}_diff", stats.estimate(differences)) | {f"{name}_p": p}


def _corrected(panel: Panel, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Correct all tests of a panel at one offset together, by Holm's method."""
    names = ["p", *(f"{score.name}_p" for score in panel.scores if score.tested)]
    for offset in {row["offset"] for row in rows}:
        tests = [(row, name) for row in rows if row["offset"] == offset for name in names]
        adjusted = stats.holm([row.get(name, math.nan) for row, name in tests])
        for (row, name), p in zip(tests, adjusted, strict=True):
            row[name] = _six_digits(row.get(name, math.nan))
            row[f"{name}_holm"] = _six_digits(p)
    return rows


def _six_digits(p: float) -> float:
    """As many as do not depend on how the system computes erfc."""
    return p if math.isnan(p) else float(f"{p:.6g}")


def _decided(panel: Panel, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows with their decisions, and without what only a fixed number of worlds allows."""
    present = {row["label"]: row for row in rows if row["offset"] == 0}
    score = "error" if panel.aim is None else panel.aim.name
    gone = ("_p", "diff_low", "diff_high", "relative_low", "relative_high")
    rows = [{k: v for k, v in row.items() if k != "p" and not k.endswith(gone)} for row in rows]
    for row in rows:
        if row["offset"] != 0 or row["label"] == row["reference"]:
            continue
        *_, last = _looks(panel, row["label"])
        reference = present[row["reference"]].get(score, math.nan)
        change = last.interval.mean
        row["decision"], row["decided_worlds"] = last.relation, last.worlds
        row["expected"] = reference * (1 + change) if panel.aim is None else reference + change
        row.update(ends("decided", last.interval))
    return rows


def decisions_table(panels: Sequence[Panel]) -> pd.DataFrame:
    """Return a row per panel, method and look: the columns of decisions.csv, panel and label.

    Differences are shares of 1; the ``verdict`` stands at the last look. Without a rule there are
    no looks.
    """
    rows = [
        {
            **panel.columns(label),
            **frames.method_columns(panel.methods[reference], "baseline", "baseline_params"),
            "score": "error" if panel.aim is None else panel.aim.name,
            "margin": panel.rule.margin,
            "worlds": look.worlds,
            **dict(zip(("difference", "low", "high"), look.interval, strict=True)),
            "verdict": look.relation if look is looks[-1] else "",
        }
        for panel in panels
        for label, reference in panel.baselines.items()
        if panel.rule and label != reference
        for looks in [_looks(panel, label)]
        for look in looks[1:]
    ]
    return pd.DataFrame(rows, columns=[*DECISIONS, "panel", "label"])


def _looks(panel: Panel, label: str) -> list[Look]:
    assert panel.rule is not None, "where the worlds are fixed nothing is decided"
    ours, baseline = (panel.runs_of(name) for name in (label, panel.baselines[label]))
    return decide(ours, baseline, panel.aim, panel.rule)[0]


def decide(
    ours: pd.DataFrame, baseline: pd.DataFrame, aim: Score | None, rule: Rule
) -> tuple[list[Look], int]:
    """Look at a method beside its baseline after so many worlds, until that decides.

    Return ``Look()``, the looks at each number of worlds that both have finished, and how many
    worlds it needs: those of its last look if it is decided, else of the next. At a look only the
    worlds up to it count, so the order in which trials were run does not matter. Rows are by run;
    ``aim`` is a share of runs; None compares errors at x_t.
    """
    pair = (
        frames.scored(rows)["error"] if aim is None else frames.whole_runs(rows, aim)
        for rows in (ours, baseline)
    )
    pairs, alpha = frames.paired_worlds(*pair), ALPHA / rule.family
    differences, reference = pairs.to_numpy().T
    bets = [] if aim is None else [NOT_KNOWN, *stats.shares(differences, alpha)]
    ended, looks = min(_ended(ours), _ended(baseline)), [Look()]
    for worlds in rule.looks:
        if worlds > ended:
            break
        n = int((pairs.index < worlds).sum())
        interval = stats.ratio(differences[:n], reference[:n], alpha) if aim is None else bets[n]
        looks.append(Look(worlds, interval, _relation(interval, rule.margin, aim)))
        if looks[-1].relation != "open" or math.isnan(interval.mean):
            break
    return looks, worlds


def _ended(rows: pd.DataFrame) -> int:
    """Count the worlds, from the first one, of which every run has ended."""
    runs = rows.index.unique().to_frame(index=False)
    if runs.empty:
        return 0
    seeds = runs.groupby("trial").size()
    whole = seeds.reindex(range(seeds.index.max() + 2)) == 1 + runs["filter_seed"].max()
    return int(whole.argmin())


def _relation(interval: Interval, margin: float, aim: Score | None) -> Relation:
    """Return where an interval lies; the least error is the best, the largest share."""
    if interval.high < -margin:
        return "better" if aim is None else "worse"
    if interval.low > margin:
        return "worse" if aim is None else "better"
    return "equivalent" if -margin < interval.low and interval.high < margin else "open"
