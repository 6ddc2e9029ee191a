"""Tables of a panel: frames of words, which pandas writes as HTML, Markdown, text and LaTeX."""

import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from html import escape
from typing import Any, NamedTuple

import pandas as pd

from benchmarks.report.verdict import AT_ALL_LOOKS, plug_in_labels
from benchmarks.sweeps.results import Results
from benchmarks.tables.panels import Panel, common_words
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
Writer = Callable[[pd.DataFrame], Iterable[Any]]
Columns = Mapping[str, str | Writer]  # by title: a column of a frame, or how rows are told


class Table(NamedTuple):
    """A frame of words; the first column names a line."""

    name: str  # of its caption in captions.jinja
    frame: pd.DataFrame
    strong: Collection[tuple[int, int]] = ()  # cells in bold, by line and column
    about: Any = None  # what the caption is told

    def written(self, words: Callable[[str], str], strong: str) -> pd.DataFrame:
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

    def text(self, style: str = "simple") -> str:
        """As text, in a format of tabulate."""
        align = ("left", *["right"] * (self.frame.shape[1] - 1))
        frame = self.frame.astype(str)
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
    return f"{fixed(mean)} ({fixed(sd)})"


_tenths = partial(percent, digits=1)
_METHOD: Columns = {"method": "label", "belief about": words(state_name, "offset")}


def verdict_table(panel: Panel) -> Table:
    """The methods, the best first, and how they compare with the baseline."""
    rows, aim, unit = panel.ranked, panel.aim, panel.unit
    plug_ins = plug_in_labels(panel)
    error: Columns = {f"error e, {unit} (SD)": words(_mean_sd, "error", "error_sd")}
    relation: Columns = {"verdict": "relation"}
    if panel.rule:
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
        numbers = {
            **error,
            "difference to the baseline (95 %)": apart("diff"),
            **relation,
            "wins": words(dashed(percent), "win_rate"),
            "p, Holm": words(dashed(p_value), "p_holm"),
            "lost runs (95 %)": words(_lost, "lost_rate", "runs", "lost_low", "lost_high"),
        }
    else:
        numbers = {**_score_columns(aim), **relation}
        if panel.world == "world":  # on a log, the table of best clusters has the error
            numbers |= {**error, "difference of e (95 %)": apart("diff")}
    columns: Columns = {
        "method": lambda rows: [
            label + (" (baseline)" if itself else " (plug-in)" if label in plug_ins else "")
            for label, itself in zip(rows["label"], rows["is_baseline"], strict=True)
        ],
        **numbers,
        "ms per step (ratio)": words(
            lambda ms, ratio: f"{fixed(ms)} ({significant(ratio, 2)} ×)", "ms_per_step", "cost"
        ),
        f"{panel.world}s": "worlds",
    }
    best = [n for n, order in enumerate(rows["order"]) if order == rows["order"].iloc[0]]
    strong = [(n, column) for n in best for column in (0, 1)]
    return Table("verdict", of_rows(rows, columns), strong, panel)


def journey_table(panel: Panel, group: ScoreGroup) -> Table | None:
    """Scores of whole runs, but for what the verdict tells; None if the panel has none."""
    rows, ranked_by = panel.ranked, None if panel.rule else panel.aim
    scores = [score for score in group.scores if score.name in rows and score is not ranked_by]
    if not scores:
        return None
    columns: dict[str, str | Writer] = {"method": "label"}
    for score in scores:
        columns |= _score_columns(score)
    tested = any(score.tested for score in scores)
    return Table(group.name, of_rows(rows, columns), about=tested)


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
    scores = dict.fromkeys(panel.aim.words if panel.aim else "error e of x[t]" for panel in panels)
    about = {"scores": scores, "common": common_words({panel.setting: None for panel in panels})}
    return Table("glance", pd.DataFrame(lines, columns=["setting", *labels]), strong, about)


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
    return Table("calibration", of_rows(panel.rows, columns))


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
        "AUROC (95 %)": means("auroc"),
        f"steps with {far}": words(_tenths, "far_steps"),
        f"in how many {panel.world}s": words(
            lambda k, n: "n/a" if math.isnan(k) else f"{k:.0f} of {n}", "far_worlds", "worlds"
        ),
    }
    return Table("detection", of_rows(rows, columns), about=far)


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
    return Table("failed", pd.DataFrame(lines, columns=["trial", "reason"])) if lines else None


def _marks(relations: Iterable[str], aim: Score | None) -> list[str]:
    """▼ smaller than the baseline's, ▲ larger: of shares the larger is better."""
    if aim is not None:
        relations = [{"better": "worse", "worse": "better"}.get(one, one) for one in relations]
    return [_MARKED.get(one, "") for one in relations]


def _lost(share: float, runs: int, low: float, high: float) -> str:
    return f"{percent(share)} of {runs} ({100 * low:.0f} to {100 * high:.0f})"


def _score_columns(score: Score) -> Columns:
    """A score of whole runs, and how it compares with the baseline's."""
    share = score.unit == "share"
    scale, unit = (100, "percentage points") if share else (1, score.unit)
    of = "" if share else f" of {score.words.partition(',')[0]}"
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


_VARIANCES = {"var_x": ("var x", 1), "var_y": ("var y", 1), "var_cos": ("var cos θ", 3),
    "var_sin": ("var sin θ", 3)}  # fmt: skip
_PRINTED = ("error", "error_sd", "entropy", *_VARIANCES)
TABLE_1 = {  # as printed (Taniguchi, Fukawa & Yamakawa 2024)
    "deq-mcl": (20.95, 17.66, 7.82, 419.92, 290.04, 0.09, 0.07),
    "mcl-smoother": (22.88, 20.01, 8.88, 977.39, 611.06, 0.14, 0.11),
    "mcl-map": (25.00, 18.38, 9.69, 792.28, 616.85, 0.17, 0.16),
    "mcl": (26.17, 22.00, 9.81, 966.93, 591.79, 0.19, 0.16),
}


def table_1(rows: pd.DataFrame, *, variances: bool = False) -> Table:
    """Our Table 1, of one panel's ``results_table``, with the paper's values beside ours."""

    def printed(form: str) -> Writer:
        def write(method: str, offset: int) -> str:
            known = method in TABLE_1 and offset <= 0
            numbers = dict(zip(_PRINTED, TABLE_1[method], strict=True)) if known else {}
            return form.format_map(numbers) if known else ""

        return words(write, "method", "offset")

    baseline = short_name(rows["baseline"].iloc[0]) if len(rows) else ""
    columns: dict[str, str | Writer] = {
        "method": words(short_name, "method"),
        "of": words(state_name, "offset"),
        f"error - {baseline}'s, 95 %": apart("diff"),
        "error (SD)": words(_mean_sd, "error", "error_sd"),
        "paper": printed("{error:.2f} ({error_sd:.2f})"),
        "entropy": words(fixed, "entropy"),
        "paper's": printed("{entropy:.2f}"),
        "in walls": words(_tenths, "wall_share"),
    }
    for name, (title, digits) in _VARIANCES.items() if variances else ():
        columns[title] = words(partial(fixed, digits=digits), name)
        columns[f"paper's {title}"] = printed(f"{{{name}:g}}")
    return Table("", of_rows(rows, columns))
