"""Tables of a panel: frames of words, which pandas writes as HTML, Markdown, text and LaTeX."""

import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import pandas as pd

from benchmarks.report.verdict import AT_ALL_LOOKS, plug_in_labels
from benchmarks.sweeps.results import Results
from benchmarks.tables.panels import Panel, common_words
from benchmarks.tables.signals import QUESTIONS, WRONG
from benchmarks.tables.stats import Interval
from benchmarks.tables.text import (
    estimated,
    fixed,
    p_value,
    percent,
    short_name,
    significant,
    state_name,
)
from benchmarks.trials.scores import LEVELS, Score, ScoreGroup

_MARKED = {
    "better": "▼",
    "worse": "▲",
    "inconclusive": "○",
    "open": "○",
    "equivalent": "=",
    "equal": "=",
}
_LISTED = 100  # files left out
GROUP_WORDS = {  # by group of scores of whole runs: heading, what its columns mean
    "lost": (
        "Localized",
        "Of the best cluster. Localized to the end: within that distance and angle of the truth in "
        "every step of the last 25 % of the run. Metres to localize: driven until it stays within "
        "1 m and 30° to the end; never: half of the runs or more do not. False commitment: "
        "quality above 0.5 while more than 2 m off, in a step of the last 25 %; beside it, as a "
        "share of all steps.",
    ),
    "ambiguity": (
        "Two places that fit",
        "A half turn gives the same map, so that scans fit two poses. Weight within 1 m and 30° of "
        "each, on average over the last 25 % of a run; the smaller of the two as a share of both: "
        "½ is undecided, 0 has picked one.",
    ),
    "recovery": (
        "Found again",
        "After the kidnap. Recovered: the best cluster is within 0.45 m of the truth for 20 steps "
        "in a row. Metres to recover: driven from the kidnap until these steps begin.",
    ),
    "log": (
        "Against the reference",
        "Of the best cluster, at the records that have a reference: mean over runs of the median.",
    ),
    "driving": (
        "Arrived",
        "Arrived: ends within 0.5 m of the goal, without contact. SPL: success weighted by path "
        "length, shortest / max(driven, shortest) of runs that arrive, 0 of others. Contacts: "
        "steps that a wall stopped. Clearance: least distance of the robot's rim to a wall.",
    ),
}
_TESTS = (
    " Difference to the baseline: on the same worlds; where it never happens, metres count as the "
    "longest way driven in that world. p: sign test over worlds for shares, signed-rank test for "
    "metres, corrected by Holm's method for all tests of this section. Intervals: 95 %."
)


Writer = Callable[[pd.DataFrame], Iterable[Any]]
Columns = Mapping[str, str | Writer]  # by title: a column of a frame, or how rows are told


class Table(NamedTuple):
    """A frame of words with what it shows; the first column names a line."""

    caption: str
    frame: pd.DataFrame
    strong: Collection[tuple[int, int]] = ()  # cells in bold, by line and column

    def written(self, words: Callable[[str], str] = str, strong: str = "{}") -> pd.DataFrame:
        """Return the cells in a markup language: ``words`` escapes, ``strong`` is bold."""
        frame = self.frame.astype(str).map(words).rename(columns=words)
        for line, column in self.strong:
            frame.iloc[line, column] = strong.format(frame.iloc[line, column])
        return frame

    @property
    def html(self) -> str:
        """As HTML; an interval is never broken."""
        with pd.option_context("display.max_colwidth", None):
            cells = self.written(html_cell, "<strong>{}</strong>")
            return cells.to_html(index=False, escape=False, border=0)

    def text(
        self, style: str = "simple", words: Callable[[str], str] = str, strong: str = "{}"
    ) -> str:
        """As text, in a format of tabulate."""
        align = ("left", *["right"] * (self.frame.shape[1] - 1))
        frame = self.written(words, strong)
        return frame.to_markdown(index=False, tablefmt=style, disable_numparse=True, colalign=align)

    def latex(self, escaped: Callable[[str], str]) -> str:
        """As a tabular of booktabs."""
        frame = self.written(escaped, r"\textbf{{{}}}")
        return frame.to_latex(index=False, column_format="l" + "r" * (frame.shape[1] - 1))


class Part(NamedTuple):
    """A heading with how to read it, its tables and charts."""

    heading: str
    note: str = ""
    tables: Sequence[Table] = ()
    charts: Sequence[Any] = ()


def parted(cell: str) -> tuple[str, str]:
    """Return a number and the interval or SD behind it; "" if there is none."""
    found = re.fullmatch(r"([+−\d][^()]*?) (\([^()]*\))", cell)
    return (found[1], found[2]) if found else (cell, "")


