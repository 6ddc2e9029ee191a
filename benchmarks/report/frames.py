"""What a page is made of: the numbers of each panel as frames."""

import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.setup.changes import Changes
from benchmarks.setup.names import plug_ins_of_agent
from benchmarks.setup.scenario import Thresholds
from benchmarks.sweeps.results import Results
from benchmarks.tables.auroc import Auroc
from benchmarks.tables.csv_files import decisions_csv, gaps_csv, results_csv, trials_csv
from benchmarks.tables.map_validity import told_apart
from benchmarks.tables.panels import Panel
from benchmarks.tables.plan_validity import validities
from benchmarks.tables.stats import ALPHA
from benchmarks.tables.text import short_name
from benchmarks.trials.scores import Score
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Method, Setting, Trial
from localizers.registry import LOCALIZER


@dataclass(frozen=True, kw_only=True)
class PanelFrames:
    """Methods that are compared with one another, in numbers.

    A method is its ``label``, of which all labels of a page are the categories.

    Attributes:
        number, title, setting, swept: which panel it is.
        unit: of lengths.
        thresholds: of what is far off, and lost.
        aim: the share of whole runs that it is about; None if it is about the error.
        margin: difference that does not matter, where a sweep stops when all is decided.
        tests: how many tests Holm's correction at x[t] is for.
        rows: the columns of results.csv for each method and offset, and label, reference (the
            label of the baseline), is_baseline, plug_in, ms_per_step, cost (its ratio to the
            baseline's) and, of a decided sweep, decision, decided_worlds, expected.
        trials: the columns of trials.csv for each trial and offset.
        interims: the columns of decisions.csv.
        gaps: the columns of gaps.csv, and limit_label.
        maps: AUROC by method, question and signal of a map that may be wrong.
        failed: worlds of failed trials by label.
        records: finished trials by label, for their curves.
    """

    number: int
    title: str
    setting: Setting
    swept: Changes
    unit: str
    thresholds: Thresholds
    aim: Score | None
    margin: float | None
    tests: int
    rows: pd.DataFrame
    trials: pd.DataFrame
    interims: pd.DataFrame
    gaps: pd.DataFrame
    maps: pd.DataFrame
    failed: Mapping[str, list[int]]
    records: Mapping[str, list[Finished]]

    @property
    def where(self) -> str:
        """The scenario and what differs from it."""
        return self.title.removeprefix("scenario ")

    @property
    def agents(self) -> list[str]:
        """Who drives, in a word each; none if that is the scenario's own agent only."""
        params = self.rows["params"].map(json.loads)
        return list(dict.fromkeys(short_name(own["agent"]) for own in params if "agent" in own))

    @property
    def present(self) -> pd.DataFrame:
        """The rows about x[t]."""
        return self.rows[self.rows["offset"] == 0]

    @property
    def ranked(self) -> pd.DataFrame:
        """The rows about x[t], the best first; see ``judged``."""
        return judged(self.present, self.aim)

    def labelled(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Return a frame whose labels have the categories of the page."""
        categories = self.rows["label"].cat.categories
        return frame.assign(label=pd.Categorical(frame["label"], categories=categories))

    @property
    def far(self) -> str:
        """What is far off: e > 50 px."""
        return f"e > {self.thresholds.far:g} {self.unit}"

    @property
    def shared_params(self) -> dict[str, Any]:
        """The parameters in which all methods that take them agree, and which no title names."""
        given = self.present.drop_duplicates("label")[["method", "params"]]
        params = [(method, json.loads(own)) for method, own in given.itertuples(index=False)]
        shared = {}
        for name in sorted({name for _, own in params for name in own} - {"agent", *self.swept}):
            takers = {method for method, own in params if name in own}
            # ... differs from every value: one that was not given it has the default
            values = [own.get(name, ...) for method, own in params if method in takers]
            if len(values) > 1 and all(value == values[0] for value in values):
                shared[name] = values[0]
        return shared


def each(rows: pd.DataFrame) -> Iterator[Any]:
    """Go through rows, whose columns are attributes."""
    return iter(rows.itertuples())


def frames_of(results: Results) -> list[PanelFrames]:
    """Return the panels of results as frames."""
    panels = results.panels
    labels = list(dict.fromkeys(label for panel in panels for label in panel.labels.values()))
    failed = [failure.trial for failure in results.failures]
    return [
        _frames(panel, labels, [t for t in failed if t.setting == panel.setting])
        for panel in panels
    ]


def validity_frame(results: Results) -> pd.DataFrame:
    """AUROC of what filters make of plans, by scenarios, method and signal."""
    return pd.DataFrame(
        {
            "scenarios": ", ".join(
                [
                    *(short_name(panel.setting.scenario) for panel in row.panels),
                    *row.panels[0].title.split(", ")[1:],
                ]
            ),
            "label": row.label,
            "signal": signal,
            **_auroc(found),
        }
        for row in validities(results.panels)
        for signal, found in row.signals.items()
    )


def judged(present: pd.DataFrame, aim: Score | None) -> pd.DataFrame:
    """Return rows about x[t] with what they are ranked by, and how they stand, the best first.

    That is score, score_low, score_high, apart (from the baseline), apart_low, apart_high, p, and
    relation: better, worse, equal, inconclusive, not compared or baseline; of a decided sweep
    better, worse, equivalent or open.
    """
    names = ("error", "diff", "") if aim is None else (aim.name, f"{aim.name}_diff", f"{aim.name}_")
    rows = present.copy()
    for column, name in zip(("score", "apart"), names[:2], strict=True):
        for end in ("", "_low", "_high"):
            known = rows.get(f"{name}{end}", pd.Series(np.nan, rows.index))
            rows[f"{column}{end}"] = known.astype(float)
    rows["p"] = rows.get(f"{names[2]}p_holm", pd.Series(np.nan, rows.index))
    smaller = aim is None
    clear = ((rows["apart_low"] > 0) | (rows["apart_high"] < 0)) & (rows["p"] < ALPHA)
    ahead = (rows["apart"] < 0) == smaller
    rows["relation"] = np.select(
        [
            rows["is_baseline"],
            rows["decision"].notna(),
            rows["apart"].isna() | rows["apart_low"].isna(),
            (rows["apart_low"] == 0) & (rows["apart_high"] == 0),
            clear & ahead,
            clear,
        ],
        ["baseline", rows["decision"], "not compared", "equal", "better", "worse"],
        "inconclusive",
    )
    shown = rows["expected"].fillna(rows["score"])
    rows["order"] = shown if smaller else -shown
    rows["other"] = ~rows["is_baseline"]
    return rows.sort_values(["order", "other"], na_position="last").drop(columns="other")


def _frames(panel: Panel, labels: list[str], failed: list[Trial]) -> PanelFrames:
    def labelled(names: Iterable[str]) -> "pd.Categorical[Any]":
        return pd.Categorical(list(names), categories=labels)

    def called(methods: Iterable[Any]) -> "pd.Categorical[Any]":
        return labelled(panel.labels[method] for method in methods)

    records = {panel.labels[method]: own for method, own in panel.records.items()}
    trials = _read(trials_csv(record for own in records.values() for record in own))
    trials["label"] = labelled(n for n, own in records.items() for r in own for _ in r.scores)
    decided = [(row.method, row.decision) for row in panel.present if row.decision]
    interims = _read(decisions_csv([panel]))
    interims["label"] = called(method for method, own in decided for _ in own.interims)
    gaps = _read(gaps_csv([panel]))
    gaps["limit_label"] = [_told(row.limit) for row in panel.gaps]
    gaps["label"] = [
        f"limit: {_told(g.limit)}" if g.method == g.limit else panel.labels[g.method]
        for g in panel.gaps
    ]
    maps = [
        {"label": panel.labels[row.method], "question": q, "signal": signal, **_auroc(found)}
        for row in told_apart([panel])
        for q, signals in row.answers.items()
        for signal, found in signals.items()
    ]
    return PanelFrames(
        number=panel.number,
        title=panel.title,
        setting=panel.setting,
        swept=panel.swept,
        unit=panel.unit,
        thresholds=panel.thresholds,
        aim=panel.aim,
        margin=None if panel.rule is None else panel.rule.margin,
        tests=panel.tests,
        rows=pd.concat([_read(results_csv([panel])), _more(panel.rows, called)], axis=1),
        trials=trials,
        interims=interims,
        gaps=gaps,
        maps=pd.DataFrame(maps),
        failed={
            label: [trial.trial for trial in failed if trial.method == method]
            for method, label in panel.labels.items()
        },
        records=records,
    )


def _more(
    rows: list[Any], called: Callable[[Iterable[Any]], "pd.Categorical[Any]"]
) -> pd.DataFrame:
    """Return what a page needs of comparisons beside the columns of results.csv."""
    decisions = [row.decision for row in rows]
    intervals = [one.interval if one else (np.nan,) * 3 for one in decisions]
    return pd.DataFrame(
        {
            "label": called(row.method for row in rows),
            "reference": called(row.baseline for row in rows),
            "is_baseline": [row.is_baseline for row in rows],
            "plug_in": [_is_plug_in(row.method) for row in rows],
            "same_driver": [row.method.agent == row.baseline.agent for row in rows],
            "ms_per_step": [row.milliseconds for row in rows],
            "cost": [row.cost for row in rows],
            "decision": np.array([one and one.relation for one in decisions], dtype=object),
            "decided_worlds": [one.worlds if one else np.nan for one in decisions],
            "expected": [row.expected for row in rows],
            **{f"decided{e}": [i[k] for i in intervals] for k, e in enumerate(("", *_ENDS))},
        }
    )


_ENDS = ("_low", "_high")


def _is_plug_in(method: Method) -> bool:
    return LOCALIZER.is_plug_in(method.name) or bool(plug_ins_of_agent(method.agent))


def _read(text: str) -> pd.DataFrame:
    return pd.read_csv(io.StringIO(text))


def _auroc(found: Auroc) -> dict[str, Any]:
    ends = dict(zip(("auroc", "auroc_low", "auroc_high"), found.auroc, strict=True))
    return ends | {"far_steps": found.far_steps, "far_worlds": found.far_worlds}


def _told(limit: Method) -> str:
    return " ".join([short_name(limit.name), *(f"{k}={v}" for k, v in limit.params.items())])
