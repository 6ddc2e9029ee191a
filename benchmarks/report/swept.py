"""What is drawn of the numbers that were swept: maps of regimes, or curves."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from benchmarks.report import curves
from benchmarks.report.svg import Look, Picture, picture
from benchmarks.report.words import done
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.journeys import JourneyScore
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import ALPHA
from benchmarks.tables.text import estimated
from benchmarks.trials.scores import JOURNEY_SCORES, Score

_CELL = 1.15, 0.72  # inches
_LEFT, _BETWEEN, _BELOW, _ABOVE = 0.75, 0.18, 0.55, 0.3
_COLORS = LinearSegmentedColormap.from_list("ahead", ["#d55e00", "#f4f4f4", "#0072b2"])
_PALE = 0.6  # of the colours' range is used, so that black is legible on all
_LEAST = {"share": 0.1, "m": 1.0}  # a difference that is drawn in full colour, at least

Cells = Mapping[tuple[Any, ...], tuple[Comparison, Comparison]]  # a method and the baseline


def regime_maps(panels: Sequence[Panel]) -> list[Picture]:
    """Draw a map for every tested score of whole runs and every method beside the baseline.

    Three numbers must vary: one is across, one upwards, and there is a square for each of the last.
    """
    places = [curves.place_of(panel) for panel in panels]
    swept = curves.swept_coordinates(places)
    if len(swept) != 3:
        return []
    *_, last = swept
    squares = {
        place.get(last): curves.valued({key: place.get(key) for key in (last, *swept[last])})
        for place in places
    }
    cells: dict[str, dict[tuple[Any, ...], tuple[Comparison, Comparison]]] = {}
    for place, panel in zip(places, panels, strict=True):
        reference = next((row for row in panel.present if row.is_baseline), None)
        if reference is None or not all(key in place for key in swept):
            continue
        for row in panel.present:
            if not row.is_baseline:
                where = tuple(place[key] for key in swept)
                cells.setdefault(panel.labels[row.method], {})[where] = row, reference
    return [
        _drawn(f"regimes-{name.replace('_', '-')}-{number}", label, own, score, swept, squares)
        for number, (label, own) in enumerate(cells.items(), 1)
        for name, score in JOURNEY_SCORES.items()
        if score.tested and any(name in row.journey for row, _ in own.values())
    ]


def _drawn(
    name: str,
    label: str,
    cells: Cells,
    score: Score,
    swept: Mapping[str, Sequence[str]],
    titles: Mapping[Any, str],
) -> Picture:
    across, upwards, squares = (sorted(set(values)) for values in zip(*cells, strict=True))
    wide, high = len(across) * _CELL[0], len(upwards) * _CELL[1]
    width = _LEFT + len(squares) * (wide + _BETWEEN)
    height = _BELOW + high + _ABOVE
    figure = Figure(figsize=(width, height))
    words = [", ".join(curves.coordinate_words([key, *swept[key]])) for key in swept]
    most = max(abs(_ahead(row, score)) for row, _ in cells.values() if score.name in row.journey)
    scale = Normalize(-1, 1)
    for number, square in enumerate(squares):
        left = _LEFT + number * (wide + _BETWEEN)
        axes = figure.add_axes((left / width, _BELOW / height, wide / width, high / height))
        _square(axes, across, upwards, first=number == 0)
        axes.set_title(titles[square], loc="left")
        axes.set_xlabel(words[0])
        if number == 0:
            axes.set_ylabel(words[1])
        for x, one in enumerate(across):
            for y, other in enumerate(upwards):
                if (found := cells.get((one, other, square))) and score.name in found[0].journey:
                    share = _PALE * _ahead(found[0], score) / max(most, _LEAST[score.unit])
                    _fill(axes, x, y, _COLORS(scale(share)), *found, score)
    better = sum(_clear(row, score, ahead=True) for row, _ in cells.values())
    worse = sum(_clear(row, score, ahead=False) for row, _ in cells.values())
    title = f"Where {label} is ahead: {score.words.removesuffix(', median')}"
    alt = f"{title}. Clearly ahead of the baseline in {better} of {len(cells)} settings, "
    alt += f"clearly behind in {worse}."
    return picture(figure, name=name, title=title, caption=_caption(score), alt=alt)


def _square(axes: Axes, across: Sequence[Any], upwards: Sequence[Any], *, first: bool) -> None:
    axes.grid(visible=False)
    axes.set(xlim=(-0.5, len(across) - 0.5), ylim=(-0.5, len(upwards) - 0.5))
    axes.set_xticks(range(len(across)), [f"{value:g}" for value in across])
    axes.set_yticks(range(len(upwards)), [f"{value:g}" for value in upwards] if first else [])
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _fill(
    axes: Axes, x: int, y: int, color: Any, row: Comparison, reference: Comparison, score: Score
) -> None:
    """Draw a cell: the difference with its interval, and from what to what."""
    axes.add_patch(Rectangle((x - 0.48, y - 0.48), 0.96, 0.96, facecolor=color, linewidth=0))
    own = row.journey[score.name]
    diff = own.diff.percent if score.unit == "share" else own.diff
    mean, _, ends = estimated(diff, "+.0f" if score.unit == "share" else "+.1f").partition(" ")
    weight = "bold" if own.p_holm < ALPHA else "normal"
    values = [_level(one.journey.get(score.name), score) for one in (reference, row)]
    ink: dict[str, Any] = {"ha": "center", "va": "center", "color": "#1f2328"}
    axes.text(x, y + 0.24, mean, fontsize=11, fontweight=weight, **ink)
    axes.text(x, y - 0.06, ends, fontsize=9, **ink)
    unit = "%" if score.unit == "share" else "m"
    axes.text(x, y - 0.3, f"{' → '.join(values)} {unit}", fontsize=9, **ink)


def _level(own: JourneyScore | None, score: Score) -> str:
    if own is None:
        return "n/a"
    return f"{100 * own.value.mean:.0f}" if score.unit == "share" else f"{own.restricted:.1f}"


def _ahead(row: Comparison, score: Score) -> float:
    """By how much a method does better than the baseline."""
    diff = row.journey[score.name].diff.mean
    better = -diff if score.censored else diff
    return 0.0 if math.isnan(better) else better


def _clear(row: Comparison, score: Score, *, ahead: bool) -> bool:
    own = row.journey.get(score.name)
    return own is not None and own.p_holm < ALPHA and (_ahead(row, score) > 0) == ahead


def _caption(score: Score) -> str:
    what = "metres, runs that are censored with the longest way in their world"
    return (
        f"Difference to the baseline in {'points' if score.unit == 'share' else what}, its 95 % "
        "interval, and the two values, baseline → method. Blue: ahead; orange: behind; bold: p "
        "below 0.05, corrected for the tests of a setting, not for the number of settings."
    )


def charts_over(panels: Sequence[Panel], looks: Mapping[str, Look]) -> list[Picture]:
    """Draw what was swept: maps where three numbers were and runs are scored whole, else curves.

    They are of what all panels are about: a share of runs that succeed, or the error. None where
    methods stopped after as many worlds as their decisions needed.
    """
    if any(panel.rule is not None for panel in panels):
        return []
    aims = {panel.aim for panel in panels}
    aim = aims.pop() if len(aims) == 1 else None
    quantities = (curves.ERROR, curves.DIFFERENCE) if aim is None else _shares(aim)
    return regime_maps(panels) or [
        chart for quantity in quantities for chart in curves.swept_charts(panels, looks, quantity)
    ]


def _shares(aim: Score) -> tuple[curves.Quantity, curves.Quantity]:
    share = replace(
        curves.ERROR,
        title=f"Runs {done(aim)}",
        axis=f"{done(aim)}, % of runs",
        caption="Bars: Wilson's 95 % intervals. A method without this parameter has the same share "
        "everywhere.",
        of=lambda row: row.standing.value.percent,
    )
    apart = replace(
        curves.DIFFERENCE,
        axis="points above the baseline",
        caption="Above 0: more often than the baseline on the same worlds. Bars: 95 % bootstrap "
        "intervals over worlds.",
        of=lambda row: row.standing.diff.percent,
        far=math.inf,
    )
    return share, apart
