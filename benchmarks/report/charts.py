"""Charts of frames: lines, points and cells, in matplotlib's own colours.

A hue that is a category has the colour and mark of its place among all categories, so that a method
looks the same in every chart of a page.
"""

import io
import math
from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from benchmarks.pictures import styled

if TYPE_CHECKING:  # an optional extra
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLE: Any = {  # over matplotlib's defaults
    "text.parse_math": False,  # a name with a $ is a name
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.alpha": 0.3,
}
INK = "0.25"
WIDE = 20  # a ratio of values above it is drawn on a logarithmic axis
_MARKS = "osD^vPX<>h"
_LETTERS = 60  # of a legend, side by side
_TICKS = 8  # values that are named on an axis
_MANY = 30  # worlds whose marks fit side by side


class Chart(NamedTuple):
    """A figure of matplotlib with its words: file name without ending, heading, caption."""

    name: str
    title: str
    caption: str
    figure: Any

    def drawn(self, form: str, **how: Any) -> bytes:
        """Return it as a file ("svg", "png", "pdf"), the same bytes each time."""
        buffer = io.BytesIO()
        stamp = {"svg": "Date", "pdf": "CreationDate", "png": "Software"}[form]
        with styled(STYLE | {"svg.hashsalt": self.name}):
            self.figure.savefig(buffer, format=form, metadata={stamp: None}, **how)
        return buffer.getvalue()


