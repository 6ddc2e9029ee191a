"""Curves over every number that was swept: of the world, of what is assumed, of a localizer."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.report.panels import as_number, short_name
from benchmarks.report.style import INK, Look
from benchmarks.report.svg import Picture, canvas, legend, picture
from benchmarks.tables.comparison import Comparison

Facts = dict[str, Any]
_LOG_RATIO = 8  # a range of values wider than this is drawn on a logarithmic axis


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """What a curve shows of a comparison: a value with its interval, and its words."""

    name: str
    title: str
    axis: str
    caption: str
    of: Callable[[Comparison], tuple[float, float, float]]
    left_out: str = ""  # a localizer

    def shows(self, row: Comparison) -> bool:
        """Whether a row has it, and is not of the localizer that is left out."""
        return row.method.localizer != self.left_out and not math.isnan(self.of(row)[0])


ERROR = Quantity(
    name="curve",
    title="Error",
    axis="error e of x[t]",
    caption="Bars: 95 % bootstrap intervals over worlds. A dash-dotted line is a method "
    "without this parameter.",
    of=lambda row: (row.error, row.error_low, row.error_high),
)
DIFFERENCE = Quantity(
    name="difference",
    title="Difference to the baseline",
    axis="error e of x[t] - the baseline's",
    caption="Below 0: better than the baseline on the same worlds. Bars: 95 % bootstrap intervals "
    "over worlds. Dead reckoning is left out, as its scale hides the others.",
    of=lambda row: (row.diff, row.diff_low, row.diff_high),
    left_out="dead-reckoning",
)


@dataclass(frozen=True)
class _Line:
    look: Look
    rows: list[tuple[float | None, Comparison]]


def swept_charts(
    rows: Sequence[Comparison], look: Mapping[Any, Look], quantity: Quantity = ERROR
) -> list[Picture]:
    """Draw a quantity about x_t over each numeric key of at least two values."""
    present = [(row, _facts(row)) for row in rows if row.offset == 0 and quantity.shows(row)]
    charts: list[Picture] = []
    for key, followers in _swept(facts for _, facts in present):
        groups: dict[str, dict[str, _Line]] = {}
        for row, facts in present:
            rest = {k: v for k, v in facts.items() if k != key and k not in followers}
            world = {k: v for k, v in rest.items() if not k.startswith("params.")}
            world.pop("localizer")
            name = _line_name(rest, [f for _, f in present], {key, *followers})
            lines = groups.setdefault(json.dumps(world, sort_keys=True), {})
            line = lines.setdefault(name, _Line(look[row.method], []))
            line.rows.append((as_number(facts.get(key)), row))
        for world_words, lines in groups.items():
            values = {v for line in lines.values() for v, _ in line.rows if v is not None}
            if len(values) > 1:
                where = _where(world_words, list(groups))
                name = f"{quantity.name}-{len(charts) + 1}"
                charts.append(_chart(name, quantity, key, followers, where, lines, values))
    return charts


def _chart(
    name: str,
    quantity: Quantity,
    key: str,
    followers: Sequence[str],
    where: str,
    lines: Mapping[str, _Line],
    values: set[float],
) -> Picture:
    figure, axes = canvas(4.8, 3.4)
    for label, line in lines.items():
        known = sorted(
            ((value, row) for value, row in line.rows if value is not None), key=lambda p: p[0]
        )
        if not known and quantity is DIFFERENCE:  # to which of the baseline's values?
            continue
        if not known:  # it has no such parameter: the same at every value
            for _, row in line.rows:
                level, _, _ = quantity.of(row)
                axes.axhline(level, color=line.look.color, linestyle="-.", label=label)
            continue
        shown = [quantity.of(row) for _, row in known]
        ends = [(middle - low, high - middle) for middle, low, high in shown]
        bars = None if any(math.isnan(low) for low, _ in ends) else list(zip(*ends, strict=True))
        axes.errorbar(
            [value for value, _ in known],
            [middle for middle, _, _ in shown],
            yerr=bars,
            fmt=f"-{line.look.mark}",
            color=line.look.color,
            markersize=5,
            elinewidth=0.9,
            label=label,
        )
    finite = sorted(value for value in values if math.isfinite(value))
    if finite and finite[0] > 0 and finite[-1] / finite[0] >= _LOG_RATIO:
        axes.set_xscale("log")
        axes.set_xticks(finite, [f"{value:g}" for value in finite])
        axes.set_xticks([], minor=True)
    words = _words(key)
    also = ", ".join(map(_words, followers))
    axes.set(xlabel=f"{words} …" if followers else words, ylabel=quantity.axis)
    if quantity is ERROR:
        axes.set_ylim(0, None)
    legend(figure, axes, lines)
    axes.axhline(0, color=INK, linewidth=0.8)
    title = f"{quantity.title} over {words}" + (f": {where}" if where else "")
    return picture(
        figure,
        name=name,
        title=title,
        caption=quantity.caption + (f" … and with it {also}." if followers else ""),
        alt=title,
    )


def _facts(row: Comparison) -> Facts:
    """Everything that says what a row is of, flat."""
    facts: Facts = {"scenario": row.setting.scenario, "disturbance": row.setting.disturbance}
    facts |= {"lag": row.setting.lag, "seed": row.setting.seed, "localizer": row.method.localizer}
    for part, words in (
        ("world", row.setting.world),
        ("assumed", row.setting.assumed),
        ("params", row.method.params),
    ):
        facts |= {f"{part}.{name}": value for name, value in json.loads(words).items()}
    return facts


def _swept(all_facts: Any) -> list[tuple[str, list[str]]]:
    """Keys with two numbers or more, each with the keys that change together with it."""
    listed = list(all_facts)
    keys = dict.fromkeys(key for facts in listed for key in facts)
    varying = []
    for key in keys:
        values = {as_number(facts[key]) for facts in listed if key in facts} - {None}
        if key != "seed" and len(values) > 1:
            varying.append(key)
    found: list[tuple[str, list[str]]] = []
    taken: set[str] = set()
    for key in varying:
        if key in taken:
            continue
        followers = [other for other in varying if other != key and _together(key, other, listed)]
        taken.update(followers)
        found.append((key, followers))
    return found


def _together(one: str, other: str, listed: Sequence[Facts]) -> bool:
    pairs = {(str(f[one]), str(f[other])) for f in listed if one in f and other in f}
    return bool(pairs) and len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


def _line_name(rest: Facts, listed: Sequence[Facts], swept: set[str]) -> str:
    """The localizer, and those of its parameters that take several values beside the swept one."""
    same = [facts for facts in listed if facts["localizer"] == rest["localizer"]]
    telling = [
        key
        for key in sorted(rest)
        if key.startswith("params.")
        and key not in swept
        and len({json.dumps(facts.get(key)) for facts in same}) > 1
    ]
    words = [f"{key.removeprefix('params.')}={rest[key]}" for key in telling]
    return " ".join([short_name(rest["localizer"]), *words])


def _where(world: str, worlds: Sequence[str]) -> str:
    """What sets a chart apart from the others over the same key."""
    if len(worlds) == 1:
        return ""
    facts, others = json.loads(world), [json.loads(one) for one in worlds]
    differing = [
        key
        for key in sorted({k for one in others for k in one})
        if len({json.dumps(one.get(key)) for one in others}) > 1
    ]
    return ", ".join(
        str(facts[key]) if key == "scenario" else f"{_words(key)} {facts[key]}"
        for key in differing
        if key in facts
    )


def _words(key: str) -> str:
    if key == "lag":
        return "lag L"
    return key.removeprefix("params.").removeprefix("world.").replace("assumed.", "assumed ")