def html_cell(text: str) -> str:
    """Return a cell as HTML."""
    value, ends = parted(text)
    if value[:1] in "+−0123456789":  # a number and its unit stay together
        value = value.replace(" ", "\u00a0")
    return f"{escape(value)} <span>{escape(ends)}</span>" if ends else escape(value)


def of_rows(rows: pd.DataFrame, columns: Columns) -> pd.DataFrame:
    """Return rows as words, a line each."""
    cells = {
        name: rows[own] if isinstance(own, str) else own(rows) for name, own in columns.items()
    }
    return pd.DataFrame({name: list(own) for name, own in cells.items()}, dtype=str)


def words(write: Callable[..., str], *names: str) -> Writer:
    """Tell the values of columns, row by row."""
    return lambda rows: [write(*one) for one in zip(*(rows[name] for name in names), strict=True)]


def means(name: str, form: str = ".2f", unit: str = "", scale: float = 1) -> Writer:
    """Tell means with the intervals of name_low and name_high, if there are any."""

    def write(*ends: float) -> str:
        return estimated(Interval(*(scale * float(end) for end in ends)), form, unit)

    ends = (name, f"{name}_low", f"{name}_high")
    return lambda rows: words(write, *(end for end in ends if end in rows))(rows)


def apart(name: str, form: str = "+.2f", unit: str = "", scale: float = 1) -> Writer:
    """Tell differences to the baseline in this way."""
    told = means(name, form, unit, scale)
    return lambda rows: [
        "baseline" if itself else cell
        for itself, cell in zip(rows["is_baseline"], told(rows), strict=True)
    ]


def dashed(write: Callable[[float], str]) -> Callable[[float], str]:
    """Tell a number; – if there is none."""
    return lambda value: "–" if math.isnan(value) else write(value)


def _mean_sd(mean: float, sd: float) -> str:
    """A mean and its SD."""
    return f"{fixed(mean)} ({fixed(sd)})"


_METHOD: Columns = {"method": "label", "belief about": words(state_name, "offset")}


def verdict_table(panel: Panel) -> Table:
    """The methods, the best first, and how they compare with the baseline."""
    rows, aim, unit, at = panel.ranked, panel.aim, panel.unit, panel.thresholds
    plug_ins = plug_in_labels(panel)
    caption = "The best first and in bold, compared with the baseline on the same worlds. "
    error: Columns = {f"error e, {unit} (SD)": words(_mean_sd, "error", "error_sd")}
    relation: Columns = {"verdict": "relation"}
    if panel.rule:
        caption += (
            "All intervals of the sweep, at all looks, hold together with 95 %; each method's own "
            "score is of the worlds that it needed. "
        )
        decided = apart("decided", "+.1f", " %" if aim is None else " points", 100)
        numbers = {
            f"difference to the baseline ({AT_ALL_LOOKS})": lambda rows: [
                re.sub(r" \(.*inf.*\)", "", cell) for cell in decided(rows)
            ],
            **relation,
            "after worlds": words(dashed("{:.0f}".format), "decided_worlds"),
            **(error if aim is None else {aim.words: words(percent, "score")}),
        }
    elif aim is None:
        caption += (
            "Error of the belief about the present, x[t]. Better, worse: the interval excludes 0 "
            f"and p < 0.05. Lost: position error above {at.lost:g} {unit} on average over the last "
            f"{at.lost_steps} states. "
        )
        numbers = {
            **error,
            "difference to the baseline (95 %)": apart("diff"),
            **relation,
            "wins": words(dashed(percent), "win_rate"),
            "p, Holm": words(dashed(p_value), "p_holm"),
            "lost runs (95 %)": words(_lost, "lost_rate", "runs", "lost_low", "lost_high"),
        }
    else:
        difference = {"difference of e (95 %)": apart("diff")}
        numbers = {**_score_columns(aim), **relation, **error, **difference}
    caption += (
        "ms per step: the method's own time, median over runs, and its ratio to the baseline's."
    )
    columns: Columns = {
        "method": lambda rows: [
            label + (" (baseline)" if itself else " (plug-in)" if label in plug_ins else "")
            for label, itself in zip(rows["label"], rows["is_baseline"], strict=True)
        ],
        **numbers,
        "ms per step (ratio)": words(_cost, "ms_per_step", "cost"),
        "worlds": "worlds",
    }
    best = [n for n, order in enumerate(rows["order"]) if order == rows["order"].iloc[0]]
    return Table(caption, of_rows(rows, columns), [(n, column) for n in best for column in (0, 1)])


def journey_table(panel: Panel, group: ScoreGroup) -> Table | None:
    """Scores of whole runs; None if the panel has none of this group."""
    rows = panel.ranked
    scores = [score for score in group.scores if score.name in rows]
    if not scores:
        return None
    columns: dict[str, str | Writer] = {"method": "label"}
    for score in scores:
        columns |= _score_columns(score)
    tested = any(score.tested for score in scores)
    return Table(GROUP_WORDS[group.name][1] + (_TESTS if tested else ""), of_rows(rows, columns))


