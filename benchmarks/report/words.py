"""Numbers and findings in words."""

import math
from collections.abc import Sequence

import numpy as np

from benchmarks.report.panels import Panel, full_name
from benchmarks.sweeps.results import Results
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.pairing import Record, world_scores
from benchmarks.tables.stats import paired_bootstrap
from benchmarks.tables.table_1 import state_name
from benchmarks.tables.text import fixed
from benchmarks.trials.scoring import LEVELS

GLANCE = (
    "Error e of x[t]. ▼ smaller than the baseline's, ▲ larger (95 % interval without 0 and "
    "Holm's p < 0.05), ○ cannot be told."
)
RIVALS = "Differences of the errors on the same worlds, with 95 % intervals; negative: better."
GAP = (
    "Error minus the limit's on the same worlds. The limit is what ever more particles come to, "
    "as far as its own runs agree."
)
WORTH = "Calibration, with 95 % intervals over worlds; n/a: a method without a spread."
FEW = 20  # worlds below which an interval is called rough
_ALPHA = 0.05


def signed(value: float) -> str:
    """A difference with its sign, a true minus."""
    return "n/a" if math.isnan(value) else f"{value:+.2f}".replace("-", "−")


def percent(share: float, digits: int = 0) -> str:
    """A share in per cent, or n/a."""
    return "n/a" if math.isnan(share) else f"{100 * share:.{digits}f} %"


def interval(low: float, high: float, digits: int = 2) -> str:
    """An interval, or nothing."""
    if math.isnan(low):
        return ""
    return f"{low:.{digits}f} to {high:.{digits}f}".replace("-", "−")


def p_value(p: float) -> str:
    """A p-value with two digits."""
    if math.isnan(p):
        return "n/a"
    return "< 0.0001" if p < 1e-4 else f"{p:.2g}"


def verdict_table(panel: Panel) -> tuple[list[str], list[list[str]]]:
    """Header and lines of the comparison at x_t."""
    header = ["method", "error e (SD)", "difference to the baseline, 95 % interval"]
    header += ["wins", "Wilcoxon p, Holm", "lost, 95 % interval", "worlds"]
    lines = []
    for row in panel.present:
        itself = row.method == row.baseline
        difference = f"{signed(row.diff)} ({interval(row.diff_low, row.diff_high)})"
        lines.append(
            [
                panel.labels[row.method],
                f"{fixed(row.error)} ({fixed(row.error_sd)})",
                "baseline" if itself else difference.replace(" ()", ""),
                "–" if itself else percent(row.win_rate),
                "–" if itself else p_value(row.p_holm),
                f"{percent(row.lost_rate)} ({_percents(row)})",
                str(row.worlds),
            ]
        )
    return header, lines


def glance_table(panels: Sequence[Panel]) -> tuple[list[str], list[list[str]]]:
    """Header and lines of the errors of all methods on all settings, with a mark by the finding."""
    labels = list(dict.fromkeys(label for panel in panels for label in panel.labels.values()))
    lines = []
    for panel in panels:
        by_label = {panel.labels[row.method]: row for row in panel.present}
        cells = [
            f"{fixed(by_label[k].error)}{_mark(by_label[k])}" if k in by_label else "–"
            for k in labels
        ]
        lines.append([f"{panel.number}. {panel.title}", *cells])
    return ["setting", *labels], lines


def calibration_table(panel: Panel) -> tuple[list[str], list[list[str]]]:
    """Header and lines of what the beliefs are worth, at every offset."""
    header = ["method", "belief about", "energy score, px", "inside 50 %", "80 %", "95 %"]
    header += ["NEES (3)", "entropy, nats", "in walls"]
    lines = []
    for row in panel.rows:
        means, own = row.means, panel.own(row.method)
        inside = [f"coverage_{level}" for level in LEVELS]
        lines.append(
            [
                panel.labels[row.method],
                state_name(row.offset),
                fixed(means["energy_score"]),
                *(_ranged(own, name, row.offset, scale=100, unit=" %") for name in inside),
                _ranged(own, "nees", row.offset, digits=1),
                fixed(means["entropy"]),
                percent(means["wall_share"], 1),
            ]
        )
    return header, lines


def offsets_table(panel: Panel) -> tuple[list[str], list[list[str]]]:
    """Header and lines of the errors at every offset."""
    header = ["method", "belief about", "error e (SD)", "error, common states"]
    header += ["position RMSE, px", "heading RMSE, °", "difference to the baseline's x[t]"]
    lines = []
    for row in panel.rows:
        difference = f"{signed(row.diff)} ({interval(row.diff_low, row.diff_high)})"
        lines.append(
            [
                panel.labels[row.method],
                state_name(row.offset),
                f"{fixed(row.error)} ({fixed(row.error_sd)})",
                fixed(row.means["error_window"]),
                fixed(row.means["position_rmse"]),
                fixed(math.degrees(row.means["heading_rmse"]), 1),
                "baseline" if math.isnan(row.diff) else difference.replace(" ()", ""),
            ]
        )
    return header, lines


