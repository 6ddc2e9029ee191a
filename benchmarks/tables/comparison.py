"""Every method of a panel against its baseline, over paired worlds, and when that is decided.

The columns are those of results.csv and decisions.csv, and a few more, which are told at
each table. NaN is not available. The runs on a world are averaged first.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import pandas as pd

from benchmarks.tables import stats
from benchmarks.tables.frames import (
    PANEL,
    by_world,
    ends,
    longest_ways,
    method_columns,
    milliseconds_per_step,
    paired_worlds,
    restricted,
    scored,
    scores_of_rows,
    whole_runs,
)
from benchmarks.tables.panels import Panel, score_columns
from benchmarks.tables.signals import detection
from benchmarks.tables.stats import ALPHA, NOT_KNOWN, Interval, Rule, ratio, shares
from benchmarks.trials.scores import Score
from benchmarks.trials.scoring import SCORE_NAMES
from benchmarks.trials.spec import Method

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

Members = Mapping[Method, pd.DataFrame]
Relation = Literal["better", "worse", "equivalent", "open"]
RELATIONS: tuple[Relation, ...] = get_args(Relation)


class Look(NamedTuple):
    """What is known after so many worlds: the relative error, or the difference of shares."""

    worlds: int
    interval: Interval


@dataclass(frozen=True, kw_only=True)
class Decision:
    """How a comparison stands."""

    # at each number of worlds that both have finished, up to the one that decided it
    looks: tuple[Look, ...]
    # better or worse by more than the margin, equivalent if within it on both sides, or open
    relation: Relation
    wanted: int  # worlds that it needs: those of its last look if it is decided, else of the next

    @property
    def last(self) -> Look:
        """The last look."""
        return self.looks[-1] if self.looks else Look(0, NOT_KNOWN)


def results_table(panels: Sequence[Panel]) -> pd.DataFrame:
    """Return a row per panel, method and offset: the columns of results.csv, and ``FURTHER``.

    docs/reports.md defines the former. Of the latter ``panel`` is its number, ``label`` and
    ``reference`` are what method and baseline are called, ``cost`` is ``ms_per_step`` over the
    baseline's. With a rule there are no tests, and no interval of a difference but that of the last
    look: ``decided`` after ``decided_worlds``, which makes the ``decision``, and ``expected``, the
    error or share to be expected on all worlds of the baseline, as methods have run on different
    ones.
    """
    rows = list[dict[str, Any]]()
    for panel in panels:
        members = _members(panel)
        every = [row for method in members for row in _method_rows(panel, method, members)]
        rows += _corrected(panel, every) if panel.rule is None else _decided(panel, every, members)
    scores = dict.fromkeys(score for panel in panels for score in panel.scores)
    journeys = (name for score in scores for name in score_columns(score))
    table = pd.DataFrame(rows, columns=[*RESULTS, *journeys, *FURTHER]).infer_objects()
    return table.astype({"decision": object})


def _members(panel: Panel) -> Members:
    return {method: panel.runs_of(label) for method, label in panel.labels.items()}


def _method_rows(panel: Panel, method: Method, members: Members) -> Iterator[dict[str, Any]]:
    """Yield the rows of a method at each offset, without what needs the other rows."""
    baseline = panel.baselines[method]
    own, theirs = members[method], members[baseline]
    times = [milliseconds_per_step(panel.records[one]) for one in (method, baseline)]
    for offset in own.loc[~own["failed"], "offset"].unique():
        runs = scored(own, offset)
        worlds = {name: by_world(runs[name]).to_numpy() for name in SCORE_NAMES}
        n, lost = len(worlds["error"]), float(worlds["lost"].mean())
        is_baseline = method == baseline and offset == 0
        row = {
            **panel.columns(method),
            "offset": offset,
            "worlds": n,
            "runs": len(runs),
            **{name: float(worlds[name].mean()) for name in AVERAGED},
            **ends("error", stats.estimate(worlds["error"])),
            "error_sd": stats.sample_sd(worlds["error"]),
            **ends("lost", (lost, *stats.wilson(lost, n)), mean="lost_rate"),
            "baseline": baseline.reference,
            "paired_worlds": 0,
            "reference": panel.labels[baseline],
            "is_baseline": is_baseline,
            "same_driver": method.agent == baseline.agent,
            "ms_per_step": times[0],
            "cost": times[0] / times[1] if times[1] > 0 else math.nan,
        }
        for name in RANGED:
            row |= ends(name, stats.estimate(worlds[name]))
        if not is_baseline:
            row |= _difference(paired_worlds(runs["error"], scored(theirs)["error"]))
        if offset == 0:
            row |= detection(panel.records[method]).columns("far_steps", "far_worlds")
            longest = longest_ways(members.values())
            for score in scores_of_rows(own):
                row |= _journey(score, own, None if is_baseline else theirs, longest)
        yield row


def _difference(pairs: pd.DataFrame) -> dict[str, Any]:
    """Return how errors differ from the baseline's on the same worlds."""
    apart, reference = pairs.to_numpy().T
    return {
        "paired_worlds": apart.size,
        **ends("diff", stats.estimate(apart)),
        "diff_sd": stats.sample_sd(apart),
        **ends("relative", stats.relative_change(apart, reference)),
        "win_rate": stats.win_rate(apart),
        "p": _six_digits(stats.wilcoxon(apart)),
    }