def glance_table(panels: Sequence[Panel]) -> Table:
    """What all methods are ranked by, on all settings, with marks, the best in bold."""
    labels = list(dict.fromkeys(label for panel in panels for label in panel.present["label"]))
    lines, strong = [], []
    for n, panel in enumerate(panels):
        rows, aim = panel.ranked, panel.aim
        marked = {
            label: f"{fixed(score) if aim is None else percent(score)} {mark}".rstrip()
            for label, score, mark in zip(
                rows["label"], rows["score"], _marks(rows["relation"], aim), strict=True
            )
        }
        best = rows.loc[rows["order"] == rows["order"].iloc[0], "label"]
        strong += [(n, 1 + labels.index(label)) for label in best]
        lines.append([f"{panel.number}. {panel.where}", *(marked.get(one, "–") for one in labels)])
    aims = [panel.aim.words if panel.aim else "error e of x[t]" for panel in panels]
    caption = (
        f"Score: {'; '.join(dict.fromkeys(aims))}; the best of a setting in bold. ▼ smaller than "
        "the baseline's, ▲ larger (95 % interval excludes 0 and p < 0.05 after Holm's correction; "
        "where a sweep stops when decided: by more than the margin), ○ inconclusive, = the same."
    )
    if common := common_words({panel.setting: None for panel in panels}):
        caption += f" All settings: {', '.join(common)}."
    return Table(caption, pd.DataFrame(lines, columns=["setting", *labels]), strong)


def calibration_table(panel: Panel) -> Table:
    """Calibration of the beliefs at every offset."""
    columns: Columns = {
        **_METHOD,
        f"energy score, {panel.unit}": words(fixed, "energy_score"),
        **{f"inside {at} %": means(f"coverage_{at}", ".0f", " %", 100) for at in LEVELS},
        "NEES (3)": words(nees_words, "nees", "nees_low", "nees_high"),
        "entropy, nats": words(lambda nats: fixed(nats).replace("-", "−"), "entropy"),
        "in walls": words(_tenths, "wall_share"),
    }
    caption = "With 95 % intervals over worlds; n/a: the method's belief has no spread."
    return Table(caption, of_rows(panel.rows, columns))


def nees_words(*ends: float) -> str:
    """A NEES with one decimal; a large one, which is far from 3 anyhow, with three digits."""
    if not ends[0] >= 100:
        return estimated(Interval(*ends), ".1f")
    return estimated(Interval(*(float(f"{one:.3g}") for one in ends)), ",.0f")


def detection_table(panel: Panel) -> Table | None:
    """The AUROC of each method; None if no method gives a quality and was far off, not always."""
    rows, far = panel.present, panel.far
    if rows["auroc"].isna().all():
        return None
    columns: Columns = {
        "method": "label",
        "AUROC (95 %)": AUROC,
        f"steps with {far}": words(_tenths, "far_steps"),
        "in how many worlds": words(_of_worlds, "far_worlds", "worlds"),
    }
    caption = (
        f"AUROC of the quality at x[t] against {far}, over all steps of all worlds; 1: every far "
        "step has a smaller quality than every other, ½: no better than chance."
    )
    return Table(caption, of_rows(rows, columns))


def validity_table(results: Results) -> Table | None:
    """The AUROC of what filters make of plans; None if none reads plans, or none conflicts."""
    plans, panels = results.plans, {panel.number: panel for panel in results.panels}
    scenarios = [
        ", ".join(
            [short_name(panels[n].setting.scenario) for n in members]
            + panels[number].title.split(", ")[1:]
        )
        for number, members in zip(plans["panel"], plans["panels"], strict=True)
    ]
    caption = (
        "AUROC of what a filter makes of a plan against whether the plan, laid from the true pose, "
        "collides. feasible: share of the belief from which it does not; tempering: λ; "
        "log_evidence: of the belief with the plan over that without; log_evidence_20: its mean "
        "over 20 steps; trusted: P(the plans are about this robot); trusted_lap: its least in a "
        "lap, against whether the plan collides at any of its steps; quality: confidence by the "
        "scans. 1: a plan in conflict always has the smaller value; ½: chance. The scenarios of a "
        "line are taken together."
    )
    return _signal_table(
        _far(plans.assign(scenarios=scenarios), "conflict_"),
        ["scenarios", "label"],
        "steps in conflict",
        caption,
    )


