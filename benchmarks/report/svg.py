"""Matplotlib figures as SVG that takes its colours from the page it stands in."""

import io
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from textwrap import wrap
from typing import Any
from unicodedata import east_asian_width
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.pictures import fonts, styled
from benchmarks.tables.stats import Estimate

INK, FAINT = "#010203", "#010204"  # stand for the page's colours until the picture is written


@dataclass(frozen=True)
class Look:
    """Colour by name of a CSS variable, on light (its stand-in in pictures) and dark; a mark."""

    name: str
    color: str
    dark: str
    mark: str


Looks = Mapping[str, Look]  # by label

# After Okabe & Ito (2008): told apart under every common colour blindness.
_LOOKS = {
    "mcl": Look("blue", "#0072b2", "#4aa8e0", "o"),
    "mcl-smoother": Look("sky", "#56b4e9", "#8fd0f7", "s"),
    "mcl-map": Look("green", "#009e73", "#2fc79b", "^"),
    "mcl-map-smoother": Look("amber", "#e69f00", "#f5b83d", "v"),
    "mcl-plan": Look("purple", "#cc79a7", "#e6a3c7", "P"),
    "deq-mcl": Look("red", "#d55e00", "#ff8a3d", "D"),
    "dead-reckoning": Look("gray", "#777777", "#a8a8a8", "X"),
}
_MORE = (
    Look("brown", "#8c510a", "#d69a5b", ">"),
    Look("slate", "#44596e", "#9db4cb", "d"),
    Look("olive", "#8a7a00", "#d1c04a", "h"),
    Look("violet", "#6a51a3", "#a994e0", "<"),
    Look("teal", "#117a8b", "#4cc3d6", "*"),
    Look("rose", "#b2185d", "#f277ad", "p"),
    Look("lime", "#6b9a00", "#b5e04a", "H"),
    Look("navy", "#1f3b8f", "#8aa6ff", "8"),
)
LOOKS = (*_LOOKS.values(), *_MORE)


