"""The rows of a panel as tables of words."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from benchmarks.report.words import estimated, p_value
from benchmarks.tables.auroc import Auroc
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.pairing import Method
from benchmarks.tables.panels import Panel, short_name
from benchmarks.tables.plan_validity import validities
from benchmarks.tables.rivals import rivals
from benchmarks.tables.series import milliseconds_per_step
from benchmarks.tables.table_1 import state_name
from benchmarks.tables.text import fixed, percent
from benchmarks.trials.metrics import LEVELS

DETECTION = "Does the quality detect large errors?"


class Table(NamedTuple):
    """Cells with what they are of; the first one of a line names it."""

    caption: str
    header: list[str]
    lines: list[list[str]]


def verdict_table(panel: Panel) -> Table:
    """The errors at x_t, and how they compare with the baseline's."""
    at = panel.thresholds
    header = ["method", "error e (SD)", "difference to the baseline, 95 % interval", "wins"]
    header += ["Wilcoxon p, Holm", "lost runs, 95 % interval", "worlds", "ms per step"]
    lines = [
        [
            panel.labels[row.method],
            f"{fixed(row.error.mean)} ({fixed(row.error_sd)})",
            "baseline" if row.is_baseline else estimated(row.diff, "+.2f"),
            "–" if row.is_baseline else percent(row.win_rate),
            "–" if row.is_baseline else p_value(row.p_holm),
            f"{percent(row.lost.mean)} of {row.runs} "
            f"({100 * row.lost.low:.0f} to {100 * row.lost.high:.0f})",
            str(row.worlds),
            fixed(milliseconds_per_step(panel.records[row.method])),
        ]
        for row in panel.present
    ]
    caption = (
        "Error of the belief about the present, x[t], and how it compares with the baseline on the "
        f"same worlds. Lost: position error above {at.lost:g} {at.unit} on average over the last "
        f"{at.lost_steps} states; its interval counts every world as one case. ms per step: the "
        "method's own time, median over runs, of the machine that ran them."
    )
    return Table(f"{caption}{_with(panel)}", header, lines)


def glance_table(panels: Sequence[Panel]) -> Table:
    """The errors of all methods on all settings, each marked with its finding."""
    labels = _all_labels(panels)
    lines = []
    for panel in panels:
        cells = {panel.labels[row.method]: _marked(row) for row in panel.present}
        lines.append([_numbered(panel), *(cells.get(label, "–") for label in labels)])
    caption = (
        "Error e of x[t]. ▼ smaller than the baseline's, ▲ larger (95 % interval excludes 0 and "
        "p < 0.05 after Holm's correction for the tests of the same setting), ○ inconclusive."
    )
    return Table(caption, ["setting", *labels], lines)


def rival_tables(panel: Panel) -> list[Table]:
    """Every method compared with the paper's, run by run: at x_t, and at x_{t-L}."""
    error = {(row.method, row.offset): row.error.mean for row in panel.rows}
    tables = []
    for offset, apart in rivals(panel).items():
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


def calibration_table(panel: Panel) -> Table:
    """Calibration of the beliefs at every offset."""
    header = ["method", "belief about", f"energy score, {panel.thresholds.unit}"]
    header += ["inside 50 %", "80 %", "95 %", "NEES (3)", "entropy, nats", "in walls"]
    lines = []
    for row in panel.rows:
        scores = row.scores
        lines.append(
            [
                panel.labels[row.method],
                state_name(row.offset),
                fixed(scores["energy_score"].mean),
                *(estimated(scores[f"coverage_{at}"].percent, ".0f", " %") for at in LEVELS),
                estimated(scores["nees"], ".1f"),
                fixed(scores["entropy"].mean),
                percent(scores["wall_share"].mean, 1),
            ]
        )
    caption = (
        "Calibration, with 95 % intervals over worlds; n/a: the method's belief has no spread."
    )
    return Table(caption, header, lines)


def offsets_table(panel: Panel) -> Table:
    """The errors at every offset."""
    header = ["method", "belief about", "error e (SD)", "error, common states"]
    header += [f"position RMSE, {panel.thresholds.unit}", "heading RMSE, °"]
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


