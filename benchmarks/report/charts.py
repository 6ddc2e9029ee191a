"""Charts of frames, of a panel, and over the numbers that were swept, in matplotlib's own colours.

A label that is a category has the colour and mark of its place among all categories, so that a
method looks the same in every chart of a page.
"""

import io
import logging
import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from benchmarks.report.tables import means
from benchmarks.tables import percent
from benchmarks.tables.frames import errors_by_offset, share_curve, whole_runs
from benchmarks.tables.panels import Panel, disturbance_words, is_number
from benchmarks.tables.stats import ALPHA
from benchmarks.trials.scores import JOURNEY_SCORES, Score
from benchmarks.trials.tracks import TOLERATED

if TYPE_CHECKING:  # an optional extra
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it warns of a home that is read-only
_STYLE: Any = {  # over matplotlib's defaults
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
_OTHER_SCRIPTS = (  # fonts on Linux, macOS and Windows
    "Noto Sans CJK SC", "Noto Sans CJK JP", "WenQuanYi Zen Hei",
    "PingFang SC", "Hiragino Sans", "Microsoft YaHei", "Yu Gothic", "Malgun Gothic",
)  # fmt: skip
_MARKS = "osD^vPX<>h"
_LETTERS = 60  # of a legend, side by side
_TICKS = 8  # values that are named on an axis
_CURVES = {  # by score: title, what the axis of shares says, caption
    "metres_to_localize": (
        "Localized against metres driven",
        "localized to the end, % of runs",
        "Share of runs whose best cluster {stays} within 1 m and 30° of the truth from there to "
        "the end.",
    ),
    "metres_to_recover": (
        "Recovered against metres driven",
        "recovered, % of runs",
        "Share of runs that are recovered, against the metres driven since the kidnap.",
    ),
}


@contextmanager
def styled(salt: str = "") -> Iterator[None]:
    """Draw in our style, whatever a user's matplotlibrc says; ``salt`` makes the ids of an SVG."""
    import matplotlib as mpl  # an optional extra
    from matplotlib.font_manager import fontManager

    installed = {font.name for font in fontManager.ttflist}
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from")  # it is drawn as a box
        mpl.rcdefaults()
        others = [n for n in _OTHER_SCRIPTS if n in installed]  # letters that DejaVu Sans lacks
        mpl.rcParams["font.sans-serif"] = ["DejaVu Sans", *others]
        mpl.rcParams.update(_STYLE | {"svg.hashsalt": salt})
        yield


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
        with styled(self.name):
            self.figure.savefig(buffer, format=form, metadata={stamp: None}, **how)
        return buffer.getvalue()


def canvas(width: float = 4.8, height: float = 3.2) -> "Axes":
    """Return the axes of an empty figure, inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained").subplots()


def line(
    frame: pd.DataFrame,
    x: str,
    y: str,
    *ends: str,
    axes: "Axes | None" = None,
    band: bool = False,
    **how: Any,
) -> "Axes":
    """Draw column y over x, a line per label; between two ``ends``, if any, bars or a ``band``."""
    axes = canvas() if axes is None else axes
    for label, (color, mark), rows in _labels(frame):
        style: dict[str, Any] = {"color": color, "label": label}
        style |= ({} if band else {"marker": mark, "ms": 5}) | how
        axes.plot(rows[x], rows[y], **style)
        if not ends:
            continue
        across, low, high = rows[[x, *ends]].astype(float).to_numpy().T
        if band:
            stepped: Any = {"step": "post"} if how.get("drawstyle") == "steps-post" else {}
            axes.fill_between(across, low, high, color=color, alpha=0.15, lw=0, **stepped)
        else:
            axes.vlines(across, low, high, color=color, lw=1)
    _legend(axes)
    return axes


def _cells(
    frame: pd.DataFrame,
    over: tuple[str, str, str],
    value: str,
    least: float,
    bold: float = math.inf,
) -> "Figure":
    """Draw rows as cells with their words: x across, y upwards, a square per value of z.

    They are blue above 0 and red below, fully from ``least`` or more on; words are bold from
    ``bold`` on.
    """
    from matplotlib.figure import Figure

    x, y, square = over
    across, upwards = (sorted(frame[name].unique()) for name in (x, y))
    squares = sorted(frame[square].unique(), key=lambda key: 0 if isinstance(key, str) else key)
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
            weight = "bold" if row[value] >= bold else "normal"
            axes.text(*place, row["words"], ha="center", va="center", size=9, weight=weight)
        axes.set_xticks(range(len(across)), [f"{v:g}" for v in across])
        axes.set_yticks(range(len(upwards)), [f"{v:g}" for v in upwards])
        axes.set(xlabel=x, title=which if isinstance(which, str) else f"{square} {which:g}")
        axes.grid(visible=False)
    each[0].set_ylabel(y)
    return figure


def _labels(frame: pd.DataFrame) -> Iterator[tuple[str, tuple[str, str], pd.DataFrame]]:
    """Labels in the order of the frame, colour and mark of their places among all, their rows."""
    labels = list(frame["label"].unique())
    categorical = isinstance(frame["label"].dtype, pd.CategoricalDtype)
    every = list(frame["label"].cat.categories) if categorical else labels
    for label in labels:
        place = every.index(label)
        look = f"C{place % 10}", _MARKS[(place + place // 10) % len(_MARKS)]
        yield str(label), look, frame[frame["label"] == label]


def _legend(axes: "Axes") -> None:
    """Name what is drawn below the axes."""
    figure: Any = axes.figure
    lines, labels = axes.get_legend_handles_labels()
    if not labels:
        return
    names = [fill(label, _LETTERS - 8) for label in labels]
    columns = max(1, min(4, len(labels), _LETTERS // (8 + max(map(len, labels)))))
    lines_per_name = 1 + max(name.count("\n") for name in names)
    rows = lines_per_name * math.ceil(len(labels) / columns)
    figure.legend(lines, names, loc="outside lower center", ncols=columns, frameon=False)
    figure.set_figheight(figure.get_figheight() + 0.2 * rows)


def panel_charts(panel: Panel) -> list[Chart]:
    """Return all charts of a panel for which there is something to draw."""
    charts = [offset_chart(panel)]  # the error e; of logs that of best clusters is drawn
    if panel.world == "world":
        charts = [points_chart(panel), *charts]
    return journey_charts(panel) + [chart for chart in charts if chart is not None]


def points_chart(panel: Panel) -> Chart | None:
    """Every world's error, a row for each method, thin lines between those of a world."""
    rows = panel.present[panel.present["error"].notna()]
    if rows.empty:
        return None
    runs = panel.runs[(panel.runs["offset"] == 0) & ~panel.runs["failed"]]
    table = runs.pivot_table("error", "trial", "label", observed=True)[list(rows["label"])]
    places = np.arange(len(rows))
    axes = canvas(4.8, 0.9 + 0.42 * len(rows))
    faint = min(0.35, 8 / len(table))
    axes.plot(table.to_numpy().T, places, color=INK, alpha=faint, lw=0.7)
    for place, (label, (color, mark), row) in enumerate(_labels(rows)):
        marks = axes.plot(table[label], np.full(len(table), place), mark, color=color, ls="")
        marks[0].set(ms=4, mew=0, alpha=0.75)
        axes.plot(row[["error_low", "error_high"]].iloc[0], [place - 0.3] * 2, color=INK, lw=1.6)
        axes.plot(row["error"], [place - 0.3], "|", color=INK, ms=8, mew=2)
    axes.set_yticks(places, [fill(str(label), 28) for label in rows["label"]])
    axes.set(ylim=(len(rows) - 0.5, -0.6), xlim=(0, None))
    axes.set_xlabel("error e of x[t], mean over the lap")
    axes.grid(visible=False, axis="y")
    return Chart(
        f"points-{panel.number}",
        "Every world",
        "A mark per world and method; thin lines connect the same world. Above each row: the mean "
        "with its 95 % bootstrap interval.",
        axes.figure,
    )


def offset_chart(panel: Panel) -> Chart | None:
    """Error against the offset in the queue, over the same states for every offset."""
    curves = [errors_by_offset(runs).assign(label=label) for label, runs in panel.records.items()]
    if all(len(curve) < 2 for curve in curves):
        return None
    axes = line(panel.labelled(pd.concat(curves)), "offset", "mean", "low", "high")
    axes.axvline(0, color=INK, lw=0.8)
    axes.set(xlabel="offset k of the state x[t+k] (past < 0 < future)", ylabel="error e")
    axes.set_ylim(0, None)
    axes.locator_params(axis="x", integer=True)
    return Chart(
        f"offsets-{panel.number}",
        "Along the queue",
        "Error of the belief at t about x[t+k], over the same states for every k; bars: 95 % "
        f"bootstrap intervals over {panel.world}s. A method without a queue is a single mark.",
        axes.figure,
    )


def journey_charts(panel: Panel) -> list[Chart]:
    """Shares of runs against the metres driven, for each score with censoring."""
    charts = []
    stays = f"is at {percent(1 - TOLERATED)} of the records" if panel.world == "run" else "stays"
    end = panel.runs["way"].max()
    for name, (title, axis, caption) in _CURVES.items():
        if name not in panel.rows:
            continue
        curves = [
            share_curve(whole_runs(panel.runs_of(label), JOURNEY_SCORES[name])).assign(label=label)
            for label in panel.present["label"]
        ]
        last = [curve.tail(1).assign(metres=end) for curve in curves]  # each goes on to the end
        frame = panel.labelled(pd.concat([*curves, *last]))
        frame[["share", "low", "high"]] *= 100
        axes = line(frame, "metres", "share", "low", "high", band=True, drawstyle="steps-post")
        axes.set(xlabel="driven, m", xlim=(0, end), ylabel=axis, ylim=(0, 102))
        charts.append(
            Chart(
                f"{name.replace('_', '-')}-{panel.number}",
                title,
                f"{caption.format(stays=stays)} Bands: Wilson's 95 % interval at each distance.",
                axes.figure,
            )
        )
    return charts


_ANGLE = "assumed.prior.angle"  # rad; of a start that is wrong
_MOSTLY = 0.9  # share of runs from which on a cell is bold
_WIDE = 20  # a ratio of values above it is drawn on a logarithmic axis


def swept_charts(panels: Sequence[Panel]) -> list[Chart]:
    """Charts over each number that was swept: maps if two or three were and runs are scored.

    Where several are swept, there is a chart for every value of the others. There is none where
    methods stopped after as many worlds as their decisions needed.
    """
    if any(panel.rule for panel in panels):
        return []
    places = [place_of(panel) for panel in panels]
    axes = swept_axes(places)
    points = {tuple(place.get(key) for key in axes) for place in places}
    mapped = len(axes) in (2, 3) and len(points) == len(places)
    if mapped and all(panel.aim for panel in panels) and (maps := _maps(panels, places, [*axes])):
        return maps
    charts = list[Chart]()
    for key, others in axes.items():
        groups: dict[frozenset[tuple[str, Any]], list[int]] = {}
        for n, place in enumerate(places):
            if is_number(place.get(key)):
                rest = frozenset((k, v) for k, v in place.items() if k not in (key, *others))
                groups.setdefault(rest, []).append(n)
        shared = frozenset.intersection(*groups)
        groups = {rest: members for rest, members in groups.items() if len(members) > 1}
        for rest, members in groups.items():
            fixed = sorted(rest - shared, key=str)
            where = ", ".join(f"{name_of(name)} {value}" for name, value in fixed)
            rows = pd.concat(
                panels[n].ranked.assign(**{key: places[n][key]}).sort_index() for n in members
            ).sort_values(key, kind="stable")
            aims = {panels[n].aim for n in members}
            charts.append(_curve(rows, key, others, where, aims.pop() if len(aims) == 1 else None))
    return [chart._replace(name=f"curve-{n}") for n, chart in enumerate(charts, 1)]


def place_of(panel: Panel) -> dict[str, Any]:
    """Return where a panel lies: all that can be swept, by dotted name."""
    setting = panel.setting
    disturbed = ", ".join(map(disturbance_words, setting.disturbance)) or "undisturbed"
    parts = {"world": setting.world, "assumed": setting.assumed, "params": panel.swept}
    named = {f"{part}.{name}": v for part, values in parts.items() for name, v in values.items()}
    return {
        "scenario": setting.scenario, "disturbance": disturbed, "lag": setting.lag,
        "seed": setting.seed, **named,
    }  # fmt: skip


def swept_axes(places: Sequence[dict[str, Any]]) -> dict[str, list[str]]:
    """Coordinates with two numbers or more, with those of fewer values that change with them."""
    keys = dict.fromkeys(key for place in places for key in place if key != "seed")
    varying = [key for key in keys if len({p[key] for p in places if is_number(p.get(key))}) > 1]
    axes: dict[str, list[str]] = {}
    for key in varying:
        if any(key in others for others in axes.values()):
            continue
        group = [key, *(k for k in varying if k != key and _together(key, k, places))]
        values = {k: [place.get(k) for place in places] for k in group}
        axis = max(group, key=lambda k: list(values.values()).count(values[k]))
        axes[axis] = [k for k in group if k != axis]
    return axes


def name_of(key: str) -> str:
    """Return what a coordinate is called: as in a sweep file, without its group."""
    return key.removeprefix("world.").removeprefix("params.")


def _together(key: str, other: str, places: Sequence[dict[str, Any]]) -> bool:
    pairs = {(place[key], place[other]) for place in places if key in place and other in place}
    return bool(pairs) and len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


def _curve(rows: pd.DataFrame, key: str, others: list[str], where: str, aim: Score | None) -> Chart:
    scale, unit = (1, "error e of x[t]") if aim is None else (100, "% of runs")
    numbers = ["score", "score_low", "score_high"]
    rows[numbers] = rows[numbers].astype(float) * scale
    axes = line(rows[rows["score"].notna()], key, *numbers)
    values = sorted({value for value in rows[key] if math.isfinite(value)})
    if values and values[0] > 0 and values[-1] / values[0] >= _TICKS:
        axes.set_xscale("log")
    if len(values) <= _TICKS:
        axes.set_xticks(values, [f"{value:g}" for value in values])
        axes.set_xticks([], minor=True)
    swept, place = name_of(key), f": {where}" if where else ""
    over = swept + (f" (with {', '.join(map(name_of, others))})" if others else "")
    axes.set(xlabel=over, ylabel=unit)
    positive = rows.loc[np.isfinite(rows["score"]) & (rows["score"] > 0), "score"]
    if aim is None and len(positive) and positive.max() / positive.min() > _WIDE:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
    else:
        axes.set_ylim(0, None)
    of = "Error" if aim is None else f"Runs {aim.words.partition(' (')[0]}"
    caption = (
        "A method without this parameter is the same everywhere. Bars: 95 % intervals over worlds."
    )
    return Chart("curve", f"{of} over {swept}{place}", caption, axes.figure)


def _maps(panels: Sequence[Panel], places: list[dict[str, Any]], keys: list[str]) -> list[Chart]:
    """Maps over two numbers of the share of runs, over three of each test of each method."""
    names = {key: f"{key}, °" if key == _ANGLE else name_of(key) for key in keys}
    frame = pd.concat(
        panel.present.assign(**{name: place[key] for key, name in names.items()})
        for panel, place in zip(panels, places, strict=True)
        if all(key in place for key in keys)
    )
    if _ANGLE in names:
        frame[names[_ANGLE]] = np.degrees(frame[names[_ANGLE]]).round(1)
    x, y, *squares = names.values()
    if not squares:
        aim = panels[0].aim
        assert aim is not None
        shares = [cell.replace(" (", "\n(") for cell in means(frame, aim.name, ".0f", " %", 100)]
        method, share = frame["label"].astype(str), frame[aim.name].astype(float)
        rows = frame.assign(method=method, share=share, words=shares)
        caption = (
            "Share of runs, and Wilson's 95 % interval, with every value of the two numbers; "
            f"{percent(_MOSTLY)} or more is bold."
        )
        figure = _cells(rows, (x, y, "method"), "share", 1.0, _MOSTLY)
        return [Chart("shares", f"Runs {aim.words}", caption, figure)]
    return [
        _regimes(frame[frame["label"] == label].copy(), (x, y, squares[0]), score, number)
        for number, label in enumerate(frame.loc[~frame["is_baseline"], "label"].unique(), 1)
        for score in JOURNEY_SCORES.values()
        if score.tested and score.name in frame
    ]


def _regimes(rows: pd.DataFrame, axes: tuple[str, str, str], score: Score, number: int) -> Chart:
    """A map of where a method is ahead of its baseline in a score."""
    name, share = score.name, score.unit == "share"
    form, scale = ("+.0f", 100) if share else ("+.1f", 1)
    differences = means(rows, f"{name}_diff", form, scale=scale)
    rows["words"] = [
        cell.replace(" (", f"{' *' * clear}\n(")
        for cell, clear in zip(differences, rows[f"{name}_p_holm"] < ALPHA, strict=True)
    ]
    rows["ahead"] = (-1 if score.censored else 1) * rows[f"{name}_diff"].fillna(0)
    return Chart(
        f"regimes-{name.replace('_', '-')}-{number}",
        f"Where {rows['label'].iloc[0]} is ahead: {score.words.removesuffix(', median')}",
        f"Difference to the baseline in {'points' if share else 'metres'}, and its 95 % interval. "
        "Blue: ahead; red: behind; *: p < 0.05, corrected for the tests of a setting, not for the "
        "number of settings.",
        _cells(rows, axes, "ahead", 0.1 if share else 1.0),
    )
