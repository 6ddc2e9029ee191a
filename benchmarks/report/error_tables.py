"""The errors of a panel as tables of words, and how they compare."""

import math
from collections.abc import Sequence

from benchmarks.report import decisions
from benchmarks.report.charts import score_cells, score_header
from benchmarks.report.tables import Table, all_labels, numbered
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.panels import Panel
from benchmarks.tables.text import (
    capital,
    estimated,
    fixed,
    p_value,
    percent,
    short_name,
    significant,
    state_name,
)
from benchmarks.trials.spec import Method
from localizers.registry import LOCALIZER


def verdict_table(panel: Panel) -> Table:
    """The methods, the best first, and how they compare with the baseline.

    By the share of runs that succeed, if the panel is about one, and by the errors at x_t.
    """
    rows = panel.ranked
    stopping = panel.rule is not None
    headed = decisions.header(panel) if stopping else _headed(panel)
    header = ["method", *headed, "ms per step (baseline = 1)", "worlds"]
    lines = [
        [
            marked_label(panel, row),
            *(decisions.cells(row) if stopping else _compared(row)),
            f"{fixed(row.milliseconds)} ({significant(row.cost, 2)} ×)",
            str(row.worlds),
        ]
        for row in rows
    ]
    best = [line for line, row in enumerate(rows) if row.worse == rows[0].worse]
    said = decisions.caption(panel) if stopping else _captioned(panel)
    return Table(
        f"{said} ms per step: the method's own time, median over runs, of the machine that ran "
        f"them.{_with(panel)}",
        header,
        lines,
        strong=[(line, column) for line in best for column in (0, 1)],
        own=[line for line, row in enumerate(rows) if LOCALIZER.is_plug_in(row.method.name)],
    )


def _headed(panel: Panel) -> list[str]:
    error = f"error e, {panel.unit} (SD)"
    if panel.aim is not None:
        return [*score_header(panel.aim), error, "difference of e, 95 % interval"]
    apart = "difference to the baseline, 95 % interval"
    return [error, apart, "wins", "Wilcoxon p, Holm", "lost runs, 95 % interval"]


def _compared(row: Comparison) -> list[str]:
    errors = [
        f"{fixed(row.error.mean)} ({fixed(row.error_sd)})",
        "baseline" if row.is_baseline else estimated(row.diff, "+.2f"),
    ]
    if row.aim is not None:
        return [*score_cells(row, row.aim), *errors]
    return [
        *errors,
        "–" if row.is_baseline else percent(row.win_rate),
        "–" if row.is_baseline else p_value(row.p_holm),
        f"{percent(row.lost.mean)} of {row.runs} "
        f"({100 * row.lost.low:.0f} to {100 * row.lost.high:.0f})",
    ]


def _captioned(panel: Panel) -> str:
    at = panel.thresholds
    if panel.aim is not None:
        return (
            f"{capital(panel.aim.words)}: share of runs, the largest first and in bold, and how it "
            "compares with the baseline on the same worlds. Error e of the belief about the "
            "present, x[t], compared in the same way."
        )
    return (
        "Error of the belief about the present, x[t], the smallest first and in bold, and how it "
        f"compares with the baseline on the same worlds. Lost: position error above {at.lost:g} "
        f"{panel.unit} on average over the last {at.lost_steps} states; its interval counts every "
        "world as one case."
    )


def marked_label(panel: Panel, row: Comparison) -> str:
    """What a method is called, and whether it is the baseline or a plug-in."""
    label = panel.labels[row.method]
    if row.is_baseline:
        return f"{label} (baseline)"
    return f"{label} (plug-in)" if LOCALIZER.is_plug_in(row.method.name) else label


def glance_table(panels: Sequence[Panel]) -> Table:
    """What all methods are ranked by, on all settings, marked with findings, the best in bold."""
    labels = all_labels(panels)
    lines: list[list[str]] = []
    strong: list[tuple[int, int]] = []
    for panel in panels:
        cells = {panel.labels[row.method]: _marked(row) for row in panel.ranked}
        least = panel.ranked[0].worse
        best = {panel.labels[row.method] for row in panel.ranked if row.worse == least < math.inf}
        strong += [(len(lines), 1 + place) for place, name in enumerate(labels) if name in best]
        lines.append([numbered(panel), *(cells.get(label, "–") for label in labels)])
    aims = dict.fromkeys(panel.aim for panel in panels)
    shown = [
        "Error e of x[t], the smallest of a setting in bold."
        if aim is None
        else f"Share of runs, the largest of a setting in bold: {aim.words}."
        for aim in aims
    ]
    marks = (
        "▼ smaller than the baseline's, ▲ larger (95 % interval excludes 0 and p < 0.05 after "
        "Holm's correction for the tests of the same setting), ○ inconclusive."
    )
    if any(panel.rule is not None for panel in panels):
        marks = (
            "▼ smaller than the baseline's by more than the margin, ▲ larger, = the same within "
            "the margin, ○ open. Each number is of the worlds that the method needed."
        )
    return Table(f"{' '.join(shown)} {marks}", ["setting", *labels], lines, strong=strong)


