"""The paper's Table 1 beside ours."""

import json
import math

import pandas as pd
from tabulate import tabulate

from benchmarks.tables.text import BLIND, fixed, percent, short_name, state_name

_VARIANCES = {  # score: words, digits
    "var_x": ("var x", 1),
    "var_y": ("var y", 1),
    "var_cos": ("var cos θ", 3),
    "var_sin": ("var sin θ", 3),
}


# as printed (Taniguchi, Fukawa & Yamakawa 2024)
_SCORES = ("error", "error_sd", "entropy", *_VARIANCES)
TABLE_1 = {
    "deq-mcl": (20.95, 17.66, 7.82, 419.92, 290.04, 0.09, 0.07),
    "mcl-smoother": (22.88, 20.01, 8.88, 977.39, 611.06, 0.14, 0.11),
    "mcl-map": (25.00, 18.38, 9.69, 792.28, 616.85, 0.17, 0.16),
    "mcl": (26.17, 22.00, 9.81, 966.93, 591.79, 0.19, 0.16),
}


def table_1(rows: pd.DataFrame, style: str) -> str:
    """Return our Table 1, of one panel's ``results_table``, with the paper's values beside ours.

    In a style of tabulate: "simple", at most 120 columns; "github" for Markdown, with variances.
    """
    variances = _VARIANCES if style == "github" else {}
    baseline = short_name(rows["baseline"].iloc[0]) if len(rows) else ""
    header = ["method", "of", f"error - {baseline}'s, 95 %", "error (SD)", "paper"]
    header += ["entropy", "paper", "in walls"]
    header += [word for words, _ in variances.values() for word in (words, "paper")]
    lines = []
    for _, row in rows.iterrows():
        published = TABLE_1.get(row["method"], ()) if row["offset"] <= 0 else ()
        printed = dict(zip(_SCORES, published, strict=False))
        line = [
            short_name(row["method"]),
            state_name(row["offset"]),
            "baseline" if row["is_baseline"] else _difference(row),
            f"{fixed(row['error'])} ({fixed(row['error_sd'])})",
            "{error:.2f} ({error_sd:.2f})".format_map(printed) if printed else "",
            fixed(row["entropy"]),
            "{entropy:.2f}".format_map(printed) if printed else "",
            percent(row["wall_share"], 1),
        ]
        for name, (_, digits) in variances.items():
            line.append(fixed(row[name], digits))
            line.append(f"{printed[name]:g}" if printed else "")
        lines.append(line)
    return tabulate(
        lines,
        header,
        tablefmt=style,
        disable_numparse=True,
        stralign="right",
        colalign=("left", "left"),
    )


def reading(rows: pd.DataFrame) -> str:
    """Return one sentence on what the error of dead reckoning means for the others' of a panel."""
    present = rows[rows["offset"] == 0]
    blind = present[present["method"] == BLIND]
    filters = present[present["method"] != BLIND]
    agents = present["params"].map(lambda params: json.loads(params).get("agent"))
    if agents.nunique(dropna=False) > 1 or blind.empty or filters.empty:  # not on the same paths
        return ""
    error, best = blind["error"].iloc[0], filters.sort_values("error", kind="stable").iloc[0]
    theirs = f"{short_name(best['method'])}: {fixed(best['error'])}"
    if error < best["error"]:
        return (
            f"{BLIND}, which uses no scan, has a smaller error at x[t] than "
            f"every filter ({fixed(error)}; the best filter is {theirs}): here the plan "
            "alone predicts the path better than the filters do, so the table shows how well "
            "filters tolerate wrong assumptions, not whether localization is needed."
        )
    return f"{BLIND} (error {fixed(error)} at x[t]) is worse than the best filter ({theirs})."


def _difference(row: pd.Series) -> str:
    if math.isnan(row["diff"]):
        return "n/a"
    alone = f"{row['diff']:+.2f}"
    known = not math.isnan(row["diff_low"])
    return f"{alone} [{row['diff_low']:+.2f}, {row['diff_high']:+.2f}]" if known else alone