def canvas(width: float = 4.8, height: float = 3.2) -> "Axes":
    """Return the axes of an empty figure, inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained").subplots()


def look(place: int) -> dict[str, Any]:
    """Return colour and mark of the label at a place among all."""
    return {"color": f"C{place % 10}", "marker": _MARKS[(place + place // 10) % len(_MARKS)]}


def line(
    frame: pd.DataFrame,
    x: str,
    y: str,
    low: str = "",
    high: str = "",
    hue: str = "label",
    *,
    axes: "Axes | None" = None,
    band: bool = False,
    **how: Any,
) -> "Axes":
    """Draw y over x, a line for each hue, with intervals as bars or as a band.

    Args:
        frame: a row per point.
        x, y, low, high: columns; no intervals without low.
        hue: column of the labels.
        axes: to draw on; None: those of a new figure.
        band: a band, and no marks.
        how: for ``Axes.plot``.
    """
    axes = canvas() if axes is None else axes
    for label, place, rows in _hues(frame, hue):
        color, mark = look(place).values()
        style = {"color": color, "label": label} | ({} if band else {"marker": mark, "ms": 5}) | how
        axes.plot(rows[x], rows[y], **style)
        if low and band:
            across, low_end, high_end = rows[[x, low, high]].astype(float).to_numpy().T
            stepped: Any = {"step": "post"} if how.get("drawstyle") == "steps-post" else {}
            axes.fill_between(across, low_end, high_end, color=color, alpha=0.15, lw=0, **stepped)
        elif low:
            axes.vlines(rows[x], rows[low], rows[high], color=color, lw=1)
    _legend(axes)
    return axes


def points(
    frame: pd.DataFrame,
    x: str,
    means: pd.DataFrame,
    low: str,
    high: str,
    hue: str = "label",
    pair: str = "trial",
) -> "Axes":
    """Draw every x in a row of its hue, thin lines between those of a pair, and above it the mean.

    Args:
        frame: a row per point, one for each hue and pair.
        x: column.
        means: a row per hue, with columns x, low and high; its order is that of the rows.
        low, high: ends of the mean's interval.
        hue, pair: columns.
    """
    table = frame.pivot_table(x, pair, hue, observed=True)[list(means[hue])]
    spread = 0.3 if len(table) > _MANY else 0.0  # by golden steps, so that neighbours differ
    aside = ((np.arange(len(table)) * 0.618034) % 1 - 0.5) * spread
    names = [fill(str(label), 28) for label in means[hue]]
    axes = canvas(4.8, 0.9 + 0.42 * len(names))
    places = np.arange(len(names))
    faint = min(0.35, 8 / max(len(table), 1))
    axes.plot(table.to_numpy().T, places[:, None] + aside, color=INK, alpha=faint, lw=0.7)
    for place, (_, number, rows) in enumerate(_hues(means, hue)):
        style = look(number) | {"ls": "", "ms": 5 if spread == 0 else 3.5, "mew": 0, "alpha": 0.75}
        axes.plot(table[rows[hue].iloc[0]], place + aside, **style)
        axes.plot(rows[[low, high]].iloc[0], [place - 0.3] * 2, color=INK, lw=1.6)
        axes.plot(rows[x], [place - 0.3], "|", color=INK, ms=8, mew=2)
    axes.set_yticks(places, names)
    axes.set(ylim=(len(names) - 0.5, -0.6), xlim=(0, None))
    axes.grid(visible=False, axis="y")
    return axes


def cells(
    frame: pd.DataFrame,
    x: str,
    y: str,
    square: str,
    value: str,
    text: str,
    *,
    least: float,
    bold: str = "",
) -> "Figure":
    """Draw values as coloured cells, a square for each value of a third column.

    Args:
        frame: a row per cell.
        x, y, square: columns of what is across, upwards, and of each square.
        value: column of the colour, blue above 0, red below.
        text: column of the words in a cell.
        least: value that has the full colour, at least.
        bold: column of whether the words are bold; none are without it.
    """
    from matplotlib.figure import Figure

    across, upwards = (sorted(frame[name].unique()) for name in (x, y))
    squares = sorted(frame[square].unique(), key=lambda one: 0 if isinstance(one, str) else one)
    size = len(squares) * len(across) * 1.2 + 1, len(upwards) * 0.72 + 1
    figure = Figure(figsize=size, layout="constrained")
    most = max(least, float(frame[value].abs().max()))
    each = figure.subplots(1, len(squares), squeeze=False, sharey=True)[0]
    for axes, which in zip(each, squares, strict=True):
        rows = frame[frame[square] == which]
        shown = rows.pivot(index=y, columns=x, values=value).reindex(upwards, columns=across)
        axes.imshow(shown, "RdBu", vmin=-1.6 * most, vmax=1.6 * most, aspect="auto", origin="lower")
        for row in rows.to_dict("records"):
            place = across.index(row[x]), upwards.index(row[y])
            weight = "bold" if bold and row[bold] else "normal"
            axes.text(*place, row[text], ha="center", va="center", size=9, weight=weight)
        axes.set_xticks(range(len(across)), [f"{v:g}" for v in across])
        axes.set_yticks(range(len(upwards)), [f"{v:g}" for v in upwards])
        axes.set(xlabel=x, title=which if isinstance(which, str) else f"{square} {which:g}")
        axes.grid(visible=False)
    each[0].set_ylabel(y)
    return figure


def scaled(axes: "Axes", values: Sequence[float]) -> None:
    """Name the few values on the axis across; on a logarithmic one where they are far apart."""
    known = sorted({value for value in values if math.isfinite(value)})
    if known and known[0] > 0 and known[-1] / known[0] >= _TICKS:
        axes.set_xscale("log")
    if len(known) <= _TICKS:
        axes.set_xticks(known, [f"{value:g}" for value in known])
        axes.set_xticks([], minor=True)


def from_zero(axes: "Axes", values: pd.Series) -> None:
    """Let the upward axis begin at 0; a logarithmic one where values are far apart."""
    known = values[np.isfinite(values) & (values > 0)]
    if len(known) and known.max() / known.min() > WIDE:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
    else:
        axes.set_ylim(0, None)


def _hues(frame: pd.DataFrame, hue: str) -> list[tuple[str, int, pd.DataFrame]]:
    """Labels, their places among all, and their rows, in the order of the frame."""
    labels = list(frame[hue].unique())
    whole = isinstance(frame[hue].dtype, pd.CategoricalDtype)
    every = list(frame[hue].cat.categories) if whole else labels
    return [(str(one), every.index(one), frame[frame[hue] == one]) for one in labels]


def _legend(axes: "Axes") -> None:
    """Name what is drawn below the axes."""
    figure: Any = axes.figure
    lines, labels = axes.get_legend_handles_labels()
    for old in figure.legends:
        old.remove()
    if not labels:
        return
    names = [fill(label, _LETTERS - 8) for label in labels]
    columns = max(1, min(4, len(labels), _LETTERS // (8 + max(map(len, labels)))))
    lines_of_one = 1 + max(name.count("\n") for name in names)
    rows = lines_of_one * math.ceil(len(labels) / columns)
    figure.legend(lines, names, loc="outside lower center", ncols=columns, frameon=False)
    if not hasattr(figure, "bare"):
        figure.bare = figure.get_figheight()
    figure.set_figheight(figure.bare + 0.2 * rows)
