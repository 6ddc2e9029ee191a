"""Tables of a panel: frames of words, which pandas writes as HTML, Markdown, text and LaTeX.

A column is a list of cells, in the order of the rows that it is made of.
"""

import math
import re
from collections.abc import Callable, Collection, Sequence
from functools import partial
from html import escape
from typing import Any, NamedTuple

import pandas as pd

from benchmarks.report.verdict import AT_ALL_LOOKS, plug_in_labels
from benchmarks.sweeps.results import Results
from benchmarks.tables import estimated, fixed, p_value, percent, rounded, short_name, state_name
from benchmarks.tables.panels import Panel, common_words
from benchmarks.tables.stats import Interval
from benchmarks.trials.scores import LEVELS, Score, ScoreGroup

_MARKED = {"better": "▼", "worse": "▲", "inconclusive": "○", "open": "○"}
_MARKED |= dict.fromkeys(("equivalent", "equal"), "=")
_OF_SHARES = {"better": "worse", "worse": "better"}  # the larger is better


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
    match = re.fullmatch(r"([+−\d][^()]*?) (\([^()]*\))", cell)
    return (match[1], match[2]) if match else (cell, "")


def html_cell(text: str) -> str:
    """Return a cell as HTML."""
    value, ends = parted(text)
    if value[:1] in "+−0123456789":  # a number and its unit stay together
        value = value.replace(" ", "\u00a0")
    return f"{escape(value)} <span>{escape(ends)}</span>" if ends else escape(value)


def words(rows: pd.DataFrame, write: Callable[..., str], *names: str) -> list[str]:
    """Write the values of columns as text, row by row."""
    return [write(*values) for values in zip(*(rows[name] for name in names), strict=True)]


def means(
    rows: pd.DataFrame, name: str, form: str = ".2f", unit: str = "", scale: float = 1
) -> list[str]:
    """Write means with the intervals of name_low and name_high, if there are any."""

    def write(*ends: float) -> str:
        return estimated(Interval(*(scale * float(end) for end in ends)), form, unit)

    ends = [end for end in (name, f"{name}_low", f"{name}_high") if end in rows]
    return words(rows, write, *ends)


def differences(
    rows: pd.DataFrame, name: str, form: str = "+.2f", unit: str = "", scale: float = 1
) -> list[str]:
    """Write differences from the baseline likewise."""
    cells = zip(rows["is_baseline"], means(rows, name, form, unit, scale), strict=True)
    return ["baseline" if itself else cell for itself, cell in cells]


def dashed(write: Callable[[float], str]) -> Callable[[float], str]:
    """Return ``write``, but with – for NaN."""
    return lambda value: "–" if math.isnan(value) else write(value)


_tenths = partial(percent, digits=1)


def _mean_sd(mean: float, sd: float) -> str:
    return f"{fixed(mean)} ({fixed(sd)})"


def verdict_table(panel: Panel) -> Table:
    """The methods, the best first, and how they compare with the baseline."""
    rows, aim, unit = panel.ranked, panel.aim, panel.first.unit
    plug_ins = plug_in_labels(panel)
    names = [
        label + (" (baseline)" if itself else " (plug-in)" if label in plug_ins else "")
        for label, itself in zip(rows["label"], rows["is_baseline"], strict=True)
    ]
    error = {f"error e, {unit} (SD)": words(rows, _mean_sd, "error", "error_sd")}
    relation = {"verdict": list(rows["relation"])}
    if panel.rule:
        decided = differences(rows, "decided", "+.1f", " points" if aim else " %", 100)
        decided = [re.sub(r" \(.*inf.*\)", "", cell) for cell in decided]
        numbers = {
            f"difference to the baseline ({AT_ALL_LOOKS})": decided,
            **relation,
            "after worlds": words(rows, dashed("{:.0f}".format), "decided_worlds"),
            **({aim.words: words(rows, percent, "score")} if aim else error),
        }
    elif aim is None:
        numbers = {
            **error,
            "difference to the baseline (95 %)": differences(rows, "diff"),
            **relation,
            "wins": words(rows, dashed(percent), "win_rate"),
            "p, Holm": words(rows, dashed(p_value), "p_holm"),
            "lost runs (95 %)": words(rows, _lost, "lost_rate", "runs", "lost_low", "lost_high"),
        }
    else:
        numbers = {**_score_columns(rows, aim), **relation}
        if panel.world == "world":  # on a log, the table of best clusters has the error
            numbers |= {**error, "difference of e (95 %)": differences(rows, "diff")}
    costs = zip(rows["ms_per_step"], rows["cost"], strict=True)
    timed = [f"{fixed(ms)} ({rounded(ratio, 2)} ×)" for ms, ratio in costs]
    numbers |= {"ms per step (ratio)": timed, f"{panel.world}s": words(rows, str, "worlds")}
    best = [n for n, order in enumerate(rows["order"]) if order == rows["order"].iloc[0]]
    strong = [(n, column) for n in best for column in (0, 1)]
    return Table("verdict", pd.DataFrame({"method": names, **numbers}), strong, panel)