def findings(panel: Panel) -> list[str]:
    """A sentence per method on how it compares with its baseline, and what to mind."""
    compared = [row for row in panel.present if row.method != row.baseline]
    sentences = [_capital(_finding(row, panel)) for row in compared]
    worlds = max((row.worlds for row in panel.present), default=0)
    if 2 <= worlds < FEW:
        sentences.append(
            f"These are only {worlds} worlds: bootstrap intervals of so few are somewhat too "
            "narrow, and small differences cannot be told."
        )
    blind = _blind(panel.present)
    return [*sentences, blind] if blind else sentences


def overview(results: Results, panels: Sequence[Panel]) -> str:
    """What was run, in one paragraph."""
    methods = dict.fromkeys(row.method.localizer for panel in panels for row in panel.rows)
    named = ", ".join(full_name(name) for name in methods) or "none"
    worlds = {row.worlds for panel in panels for row in panel.rows}
    seeds = {record["trial"]["filter_seed"] for record in results.records}
    several = f", each with {len(seeds)} filter seeds" if len(seeds) > 1 else ""
    count = _range(worlds, "world", "worlds")
    settings = _range({len(panels)}, "setting", "settings")
    return (
        f"{_range({len(methods)}, 'localizer', 'localizers')} ({named}) on {settings}, "
        f"{count} per setting{several}. On the same world all methods see the same true path and "
        "the same scans, and filters start from the same cloud: differences are taken world by "
        f"world, with {full_name(results.baseline)} as the baseline."
    )


def progress(results: Results) -> str:
    """How far the sweep has come."""
    done = results.planned - len(results.failures) - results.missing
    words = f"{done} of {results.planned} trials finished"
    if results.failures:
        words += f", {len(results.failures)} failed"
    if results.missing:
        words += f", {results.missing} not run yet: this report is partial"
    return words + "."


def _ranged(
    records: Sequence[Record],
    name: str,
    offset: int,
    *,
    scale: float = 1,
    unit: str = "",
    digits: int = 0,
) -> str:
    """A score's mean over worlds with its bootstrap interval."""
    values = scale * np.array(list(world_scores(records, name, offset).values()))
    mean = float(values.mean())
    if math.isnan(mean):
        return "n/a"
    ends = interval(*paired_bootstrap(values), digits)
    return f"{mean:.{digits}f}{unit} ({ends})".replace(" ()", "")


def _mark(row: Comparison) -> str:
    """▼ smaller than the baseline's, ▲ larger, ○ not to be told; nothing for the baseline."""
    if math.isnan(row.diff):
        return ""
    if row.diff_low <= 0 <= row.diff_high or not row.p_holm < _ALPHA:
        return " ○"
    return " ▼" if row.diff < 0 else " ▲"


def _finding(row: Comparison, panel: Panel) -> str:
    name, other = full_name(row.method.localizer), full_name(row.baseline.localizer)
    if row.method.localizer != panel.labels[row.method]:
        name = f"{name} ({panel.labels[row.method]})"
    if math.isnan(row.diff):
        return f"{name} and {other} have no finished world in common: nothing is compared."
    if math.isnan(row.diff_low):
        return f"{name}: {signed(row.diff)} against {other}, but one world decides nothing."
    if row.diff == 0 and row.diff_low == row.diff_high == 0:
        return f"{name} has exactly the error of {other} at x[t] in every world."
    numbers = (
        f"({signed(row.diff)}, 95 % interval {interval(row.diff_low, row.diff_high)}; smaller in "
        f"{percent(row.win_rate)} of {row.paired_worlds} worlds; p = {p_value(row.p_holm)})"
    ).replace("p = <", "p <")
    if row.diff_low <= 0 <= row.diff_high:
        return f"{name} cannot be told from {other} by these worlds {numbers}."
    better = "smaller" if row.diff < 0 else "larger"
    if row.p_holm >= _ALPHA:
        return (
            f"{name} has a {better} mean error than {other}, but the signed-rank test does not "
            f"confirm it {numbers}."
        )
    return f"{name} has a {better} error than {other} {numbers}."


def _blind(rows: Sequence[Comparison]) -> str:
    """What it means if dead reckoning on the plan wins."""
    blind = [row for row in rows if row.method.localizer == "dead-reckoning"]
    filters = [row for row in rows if row.method.localizer != "dead-reckoning"]
    if not blind or not filters:
        return ""
    best = min(filters, key=lambda row: row.error)
    if blind[0].error >= best.error:
        return ""
    return (
        f"Dead reckoning on the plan, which looks at no scan, has a smaller error than every "
        f"other method here ({fixed(blind[0].error)}; the best of them "
        f"{full_name(best.method.localizer)}: {fixed(best.error)}). In this world the plan alone "
        "tells the path better than the filters do: the comparison says how they bear what they "
        "assume, not whether localization is needed."
    )


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def _percents(row: Comparison) -> str:
    return f"{100 * row.lost_low:.0f} to {100 * row.lost_high:.0f}"


def _range(counts: set[int], one: str, many: str) -> str:
    if not counts:
        return f"no {many}"
    low, high = min(counts), max(counts)
    if low == high:
        return f"{low} {one if low == 1 else many}"
    return f"{low} to {high} {many}"