def looks(labels: Iterable[str]) -> dict[str, Look]:
    """Give each label a look of its own; those that we do not know take what is left, in order.

    Where there are more labels than colours, a colour is used again with other marks.
    """
    listed = list(dict.fromkeys(labels))
    left = [*_MORE, *(look for name, look in _LOOKS.items() if name not in listed)]
    strangers = [label for label in listed if label not in _LOOKS]
    taken = {
        label: replace(left[i % len(left)], mark=left[(i + i // len(left)) % len(left)].mark)
        for i, label in enumerate(strangers)
    }
    return {label: (_LOOKS | taken)[label] for label in listed}


_DPI = 200  # of a PNG
_LETTER, _MARK = 0.082, 0.46  # inches: of a letter in a legend, of a mark with its spacing
HOUSE_STYLE: Any = {  # over matplotlib's defaults, while charts are made
    "text.parse_math": False,  # a name with a $ is a name
    "svg.fonttype": "none",
    "font.sans-serif": ["DejaVu Sans"],  # in SVG no other is named: the reader's browser chooses
    "font.size": 10,
    "axes.titlesize": 10,
    "axes.labelsize": 10,
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "lines.linewidth": 1.6,
}


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure with its words, rendered when it is asked for.

    Attributes:
        name: file name without ending.
        title: heading.
        caption: what is to be seen.
        alt: for those who do not see it.
        figure: what is drawn, in stand-in colours.
    """

    name: str
    title: str
    caption: str
    alt: str
    figure: Figure

    @property
    def inline(self) -> str:
        """SVG to stand in the page: colours by CSS variables, so that it can be dark."""
        svg = self.source.replace(INK, "currentColor").replace(FAINT, "var(--faint)")
        for look in LOOKS:
            svg = svg.replace(look.color, f"var(--{look.name})")
        return svg

    @property
    def standalone(self) -> str:
        """SVG as a file of its own, on white."""
        card = '<rect width="100%" height="100%" fill="#ffffff"/>'
        svg = self.source.replace(INK, "#1f2328").replace(FAINT, "#dddddd")
        svg = re.sub(r"(<svg[^>]*>)", lambda tag: tag[1] + card, svg, count=1)
        return '<?xml version="1.0" encoding="UTF-8"?>\n' + svg

    @property
    def pdf(self) -> bytes:
        """PDF for print, with its text as text."""
        return self._printed("pdf", metadata={"CreationDate": None})

    @property
    def png(self) -> bytes:
        """PNG on white."""
        return self._printed("png", dpi=_DPI, metadata={"Software": None})

    def _printed(self, form: str, **how: Any) -> bytes:
        for axes in self.figure.axes:
            for line in (*axes.get_xgridlines(), *axes.get_ygridlines()):
                line.set_color("#dddddd")
        buffer = io.BytesIO()
        with styled(HOUSE_STYLE | {"pdf.fonttype": 42, "font.sans-serif": fonts()}):
            self.figure.savefig(buffer, format=form, **how)
        return buffer.getvalue()

    @cached_property
    def source(self) -> str:
        """The SVG in stand-in colours: drawn once, when it is first asked for."""
        buffer = io.StringIO()
        with styled(HOUSE_STYLE | {"svg.hashsalt": self.name}):
            self.figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
        svg = buffer.getvalue()
        svg = svg[svg.index("<svg") :]
        svg = re.sub(r"\s*<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
        svg = svg.replace("font-family: 'DejaVu Sans', sans-serif; ", "font-family: sans-serif; ")
        used = set(re.findall(r"#([\w.-]+)[\")]", svg))  # others would be on the page many times
        # smooth: else a browser that draws a map smaller leaves out rows, and with them walls
        svg = svg.replace("image-rendering:crisp-edges;image-rendering:pixelated", "")
        svg = re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in used else "", svg)
        width, height = (72 * inches for inches in self.figure.get_size_inches())
        opening = (
            f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
            f'viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}" role="img" '
            f"aria-label={quoteattr(self.alt)}><title>{escape(self.title)}</title>"
        )
        return re.sub(r"<svg[^>]*>", lambda _: opening, svg, count=1)


def canvas(
    width: float,
    height: float,
    *,
    left: float = 0.62,
    top: float = 0.12,
    legend_of: Collection[str] = (),
) -> tuple[Figure, Axes]:
    """Return an empty figure and its axes.

    Args:
        width, height: of the figure without the legend, inches.
        left, top: margins, inches.
        legend_of: labels of what is to be drawn, for which ``picture`` makes a legend.
    """
    columns = map("\n".join, _columns(legend_of, width))
    names = 0.225 * max((1 + column.count("\n") for column in columns), default=0)
    bottom, height = 0.5 + names, height + names
    figure = Figure(figsize=(width, height))
    box = (left / width, bottom / height, 1 - (left + 0.15) / width, 1 - (bottom + top) / height)
    return figure, figure.add_axes(box)


def estimates(
    axes: Axes,
    places: Sequence[float],
    values: Sequence[Estimate],
    look: Look,
    label: str,
    size: float = 5,
) -> None:
    """Draw means with their intervals, joined by a line."""
    bars = None
    if not any(math.isnan(value.low) for value in values):
        bars = [[v.mean - v.low for v in values], [v.high - v.mean for v in values]]
    axes.errorbar(
        places,
        [value.mean for value in values],
        yerr=bars,
        fmt=f"-{look.mark}",
        color=look.color,
        markersize=size,
        elinewidth=0.9,
        label=label,
    )


def picture(figure: Figure, *, name: str, title: str, caption: str, alt: str) -> Picture:
    """Return a figure, with the names of what it shows below its axes, as a picture."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if labels:
        columns = _columns(labels, figure.get_figwidth())
        figure.legend(
            handles,
            [label for column in columns for label in column],
            loc="lower center",
            ncols=len(columns),
            handlelength=1.6,
            frameon=False,
            columnspacing=0.9,
            labelspacing=0.4,
            borderpad=0.1,
        )
    return Picture(name=name, title=title, caption=caption, alt=alt, figure=figure)


def breadth(text: str) -> int:
    """Letters that a text is as broad as: Chinese, Japanese and Korean ones count twice."""
    return sum(1 + (east_asian_width(letter) in "WF") for letter in text)


def lines_of(text: str, letters: int) -> list[str]:
    """Break a text into lines of so many letters."""
    return wrap(text, max(1, letters * len(text) // max(1, breadth(text))))


def _columns(labels: Collection[str], width: float) -> list[list[str]]:
    """Labels in up to three columns that fit side by side; in one, those too long are wrapped."""
    listed = list(labels)
    for count in (2 if len(listed) == 4 else 3, 2):
        columns = [part.tolist() for part in np.array_split(listed, count) if part.size]
        if sum(_MARK + _LETTER * max(map(breadth, column)) for column in columns) <= width:
            return columns
    fitting = int((width - _MARK) / _LETTER)
    return [["\n".join(lines_of(label, fitting)) for label in listed]]