def detection_table(panel: Panel) -> Table | None:
    """The AUROC of each method; None if no method gives a quality and was far off, not always."""
    if all(math.isnan(row.detection.auroc.mean) for row in panel.present):
        return None
    far = panel.thresholds.far_words
    lines = []
    for row in panel.present:
        found = row.detection
        worlds = "n/a" if found.far_worlds is None else f"{found.far_worlds} of {row.worlds}"
        share = percent(found.far_steps, 1)
        lines.append([panel.labels[row.method], _auroc(found), share, worlds])
    caption = (
        f"AUROC of the quality at x[t] against {far}, over all steps of all worlds; 1: every far "
        "step has a smaller quality than every other, ½: no better than chance."
    )
    header = ["method", "AUROC, 95 % interval", f"steps with {far}", "in how many worlds"]
    return Table(caption, header, lines)


def detection_glance(panels: Sequence[Panel]) -> Table | None:
    """The AUROC of the methods that give a quality, on all settings; None if there is none."""
    if not any(map(detection_table, panels)):
        return None
    found = [{panel.labels[row.method]: row.detection for row in panel.present} for panel in panels]
    labels = [
        label
        for label in _all_labels(panels)
        if any(own[label].far_worlds is not None for own in found if label in own)
    ]
    lines = [
        [
            _numbered(panel),
            *(fixed(own[label].auroc.mean) if label in own else "–" for label in labels),
        ]
        for panel, own in zip(panels, found, strict=True)
    ]
    far = ", ".join(dict.fromkeys(panel.thresholds.far_words for panel in panels))
    caption = (
        f"AUROC of the quality at x[t] against {far}: 1 separates all far steps from the others, "
        "½ is chance; n/a where no step, or every one, is far off."
    )
    return Table(caption, ["setting", *labels], lines)


def validity_table(panels: Sequence[Panel]) -> Table | None:
    """The AUROC of what filters make of plans; None if none reads plans, or none conflicts."""
    rows = [row for row in validities(panels) if any(map(_tells, row.signals.values()))]
    if not rows:
        return None
    names = list(dict.fromkeys(name for row in rows for name in row.signals))
    lines = []
    for row in rows:
        first, *_ = row.panels
        found = next(filter(_tells, row.signals.values()))
        scenarios = ", ".join(panel.setting.scenario for panel in row.panels)
        lines.append(
            [
                ", ".join([scenarios, *first.title.split(", ")[1:]]),
                row.label,
                *(_auroc(row.signals.get(name, Auroc())) for name in names),
                percent(found.far_steps, 1),
            ]
        )
    caption = (
        "AUROC of what a filter makes of a plan against whether the plan, laid from the true pose, "
        "collides. feasible: share of the belief from which it does not; tempering: λ; "
        "log_evidence: of the belief with the plan over that without; log_evidence_20: its mean "
        "over 20 steps; valid: P(about this robot); quality: P(not lost) by the scans. 1: a plan "
        "in conflict always has the smaller value; ½: chance. The scenarios of a line are taken "
        "together."
    )
    header = ["scenarios", "method", *names, "steps in conflict"]
    return Table(caption, header, lines)


def _tells(found: Auroc) -> bool:
    return not math.isnan(found.auroc.mean)


def _with(panel: Panel) -> str:
    """The parameters that all methods share, where no title says them."""
    seen: dict[str, set[object]] = {}
    for method in panel.records:
        for name, value in method.params:
            seen.setdefault(name, set()).add(value)
    swept = dict(panel.swept)
    shared = [
        f"{name} {value}"
        for name, values in sorted(seen.items())
        for value in values
        if len(values) == 1 and name not in swept
    ]
    return f" All with {', '.join(shared)}." if shared else ""


def _marked(row: Comparison) -> str:
    """The error, with ▼ if smaller than the baseline's, ▲ if larger, ○ if inconclusive."""
    if math.isnan(row.diff.mean):
        mark = ""
    elif not row.significant:
        mark = " ○"
    else:
        mark = " ▼" if row.diff.mean < 0 else " ▲"
    return f"{fixed(row.error.mean)}{mark}"


def _auroc(found: Auroc) -> str:
    """The AUROC with its interval, or why there is none."""
    if found.far_worlds is None:
        return "n/a: gives no quality"
    if found.far_worlds == 0:
        return "n/a: no step is far off"
    if found.far_steps == 1:
        return "n/a: every step is far off"
    alone = " (in one world only: no interval)" if math.isnan(found.auroc.low) else ""
    return estimated(found.auroc) + alone


def _all_labels(panels: Sequence[Panel]) -> list[str]:
    return list(dict.fromkeys(label for panel in panels for label in panel.labels.values()))


def _numbered(panel: Panel) -> str:
    return f"{panel.number}. {panel.title}"


def _told(method: Method) -> str:
    words = [f"{name}={value}" for name, value in method.params]
    return " ".join([short_name(method.localizer), *words])
