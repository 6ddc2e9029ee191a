"""What a page is made of: the numbers of each panel as frames."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.setup.names import plug_ins_of_agent
from benchmarks.setup.overrides import Overrides
from benchmarks.setup.scenario import Thresholds
from benchmarks.sweeps.results import Results
from benchmarks.tables.comparison import journey_columns
from benchmarks.tables.frames import Cells, by_run, cell, cells_of
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import ALPHA
from benchmarks.tables.text import short_name
from benchmarks.trials.scores import JOURNEY_SCORES, Score
from benchmarks.trials.scoring import Finished
from benchmarks.trials.spec import Setting
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
        rows: see ``results_table``, and plug_in, same_driver (whether the baseline's is).
        runs: see ``trials_frame``, and label; failed trials, too.
        interims: see ``decisions_table``.
        gaps: see ``gaps_table``, and limit_label.
        maps: AUROC by method, question and signal of a map that may be wrong.
        records: finished trials by label, for their curves.
    """

    number: int
    title: str
    setting: Setting
    swept: Overrides
    unit: str
    thresholds: Thresholds
    aim: Score | None
    margin: float | None
    tests: int
    rows: pd.DataFrame
    runs: pd.DataFrame
    interims: pd.DataFrame
    gaps: pd.DataFrame
    maps: pd.DataFrame
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
    def trials(self) -> pd.DataFrame:
        """The columns of trials.csv for each trial and offset, and label."""
        return self.runs[~self.runs["failed"]]

    def runs_of(self, label: str) -> pd.DataFrame:
        """The rows of a method, by run: see ``frames.cell``."""
        return by_run(self.runs[self.runs["label"] == label])

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
    labels = [label for panel in results.panels for label in panel.labels.values()]
    labels, cells = list(dict.fromkeys(labels)), cells_of(results.trials)
    return [_frames(results, panel, labels, cells) for panel in results.panels]


def validity_frame(results: Results) -> pd.DataFrame:
    """AUROC of what filters make of plans, by scenarios, method and signal."""
    panels = {panel.number: panel for panel in results.panels}
    plans = results.plans
    told = {
        number: [short_name(panels[n].setting.scenario) for n in members]
        + panels[number].title.split(", ")[1:]
        for number, members in zip(plans["panel"], plans["panels"], strict=True)
    }
    return _far(plans, "conflict_").assign(scenarios=[", ".join(told[n]) for n in plans["panel"]])


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


def _frames(results: Results, panel: Panel, labels: list[str], cells: Cells) -> PanelFrames:
    def own(table: pd.DataFrame) -> pd.DataFrame:
        rows = table[table["panel"] == panel.number].reset_index(drop=True)
        return rows.assign(label=pd.Categorical(rows["label"], categories=labels))

    others = {*JOURNEY_SCORES.values()} - {*panel.scores}
    absent = [name for score in others for name in journey_columns(score)]
    rows = own(results.table).drop(columns=absent, errors="ignore")
    methods = {label: method for method, label in panel.labels.items()}
    told = [methods[label] for label in rows["label"]]
    rows = rows.assign(
        reference=pd.Categorical(rows["reference"], categories=labels),
        plug_in=[LOCALIZER.is_plug_in(m.name) or bool(plug_ins_of_agent(m.agent)) for m in told],
        same_driver=[m.agent == panel.baselines[m].agent for m in told],
    )
    tests = ["p", *(f"{score.name}_p" for score in panel.scores if score.tested)]
    runs = [
        cell(cells, panel.setting, method).reset_index().assign(label=label)
        for label, method in methods.items()
    ]
    return PanelFrames(
        number=panel.number,
        title=panel.title,
        setting=panel.setting,
        swept=panel.swept,
        unit=panel.unit,
        thresholds=panel.thresholds,
        aim=panel.aim,
        margin=None if results.rule is None else results.rule.margin,
        tests=int(rows.loc[rows["offset"] == 0, tests].notna().to_numpy().sum()),
        rows=rows,
        runs=own(pd.concat(runs).assign(panel=panel.number)).drop(columns=absent, errors="ignore"),
        interims=own(results.decisions),
        gaps=_limited(results.gaps[results.gaps["panel"] == panel.number]),
        maps=_far(results.maps[results.maps["panel"] == panel.number], ""),
        records={label: panel.records[method] for label, method in methods.items()},
    )


def _limited(gaps: pd.DataFrame) -> pd.DataFrame:
    """Return gaps with the label of the limit; its own rows are called after it."""
    limits = [
        " ".join([short_name(limit), *(f"{k}={v}" for k, v in json.loads(params).items())])
        for limit, params in zip(gaps["limit"], gaps["limit_params"], strict=True)
    ]
    itself = (gaps["method"] == gaps["limit"]) & (gaps["params"] == gaps["limit_params"])
    told = [f"limit: {limit}" for limit in limits]
    return gaps.assign(limit_label=limits, label=gaps["label"].where(~itself, told))


def _far(signals: pd.DataFrame, of: str) -> pd.DataFrame:
    """Return AUROC with far_steps and far_worlds, whatever they are of."""
    names = {f"{of}steps": "far_steps", f"{of}worlds": "far_worlds"}
    return signals.rename(columns=names)