def told_apart_table(panel: Panel) -> Table | None:
    """The AUROC of what may tell lost robots from wrong maps; None where none is wrong."""
    caption = (
        "AUROC of what is seen at the best cluster. lost: it is not within 1 m and 30° of the true "
        f"pose; the map is wrong here: more than {percent(WRONG)} of the returns contradict it "
        "at the true pose. quality: confidence; explained: share of the returns that "
        "agree with the map; beyond_random: explained, less the most at one of 256 random poses; "
        "short, long: shares that contradict it; repeated, elsewhere: shares that do so where the "
        "map was contradicted from another pose before, and where it was not; trusted: the belief "
        "that the plan is about this robot. 1: trouble always has the smaller quality, explained, "
        "beyond_random or trust, or the larger share; ½: chance; below ½: the opposite."
    )
    maps = panel.maps.replace({"question": QUESTIONS}) if len(panel.maps) else panel.maps
    return _signal_table(_far(maps), ["label", "question"], "steps that are", caption)


def failed_table(results: Results) -> Table | None:
    """The trials that failed, and why."""
    lines = [
        (
            f"{one.trial.localizer} on {one.trial.scenario}, world {one.trial.trial}, filter seed "
            f"{one.trial.filter_seed}",
            one.reason,
        )
        for one in results.failures
    ]
    caption = "Trials that raised an error; no mean includes them."
    return Table(caption, pd.DataFrame(lines, columns=["trial", "reason"])) if lines else None


def left_out_table(results: Results) -> Table | None:
    """The files of the folder that are no trials."""
    lines = [*results.left_out.items()]
    if len(lines) > _LISTED:
        lines[_LISTED:] = [(f"… and {len(lines) - _LISTED:,} more", "")]
    caption = "Files in the folder that are no trials of this sweep."
    return Table(caption, pd.DataFrame(lines, columns=["file", "why"])) if lines else None


def _marks(relations: Iterable[str], aim: Score | None) -> list[str]:
    """▼ smaller than the baseline's, ▲ larger: of shares the larger is better."""
    if aim is not None:
        relations = [{"better": "worse", "worse": "better"}.get(one, one) for one in relations]
    return [_MARKED.get(one, "") for one in relations]


def _lost(share: float, runs: int, low: float, high: float) -> str:
    return f"{percent(share)} of {runs} ({100 * low:.0f} to {100 * high:.0f})"


def _cost(ms: float, ratio: float) -> str:
    return f"{fixed(ms)} ({significant(ratio, 2)} ×)"


def _tenths(share: float) -> str:
    return percent(share, 1)


def _of_worlds(some: float, worlds: int) -> str:
    return "n/a" if math.isnan(some) else f"{some:.0f} of {worlds}"


def _score_columns(score: Score) -> Columns:
    """A score of whole runs, and how it compares with the baseline's."""
    share = score.unit == "share"
    scale, unit, of = (100, "points", "") if share else (1, score.unit, f" of {score.unit}")
    digits = {"share": 0, "m": 1, "steps": 1}.get(score.unit, 2)
    digits = digits if score.digits is None else score.digits
    mean = means(score.name, f".{digits}f", " %" * share, scale)
    columns: Columns = {score.words: lambda rows: [c.replace("inf", "never") for c in mean(rows)]}
    if not score.tested:
        return columns
    return {
        **columns,
        f"difference, {unit} (95 %)": apart(f"{score.name}_diff", f"+.{digits}f", scale=scale),
        f"p{of}, Holm": words(dashed(p_value), f"{score.name}_p_holm"),
    }


def _auroc(mean: float, low: float, high: float, steps: float, worlds: float) -> str:
    """An AUROC with its interval, or why there is none."""
    if math.isnan(worlds):
        return "n/a: gives no quality"
    if worlds == 0:
        return "n/a: no step is far off"
    if steps == 1:
        return "n/a: every step is far off"
    return estimated(Interval(mean, low, high)) + " (one world)" * math.isnan(low)


AUROC = words(_auroc, "auroc", "auroc_low", "auroc_high", "far_steps", "far_worlds")


def _far(signals: pd.DataFrame, of: str = "") -> pd.DataFrame:
    """Return AUROC with far_steps and far_worlds, whatever they are of."""
    return signals.rename(columns={f"{of}steps": "far_steps", f"{of}worlds": "far_worlds"})


def _signal_table(signals: pd.DataFrame, keys: list[str], steps: str, caption: str) -> Table | None:
    """AUROC of signals, a column each, by what they are of."""
    known = signals[signals["auroc"].notna()]
    if known.empty:
        return None
    names, lines = list(dict.fromkeys(known["signal"])), []
    for of, rows in known.groupby(keys, sort=False):
        cells = dict(zip(rows["signal"], AUROC(rows), strict=True))
        share = percent(rows["far_steps"].iloc[0], 1)
        lines.append([*of, *(cells.get(name, "–") for name in names), share])
    columns = [{"label": "method"}.get(key, key) for key in keys]
    return Table(caption, pd.DataFrame(lines, columns=[*columns, *names, steps]))