def _lost(share: float, runs: int, low: float, high: float) -> str:
    return f"{percent(share)} of {runs} ({100 * low:.0f} to {100 * high:.0f})"


def journey_table(panel: Panel, group: ScoreGroup) -> Table | None:
    """Scores of whole runs, but for what the verdict tells; None if the panel has none."""
    rows, ranked_by = panel.ranked, None if panel.rule else panel.aim
    scores = [score for score in group.scores if score.name in rows and score is not ranked_by]
    if not scores:
        return None
    columns = {"method": list(rows["label"])}
    for score in scores:
        columns |= _score_columns(rows, score)
    tested = any(score.tested for score in scores)
    return Table(group.name, pd.DataFrame(columns), about=tested)


def _score_columns(rows: pd.DataFrame, score: Score) -> dict[str, list[str]]:
    """A score of whole runs, and how it compares with the baseline's, by title of the column."""
    name, share = score.name, score.unit == "share"
    scale, unit = (100, "percentage points") if share else (1, score.unit)
    digits = {"share": 0, "m": 1, "steps": 1}.get(score.unit, 2)
    digits = digits if score.digits is None else score.digits
    numbers = means(rows, name, f".{digits}f", " %" * share, scale)
    columns = {score.words: [cell.replace("inf", "never") for cell in numbers]}
    if score.tested:
        of = "" if share else f" of {score.words.partition(',')[0]}"
        cells = differences(rows, f"{name}_diff", f"+.{digits}f", scale=scale)
        columns[f"difference, {unit} (95 %)"] = cells
        columns[f"p{of}, Holm"] = words(rows, dashed(p_value), f"{name}_p_holm")
    return columns


def glance_table(panels: Sequence[Panel]) -> Table:
    """What all methods are ranked by, on all settings, the best in bold."""
    labels = list(dict.fromkeys(label for panel in panels for label in panel.present["label"]))
    lines, strong = [], []
    for n, panel in enumerate(panels):
        rows, tell = panel.ranked, percent if panel.aim else fixed
        turned = _OF_SHARES if panel.aim else {}
        cells = zip(rows["label"], rows["score"], rows["relation"], strict=True)
        text = {
            label: f"{tell(score)} {_MARKED.get(turned.get(relation, relation), '')}".rstrip()
            for label, score, relation in cells
        }
        best = rows.loc[rows["order"] == rows["order"].iloc[0], "label"]
        strong += [(n, 1 + labels.index(label)) for label in best]
        lines.append([f"{panel.number}. {panel.where}", *(text.get(name, "–") for name in labels)])
    scores = dict.fromkeys(panel.aim.words if panel.aim else "error e of x[t]" for panel in panels)
    about = {"scores": scores, "common": common_words({panel.setting: None for panel in panels})}
    return Table("glance", pd.DataFrame(lines, columns=["setting", *labels]), strong, about)


def calibration_table(panel: Panel) -> Table:
    """Calibration of the beliefs at every offset."""
    rows = panel.rows
    columns = {
        "method": list(rows["label"]),
        "belief about": words(rows, state_name, "offset"),
        f"energy score, {panel.first.unit}": words(rows, fixed, "energy_score"),
        **{f"inside {at} %": means(rows, f"coverage_{at}", ".0f", " %", 100) for at in LEVELS},
        "NEES (3)": words(rows, nees_words, "nees", "nees_low", "nees_high"),
        "entropy, nats": [cell.replace("-", "−") for cell in words(rows, fixed, "entropy")],
        "in walls": words(rows, _tenths, "wall_share"),
    }
    return Table("calibration", pd.DataFrame(columns))


