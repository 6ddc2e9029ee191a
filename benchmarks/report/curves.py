"""Curves over every number that was swept: of the world, of what is assumed, of a localizer."""

import math
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes

from benchmarks.report.svg import INK, Look, Picture, canvas, estimates, picture
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.panels import Panel, disturbance_words, is_number
from benchmarks.tables.stats import Estimate
from benchmarks.tables.text import short_name

Place = dict[str, Any]  # where a panel lies: values by dotted name
Curves = dict[str, dict[float, Estimate]]  # what is known of each method, by label and value
Coordinates = frozenset[tuple[str, Any]]

_TICKS = 8  # values that are named on an axis
FAR = 3  # times the baseline's error: a difference that would hide all others
LOG_RATIO = 8  # a range of values wider than this is drawn on a logarithmic axis


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """What a curve shows of a comparison, and its words; ``lowest`` is where the axis begins.

    A method whose error is anywhere above ``far`` times the baseline's is left out.
    """

    name: str
    title: str
    axis: str
    caption: str
    of: Callable[[Comparison], Estimate]
    far: float = math.inf
    lowest: float | None = None


ERROR = Quantity(
    name="curve",
    title="Error",
    axis="error e of x[t]",
    caption="Bars: 95 % bootstrap intervals over worlds. A method without this parameter has the "
    "same error everywhere.",
    of=lambda row: row.error,
    lowest=0,
)
DIFFERENCE = Quantity(
    name="difference",
    title="Difference to the baseline",
    axis="error e of x[t] - the baseline's",
    caption="Below 0: better than the baseline on the same worlds. Bars: 95 % bootstrap intervals "
    "over worlds.",
    of=lambda row: row.diff,
    far=FAR,
)


@dataclass(frozen=True, kw_only=True)
class _Chart:
    """The panels that differ in one coordinate, and in those that change together with it."""

    key: str
    followers: Sequence[str]
    where: str
    panels: Mapping[float, Panel]


def swept_charts(
    panels: Sequence[Panel], looks: Mapping[str, Look], quantity: Quantity = ERROR
) -> list[Picture]:
    """Draw a quantity about x_t over each number that takes several values.

    Where several are swept, there is a chart for every value of the others.
    """
    found = [(chart, curves) for chart in _charts(panels) if (curves := _curves(chart, quantity))]
    tops: dict[str, list[float]] = {}  # charts over one coordinate are on one scale
    for chart, curves in found:
        shown = (value for values in curves.values() for one in values.values() for value in one)
        tops.setdefault(chart.key, [0.0]).extend(filter(math.isfinite, shown))
    return [
        _drawn(f"{quantity.name}-{number}", chart, curves, looks, quantity, tops[chart.key])
        for number, (chart, curves) in enumerate(found, 1)
    ]


def _charts(panels: Sequence[Panel]) -> list[_Chart]:
    places = [place_of(panel) for panel in panels]
    charts = []
    for key, followers in swept_coordinates(places).items():
        groups: dict[Coordinates, dict[float, Panel]] = {}
        for place, panel in zip(places, panels, strict=True):
            rest = {name: v for name, v in place.items() if name not in (key, *followers)}
            if is_number(place.get(key)):
                groups.setdefault(frozenset(rest.items()), {})[place[key]] = panel
        charts += [
            _Chart(key=key, followers=followers, where=_where(rest, groups), panels=members)
            for rest, members in groups.items()
            if len(members) > 1
        ]
    return charts


def place_of(panel: Panel) -> Place:
    """Return where a panel lies: all that can be swept, by dotted name."""
    setting = panel.setting
    disturbed = ", ".join(map(disturbance_words, setting.disturbance)) or "undisturbed"
    place: Place = {"scenario": setting.scenario, "disturbance": disturbed}
    place |= {"lag": setting.lag, "seed": setting.seed}
    parts = {"world": setting.world, "assumed": setting.assumed, "params": panel.swept}
    for part, values in parts.items():
        place |= {f"{part}.{name}": value for name, value in values.items()}
    return place


def swept_coordinates(places: Sequence[Place]) -> dict[str, list[str]]:
    """Coordinates with two numbers or more, each with those that change together with it.

    Of those that do, the one with the values of most: of noises in drift, drive and turn, drive.
    """
    keys = dict.fromkeys(key for place in places for key in place if key != "seed")
    numbers = {key: {p[key] for p in places if is_number(p.get(key))} for key in keys}
    varying = [key for key in keys if len(numbers[key]) > 1]
    found: dict[str, list[str]] = {}
    for key in varying:
        if not any(key in followers for followers in found.values()):
            group = [key, *(k for k in varying if k != key and _together(key, k, places))]
            values = {k: [place.get(k) for place in places] for k in group}
            axis = max(group, key=lambda k: list(values.values()).count(values[k]))
            found[axis] = [k for k in group if k != axis]
    return found


def _together(one: str, other: str, places: Sequence[Place]) -> bool:
    pairs = {(place[one], place[other]) for place in places if one in place and other in place}
    return bool(pairs) and len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


