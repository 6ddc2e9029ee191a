"""Tables of differences to others than the baseline: the paper's methods, the limit."""

import json
from collections.abc import Sequence

from benchmarks.report.panels import Panel, short_name
from benchmarks.report.words import interval, signed
from benchmarks.tables.gap import Gap, apart
from benchmarks.tables.pairing import Method, world_scores
from benchmarks.tables.table_1 import state_name
from benchmarks.tables.text import fixed

Table = tuple[list[str], list[list[str]]]

_NOW = ("mcl", "mcl-map", "deq-mcl")
_PAST = ("mcl-smoother", "mcl-map-smoother", "deq-mcl")


def rival_tables(panel: Panel) -> list[Table]:
    """Every method against the paper's, world by world: at x_t, and at x_{t-L}."""
    offsets = {0: _NOW} | ({-panel.setting.lag: _PAST} if panel.setting.lag else {})
    tables = [_rivals(panel, offset, names) for offset, names in offsets.items()]
    return [(header, lines) for header, lines in tables if len(header) > 2 and len(lines) > 1]


def gap_table(panel: Panel, gaps: Sequence[Gap]) -> Table:
    """Header and lines of the errors on the limit's worlds; no lines if there is no limit."""
    own = [gap for gap in gaps if gap.setting == panel.setting]
    limits = {gap.limit for gap in own if gap.method in panel.labels}
    header = ["method", "belief about", "error e", "SD between runs on a world"]
    header += ["gap to the limit, 95 % interval", "worlds"]
    lines = [
        [
            f"limit: {_told(gap.limit)}" if itself else panel.labels[gap.method],
            state_name(gap.offset),
            fixed(gap.error),
            fixed(gap.seed_sd),
            "–" if itself else _difference(gap.gap, gap.gap_low, gap.gap_high),
            str(gap.worlds),
        ]
        for gap in own
        for itself in [gap.method == gap.limit]
        if (gap.limit in limits if itself else gap.method in panel.labels)
    ]
    return header, lines


def _rivals(panel: Panel, offset: int, names: Sequence[str]) -> Table:
    errors = {
        row.method: world_scores(panel.own(row.method), "error", offset)
        for row in panel.rows
        if row.offset == offset
    }
    rivals = [m for name in names for m in errors if m.localizer == name]
    header = ["method", f"error e of {state_name(offset)}"]
    header += [f"difference to {panel.labels[rival]}" for rival in rivals]
    lines = [
        [
            panel.labels[method],
            fixed(sum(own.values()) / len(own)),
            *("–" if m == method else _difference(*apart(own, errors[m])) for m in rivals),
        ]
        for method, own in errors.items()
    ]
    return header, lines


def _difference(mean: float, low: float, high: float) -> str:
    return f"{signed(mean)} ({interval(low, high)})".replace(" ()", "")


def _told(method: Method) -> str:
    words = [f"{name}={value}" for name, value in json.loads(method.params).items()]
    return " ".join([short_name(method.localizer), *words])