def nees_words(*ends: float) -> str:
    """A NEES with one decimal; a large one, which is far from 3 anyhow, with three digits."""
    if not ends[0] >= 100:
        return estimated(Interval(*ends), ".1f")
    return estimated(Interval(*(float(f"{end:.3g}") for end in ends)), ",.0f")


def detection_table(panel: Panel) -> Table | None:
    """The AUROC of each method; None if none has one: no quality, or no step far, or all."""
    rows, first = panel.present, panel.first
    far = f"e > {first.thresholds.far:g} {first.unit}"
    if rows["auroc"].isna().all():
        return None

    def of_worlds(k: float, n: int) -> str:
        return "n/a" if math.isnan(k) else f"{k:.0f} of {n}"

    columns = {
        "method": list(rows["label"]),
        "AUROC (95 %)": means(rows, "auroc"),
        f"steps with {far}": words(rows, _tenths, "far_steps"),
        f"in how many {panel.world}s": words(rows, of_worlds, "far_worlds", "worlds"),
    }
    return Table("detection", pd.DataFrame(columns), about=far)


def failed_table(results: Results) -> Table | None:
    """The trials that failed, and why."""
    failures = ((failure.trial, failure.reason) for failure in results.failures)
    lines = [
        (f"{t.localizer} on {t.scenario}, world {t.trial}, filter seed {t.filter_seed}", reason)
        for t, reason in failures
    ]
    return Table("failed", pd.DataFrame(lines, columns=["trial", "reason"])) if lines else None


_PRINTED = ("error", "error_sd", "entropy", "var_x", "var_y", "var_cos", "var_sin")
_VARIANCES = {"var_x": "var x", "var_y": "var y", "var_cos": "var cos θ", "var_sin": "var sin θ"}
TABLE_1 = {  # as printed (Taniguchi, Fukawa & Yamakawa 2024)
    "deq-mcl": (20.95, 17.66, 7.82, 419.92, 290.04, 0.09, 0.07),
    "mcl-smoother": (22.88, 20.01, 8.88, 977.39, 611.06, 0.14, 0.11),
    "mcl-map": (25.00, 18.38, 9.69, 792.28, 616.85, 0.17, 0.16),
    "mcl": (26.17, 22.00, 9.81, 966.93, 591.79, 0.19, 0.16),
}


def table_1(rows: pd.DataFrame, *, variances: bool = False, paper: bool = True) -> Table:
    """Our Table 1, of one panel's ``results_table``, with the ``paper``'s values beside ours."""

    def printed(form: str) -> list[str]:
        return [
            form.format_map(dict(zip(_PRINTED, TABLE_1[method], strict=True)))
            if method in TABLE_1 and offset <= 0
            else ""
            for method, offset in zip(rows["method"], rows["offset"], strict=True)
        ]

    baseline = short_name(rows["baseline"].iloc[0]) if len(rows) else ""
    columns = {
        "method": words(rows, short_name, "method"),
        "of": words(rows, state_name, "offset"),
        f"error - {baseline}'s, 95 %": differences(rows, "diff"),
        "error (SD)": words(rows, _mean_sd, "error", "error_sd"),
        "paper": printed("{error:.2f} ({error_sd:.2f})"),
        "entropy": words(rows, fixed, "entropy"),
        "paper's": printed("{entropy:.2f}"),
        "in walls": words(rows, _tenths, "wall_share"),
    }
    for name, title in _VARIANCES.items() if variances else ():
        digits = 1 if name in ("var_x", "var_y") else 3
        columns[title] = [fixed(value, digits) for value in rows[name]]
        columns[f"paper's {title}"] = printed(f"{{{name}:g}}")
    shown = [name for name in columns if paper or not name.startswith("paper")]
    return Table("", pd.DataFrame(columns)[shown])