def _curves(chart: _Chart, quantity: Quantity) -> Curves:
    curves: Curves = {}
    out = _left_out(chart, quantity)
    for value, panel in sorted(chart.panels.items()):
        for row in panel.present:
            shown, label = quantity.of(row), panel.labels[row.method]
            if label not in out and not math.isnan(shown.mean):
                curves.setdefault(label, {})[value] = shown
    return curves


def _left_out(chart: _Chart, quantity: Quantity) -> list[str]:
    """Labels of the methods that are too far off to be drawn beside the others."""
    rows = ((p.labels[row.method], row) for p in chart.panels.values() for row in p.present)
    most = quantity.far
    far = [name for name, row in rows if row.error.mean > most * (row.error.mean - row.diff.mean)]
    return list(dict.fromkeys(far))


def spaced(axes: Axes, ticks: Sequence[float]) -> None:
    """Give an axis a logarithmic scale with these ticks."""
    axes.set_xscale("log")
    axes.set_xticks(ticks, [f"{value:g}" for value in ticks])
    axes.set_xticks([], minor=True)


def left_out(labels: Sequence[str], of: str) -> str:
    """Say which methods are not drawn, as they are too far off; "" if all are."""
    said = f" Left out, above {FAR} times {of}: {', '.join(labels)}."
    return said if labels else ""


def _drawn(
    name: str,
    chart: _Chart,
    curves: Curves,
    looks: Mapping[str, Look],
    quantity: Quantity,
    ends: Sequence[float],
) -> Picture:
    figure, axes = canvas(4.8, 3.0, legend_of=curves)
    for label, shown in curves.items():
        estimates(axes, list(shown), list(shown.values()), looks[label], label)
    finite = sorted(filter(math.isfinite, chart.panels))
    if len(finite) <= _TICKS:
        axes.set_xticks(finite, [f"{value:g}" for value in finite])
    if finite and finite[0] > 0 and finite[-1] / finite[0] >= LOG_RATIO:
        spaced(axes, finite)
    words, *others = coordinate_words([chart.key, *chart.followers])
    axes.set(xlabel=words, ylabel=quantity.axis)
    margin = 0.05 * (max(ends) - min(ends))
    lowest = min(ends) - margin if quantity.lowest is None else quantity.lowest
    axes.set_ylim(lowest, max(ends) + margin or None)
    axes.axhline(0, color=INK, linewidth=0.8)
    title = f"{quantity.title} over {words}" + (f": {chart.where}" if chart.where else "")
    caption = quantity.caption
    caption += left_out(_left_out(chart, quantity), "the baseline's error")
    if others:
        caption += f" Together with {words} change: {', '.join(others)}."
    return picture(figure, name=name, title=title, caption=caption, alt=title)


def _where(rest: Coordinates, others: Iterable[Coordinates]) -> str:
    """What sets a chart apart from the others over the same coordinate."""
    shared = frozenset.intersection(*others)
    apart = dict(sorted(rest - shared))
    plain = [short_name(str(apart.pop(key))) for key in ("disturbance", "scenario") if key in apart]
    return ", ".join(filter(None, [valued(apart), *reversed(plain)]))


_WORDS = {  # of what can be swept: what it is called, its unit
    "lag": ("lag L", ""),
    "lidar.sigma": ("σ of the lidar", ""),
    "lidar.beams": ("beams", ""),
    "scan.sigma": ("σ of scans", ""),
    **{f"{who}.{name}": (f"noise of {name}", "") for who in ("noise", "motion")
       for name in ("drive", "turn", "drift")},
    "floor_plan.office.corridor": ("width of corridors", "m"),
    "route.length": ("length of the route", "m"),
}  # fmt: skip


def _words(key: str) -> tuple[str, str]:
    """What a coordinate is called, and its unit; one without words by its name."""
    group, _, name = key.partition(".")
    if group == "params":
        own = name.removeprefix("agent.")
        return own if own == name else f"{own} of the agent", ""
    words, unit = _WORDS.get(name or group, (name.replace(".", " ").replace("_", " "), ""))
    return f"assumed {words}" if group == "assumed" else words, unit


def coordinate_words(keys: Sequence[str]) -> list[str]:
    """Return what coordinates are called in a chart; least and most of a range have one name."""
    merged = dict.fromkeys(_merged(key, keys) for key in keys)
    return [", ".join(filter(None, _words(key))) for key in merged]


def valued(place: Mapping[str, Any]) -> str:
    """Return coordinates with their values, as "length of the route 8 to 12 m"."""
    values: dict[str, list[str]] = {}
    for key, value in sorted(place.items(), key=lambda item: "max_" in item[0]):
        told = f"{value:g}" if is_number(value) else str(value)
        values.setdefault(_merged(key, place), []).append(told)
    named = ((*_words(key), " to ".join(told)) for key, told in values.items())
    return ", ".join(f"{words} {told} {unit}".strip() for words, unit, told in named)


def _merged(key: str, keys: Container[str]) -> str:
    """The name without min_ and max_, if both are among the keys."""
    ends = {key.replace(a, b) for a, b in (("min_", "max_"), ("max_", "min_"))}
    return key.replace("min_", "").replace("max_", "") if all(e in keys for e in ends) else key