def _journey(
    score: Score, own: pd.DataFrame, baseline: pd.DataFrame | None, longest: pd.Series
) -> dict[str, float]:
    """Return a score of whole runs over worlds, and beside the baseline's if it is tested.

    Of shares and other numbers it is the mean over worlds, with Wilson's interval for as many cases
    as worlds, or a bootstrap interval. Metres are censored where a run ends before it happens, as
    it does in runs that failed: they count as infinite in the median, which has its interval by
    ranks, and in means (``…_restricted``) and differences as the longest way that any method drove
    in the world. ``…_p`` is of the sign test for shares, with one run on each world McNemar's exact
    test; else of the signed-rank test.
    """
    name, runs = score.name, whole_runs(own, score)
    if runs.empty:
        return {}
    values = by_world(runs).to_numpy()
    row: dict[str, float] = {}
    if score.censored:
        row = ends(name, stats.median_estimate(runs.groupby("trial").median().to_numpy()))
        row[f"{name}_restricted"] = by_world(restricted(own, score, longest)).to_numpy().mean()
    elif score.unit == "share":
        share = float(values.mean())
        row = ends(name, (share, *stats.wilson(share, values.size)))
    else:
        row = ends(name, stats.estimate(values))
    if baseline is None or not score.tested:
        return row
    ours, theirs = (
        restricted(rows, score, longest) if score.censored else whole_runs(rows, score)
        for rows in (own, baseline)
    )
    apart = paired_worlds(ours, theirs)["apart"].to_numpy()
    p = stats.sign_test(apart) if score.unit == "share" else stats.wilcoxon(apart)
    return row | ends(f"{name}_diff", stats.estimate(apart)) | {f"{name}_p": p}


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


def _decided(panel: Panel, rows: list[dict[str, Any]], members: Members) -> list[dict[str, Any]]:
    """Return rows with their decisions, and without what only a fixed number of worlds allows."""
    decisions = {panel.labels[m]: own for m, own in _decisions(panel, members).items()}
    present = {row["label"]: row for row in rows if row["offset"] == 0}
    score = "error" if panel.aim is None else panel.aim.name
    gone = ("_p", "diff_low", "diff_high", "relative_low", "relative_high")
    rows = [{k: v for k, v in row.items() if k != "p" and not k.endswith(gone)} for row in rows]
    for row in rows:
        decision = decisions.get(row["label"])
        if row["offset"] == 0 and decision is not None:
            reference = present[row["reference"]].get(score, math.nan)
            apart = decision.last.interval.mean
            row["decision"], row["decided_worlds"] = decision.relation, decision.last.worlds
            row["expected"] = reference * (1 + apart) if panel.aim is None else reference + apart
            row.update(ends("decided", decision.last.interval))
    return rows


