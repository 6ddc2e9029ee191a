"""The paper's Table 1 beside ours."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tabulate import tabulate

from benchmarks.tables.comparison import Comparison
from benchmarks.tables.stats import Estimate
from benchmarks.tables.text import fixed, percent, short_name, state_name

_VARIANCES = {  # score: words, digits
    "var_x": ("var x", 1),
    "var_y": ("var y", 1),
    "var_cos": ("var cos θ", 3),
    "var_sin": ("var sin θ", 3),
}


@dataclass(frozen=True)
class Published:
    """A row of the paper: error and its SD, entropy, variances of the four components."""

    error: float
    error_sd: float
    entropy: float
    var_x: float
    var_y: float
    var_cos: float
    var_sin: float


# as printed (Taniguchi, Fukawa & Yamakawa 2024)
TABLE_1 = {
    "deq-mcl": Published(20.95, 17.66, 7.82, 419.92, 290.04, 0.09, 0.07),
    "mcl-smoother": Published(22.88, 20.01, 8.88, 977.39, 611.06, 0.14, 0.11),
    "mcl-map": Published(25.00, 18.38, 9.69, 792.28, 616.85, 0.17, 0.16),
    "mcl": Published(26.17, 22.00, 9.81, 966.93, 591.79, 0.19, 0.16),
}


def table_1(rows: Sequence[Comparison], style: str) -> str:
    """Return our Table 1 with the paper's printed values beside ours.

    Args:
        rows: of one panel.
        style: a format of tabulate: "simple" for a terminal, at most 120 columns; "github" for
            Markdown, with the variances.
    """
    variances = _VARIANCES if style == "github" else {}
    baseline = short_name(rows[0].baseline.name) if rows else ""
    header = ["method", "of", f"error - {baseline}'s, 95 %", "error (SD)", "paper"]
    header += ["entropy", "paper", "in walls"]
    header += [word for words, _ in variances.values() for word in (words, "paper")]
    lines = []
    for row in rows:
        printed = TABLE_1.get(row.method.name) if row.offset <= 0 else None
        line = [
            short_name(row.method.name),
            state_name(row.offset),
            "baseline" if row.is_baseline else _difference(row.diff),
            f"{fixed(row.error.mean)} ({fixed(row.error_sd)})",
            f"{printed.error:.2f} ({printed.error_sd:.2f})" if printed else "",
            fixed(row.scores["entropy"].mean),
            f"{printed.entropy:.2f}" if printed else "",
            percent(row.scores["wall_share"].mean, 1),
        ]
        for name, (_, digits) in variances.items():
            line.append(fixed(row.scores[name].mean, digits))
            line.append(f"{getattr(printed, name):g}" if printed else "")
        lines.append(line)
    return tabulate(
        lines,
        header,
        tablefmt=style,
        disable_numparse=True,
        stralign="right",
        colalign=("left", "left"),
    )


def reading(rows: Iterable[Comparison]) -> str:
    """Return one sentence on what the error of dead reckoning means for the others'.

    Args:
        rows: of one panel.
    """
    present = [row for row in rows if row.offset == 0]
    if len({row.method.agent for row in present}) > 1:  # not on the same paths
        return ""
    filters = [row for row in present if row.method.name != "dead-reckoning"]
    blind = next((row for row in present if row not in filters), None)
    if blind is None or not filters:
        return ""
    best = min(filters, key=lambda row: row.error.mean)
    theirs = f"{short_name(best.method.name)}: {fixed(best.error.mean)}"
    if blind.error.mean < best.error.mean:
        return (
            f"{blind.method.name}, which uses no scan, has a smaller error at x[t] than "
            f"every filter ({fixed(blind.error.mean)}; the best filter is {theirs}): here the plan "
            "alone predicts the path better than the filters do, so the table shows how well "
            "filters tolerate wrong assumptions, not whether localization is needed."
        )
    return (
        f"{blind.method.name} (error {fixed(blind.error.mean)} at x[t]) is worse than the "
        f"best filter ({theirs})."
    )


def _difference(diff: Estimate) -> str:
    if math.isnan(diff.mean):
        return "n/a"
    if math.isnan(diff.low):
        return f"{diff.mean:+.2f}"
    return f"{diff.mean:+.2f} [{diff.low:+.2f}, {diff.high:+.2f}]"