def rival_tables(panel: Panel) -> list[Table]:
    """Every method compared with the paper's, run by run: at x_t, and at x_{t-L}."""
    error = {(row.method, row.offset): row.error.mean for row in panel.rows}
    tables = []
    for offset, apart in panel.rivals.items():
        against = next(iter(apart.values()))
        caption = (
            f"Differences of the errors of {state_name(offset)} on the same worlds, with 95 % "
            "intervals; negative: better."
        )
        header = ["method", f"error e of {state_name(offset)}"]
        header += [f"difference to {panel.labels[rival]}" for rival in against]
        lines = [
            [
                panel.labels[method],
                fixed(error[method, offset]),
                *("–" if m == method else estimated(own[m], "+.2f") for m in against),
            ]
            for method, own in apart.items()
        ]
        tables.append(Table(caption, header, lines))
    return tables


def gap_table(panel: Panel) -> Table | None:
    """The errors on the limits' worlds, each limit before its methods; None if there is none."""
    header = ["method", "belief about", "error e", "SD between runs on a world"]
    header += ["gap to the limit, 95 % interval", "worlds"]
    lines = [
        [
            f"limit: {_told(row.limit)}" if row.method == row.limit else panel.labels[row.method],
            state_name(row.offset),
            fixed(row.error),
            fixed(row.seed_sd),
            "–" if row.method == row.limit else estimated(row.gap, "+.2f"),
            str(row.worlds),
        ]
        for row in panel.gaps
    ]
    caption = (
        "Error minus the limit's on the same worlds. Below each limit are the methods with its "
        "target. The limit is what many more particles would give, as far as its own runs agree."
    )
    return Table(caption, header, lines) if lines else None


def offsets_table(panel: Panel) -> Table:
    """The errors at every offset."""
    header = ["method", "belief about", "error e (SD)", "error, common states"]
    header += [f"position RMSE, {panel.unit}", "heading RMSE, °"]
    header += ["difference to the baseline's x[t]"]
    lines = [
        [
            panel.labels[row.method],
            state_name(row.offset),
            f"{fixed(row.error.mean)} ({fixed(row.error_sd)})",
            fixed(row.scores["error_window"].mean),
            fixed(row.scores["position_rmse"].mean),
            fixed(math.degrees(row.scores["heading_rmse"].mean), 1),
            "baseline" if row.is_baseline else estimated(row.diff, "+.2f"),
        ]
        for row in panel.rows
    ]
    caption = "Errors of the beliefs about the present, the past and the future."
    return Table(caption, header, lines)


def _with(panel: Panel) -> str:
    """The parameters that all methods which take them have in common, where no title names them."""
    methods, shared = list(panel.records), []
    for name in sorted({name for method in methods for name in method.params}):
        takers = {method.name for method in methods if name in method.params}
        # ... differs from every value: one that was not given it has the default
        held = [method.params.get(name, ...) for method in methods if method.name in takers]
        if len(held) > 1 and len(set(held)) == 1 and name not in panel.swept:
            shared.append(f"{name} {held[0]}")
    return f" Parameters of all methods that take them: {', '.join(shared)}." if shared else ""


def _marked(row: Comparison) -> str:
    """The error or share, with ▼ if smaller than the baseline's, ▲ if larger, ○ if inconclusive.

    "=" where the two are known to differ by less than a margin.
    """
    own = row.standing
    if row.decision is not None and row.decision.relation == "equivalent":
        mark = " ="
    elif math.isnan(own.diff.mean):
        mark = ""
    elif not row.differs:
        mark = " ○"
    else:
        mark = " ▼" if own.diff.mean < 0 else " ▲"
    return f"{fixed(own.value.mean) if row.aim is None else percent(own.value.mean)}{mark}"


def _told(limit: Method) -> str:
    return " ".join([short_name(limit.name), *(f"{k}={v}" for k, v in limit.params.items())])