def _decisions(panel: Panel, members: Members) -> dict[Method, Decision]:
    if panel.rule is None:
        return {}
    return {
        method: decide(members[method], members[baseline], panel.aim, panel.rule)
        for method, baseline in panel.baselines.items()
        if method != baseline
    }


def decisions_table(panels: Sequence[Panel]) -> pd.DataFrame:
    """Return a row per panel, method and look: the columns of decisions.csv, panel and label.

    Differences are shares of 1; the ``verdict`` stands at the last look. Without a rule there are
    no looks.
    """
    rows = [row for panel in panels if panel.rule for row in _looks(panel, panel.rule)]
    return pd.DataFrame(rows, columns=[*DECISIONS, "panel", "label"])


def _looks(panel: Panel, rule: Rule) -> Iterator[dict[str, Any]]:
    for method, decision in _decisions(panel, _members(panel)).items():
        shared = {
            **panel.columns(method),
            **method_columns(panel.baselines[method], "baseline", "baseline_params"),
            "score": "error" if panel.aim is None else panel.aim.name,
            "margin": rule.margin,
        }
        for look in decision.looks:
            ways = dict(zip(("difference", "low", "high"), look.interval, strict=True))
            verdict = decision.relation if look is decision.last else ""
            yield shared | {"worlds": look.worlds, **ways, "verdict": verdict}


def _six_digits(p: float) -> float:
    """As many as do not depend on how the system computes erfc."""
    return p if math.isnan(p) else float(f"{p:.6g}")


def decide(ours: pd.DataFrame, baseline: pd.DataFrame, aim: Score | None, rule: Rule) -> Decision:
    """Look at a method beside its baseline after so many worlds, until that decides.

    At a look only the worlds up to it count, so the order in which trials were run does not matter.
    Rows are as of ``frames.cell``; ``aim`` is a share of runs; None compares errors at x_t.
    """
    interval = _intervals(ours, baseline, aim, ALPHA / rule.family)
    there = min(_ended(ours), _ended(baseline))
    looks: list[Look] = []
    relation: Relation = "open"
    for worlds in rule.looks:
        if worlds > there:
            break
        looks.append(Look(worlds, interval(worlds)))
        relation = _relation(looks[-1].interval, rule.margin, least=aim is None)
        if relation != "open" or math.isnan(looks[-1].interval.mean):
            break
    return Decision(looks=tuple(looks), relation=relation, wanted=worlds)


def _intervals(
    ours: pd.DataFrame, baseline: pd.DataFrame, aim: Score | None, alpha: float
) -> Callable[[int], Interval]:
    """Return a function from a number of worlds to what is known after these."""
    mine, theirs = (
        scored(rows)["error"] if aim is None else whole_runs(rows, aim) for rows in (ours, baseline)
    )
    found = paired_worlds(mine, theirs)
    worlds, (apart, reference) = found.index.to_numpy(), found.to_numpy().T
    if aim is not None:
        bets = [NOT_KNOWN, *shares(apart, alpha)]
        return lambda most: bets[int((worlds < most).sum())]
    return lambda most: ratio(apart[worlds < most], reference[worlds < most], alpha)


def _ended(rows: pd.DataFrame) -> int:
    """Count the worlds, from the first one, of which every run has ended."""
    runs = rows.index.unique().to_frame(index=False)
    if runs.empty:
        return 0
    seeds = runs.groupby("trial").size()
    whole = seeds.reindex(range(seeds.index.max() + 2)) == 1 + runs["filter_seed"].max()
    return int(whole.argmin())


def _relation(found: Interval, margin: float, *, least: bool) -> Relation:
    """Return where an interval lies; ``least``: whether the least is the best."""
    if found.high < -margin:
        return "better" if least else "worse"
    if found.low > margin:
        return "worse" if least else "better"
    return "equivalent" if -margin < found.low and found.high < margin else "open"
