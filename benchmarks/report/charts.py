"""Charts of frames, of a panel, and over what was swept, in matplotlib's own colours.

A label that is a category has the colour and mark of its place among all categories, so that a
method looks the same in every chart of a page.
"""

import io
import math
from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from benchmarks.pictures import styled
from benchmarks.tables.frames import errors_by_offset, lap_errors, share_curve, whole_runs
from benchmarks.tables.panels import Panel, disturbance_words, is_number
from benchmarks.tables.stats import ALPHA, Interval
from benchmarks.tables.text import estimated
from benchmarks.trials.scores import JOURNEY_SCORES, Score

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
_WIDE = 20  # a ratio of values above it is drawn on a logarithmic axis
_MARKS = "osD^vPX<>h"
_LETTERS = 60  # of a legend, side by side
_TICKS = 8  # values that are named on an axis
_MANY = 30  # worlds whose marks fit side by side
_FAR = 3  # times the baseline's error: differences beyond it would hide all others
_CURVES = {  # by score: title, what the axis of shares says, caption
    "metres_to_localize": (
        "Localized against metres driven",
        "localized to the end, % of runs",
        "Share of runs whose best cluster stays within 1 m and 30° of the truth from there to the "
        "end.",
    ),
    "metres_to_recover": (
        "Recovered against metres driven",
        "recovered, % of runs",
        "Share of runs that are recovered, against the metres driven since the kidnap.",
    ),
}


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
    *,
    axes: "Axes | None" = None,
    band: bool = False,
    **how: Any,
) -> "Axes":
    """Draw y over x, a line for each label, with intervals as bars or as a band.

    Args:
        frame: a row per point; x, y, low, high are columns, without low there are no intervals.
        axes: to draw on; None: those of a new figure.
        band: a band, and no marks.
        how: for ``Axes.plot``.
    """
    axes = canvas() if axes is None else axes
    for label, place, rows in _labels(frame):
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


def name_ticks(axes: "Axes", values: Sequence[float]) -> None:
    """Name the few values on the axis across; on a logarithmic one where they are far apart."""
    known = sorted({value for value in values if math.isfinite(value)})
    if known and known[0] > 0 and known[-1] / known[0] >= _TICKS:
        axes.set_xscale("log")
    if len(known) <= _TICKS:
        axes.set_xticks(known, [f"{value:g}" for value in known])
        axes.set_xticks([], minor=True)


def _labels(frame: pd.DataFrame) -> list[tuple[str, int, pd.DataFrame]]:
    """Labels, their places among all, and their rows, in the order of the frame."""
    labels = list(frame["label"].unique())
    whole = isinstance(frame["label"].dtype, pd.CategoricalDtype)
    every = list(frame["label"].cat.categories) if whole else labels
    return [(str(one), every.index(one), frame[frame["label"] == one]) for one in labels]


def _legend(axes: "Axes") -> None:
    """Name what is drawn below the axes."""
    figure: Any = axes.figure
    lines, labels = axes.get_legend_handles_labels()
    if not labels:
        return
    names = [fill(label, _LETTERS - 8) for label in labels]
    columns = max(1, min(4, len(labels), _LETTERS // (8 + max(map(len, labels)))))
    lines_of_one = 1 + max(name.count("\n") for name in names)
    rows = lines_of_one * math.ceil(len(labels) / columns)
    figure.legend(lines, names, loc="outside lower center", ncols=columns, frameon=False)
    figure.set_figheight(figure.get_figheight() + 0.2 * rows)


def panel_charts(panel: Panel) -> list[Chart]:
    """Return all charts of a panel for which there is something to draw."""
    charts = [points_chart(panel), offset_chart(panel), lap_chart(panel)]
    return journey_charts(panel) + [chart for chart in charts if chart is not None]


def points_chart(panel: Panel) -> Chart | None:
    """Every world's error, a row for each method, thin lines between those of a world."""
    rows = panel.present[panel.present["error"].notna()]
    if rows.empty:
        return None
    runs = panel.runs[(panel.runs["offset"] == 0) & ~panel.runs["failed"]]
    table = runs.pivot_table("error", "trial", "label", observed=True)[list(rows["label"])]
    spread = 0.3 if len(table) > _MANY else 0.0  # by golden steps, so that neighbours differ
    aside = ((np.arange(len(table)) * 0.618034) % 1 - 0.5) * spread
    places = np.arange(len(rows))
    axes = canvas(4.8, 0.9 + 0.42 * len(rows))
    faint = min(0.35, 8 / len(table))
    axes.plot(table.to_numpy().T, places[:, None] + aside, color=INK, alpha=faint, lw=0.7)
    for place, (label, number, own) in enumerate(_labels(rows)):
        style = look(number) | {"ls": "", "ms": 5 if spread == 0 else 3.5, "mew": 0, "alpha": 0.75}
        axes.plot(table[label], place + aside, **style)
        axes.plot(own[["error_low", "error_high"]].iloc[0], [place - 0.3] * 2, color=INK, lw=1.6)
        axes.plot(own["error"], [place - 0.3], "|", color=INK, ms=8, mew=2)
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


def lap_chart(panel: Panel) -> Chart:
    """Error over the lap."""
    drawn = [lap_errors(own).assign(label=label) for label, own in panel.records_by_label.items()]
    frame = panel.labelled(pd.concat(drawn))
    axes = line(frame, "states", "mean", "low", "high", band=True)
    axes.set(xlabel="step of the state", ylabel="error e", xlim=(0, None), ylim=(0, None))
    return Chart(
        f"lap-errors-{panel.number}",
        "Error over the lap",
        "Line: mean over runs at x[t]; band: the middle 80 % of runs.",
        axes.figure,
    )


def offset_chart(panel: Panel) -> Chart | None:
    """Error against the offset in the queue, over the same states for every offset."""
    profiles = {
        label: errors_by_offset(records) for label, records in panel.records_by_label.items()
    }
    if all(len(own) < 2 for own in profiles.values()):
        return None
    lines = [(label, k, *one) for label, own in profiles.items() for k, one in own.items()]
    frame = panel.labelled(pd.DataFrame(lines, columns=["label", "offset", *Interval._fields]))
    axes = line(frame, "offset", "mean", "low", "high")
    axes.axvline(0, color=INK, lw=0.8)
    axes.set(xlabel="offset k of the state x[t+k] (past < 0 < future)", ylabel="error e")
    axes.set_ylim(0, None)
    axes.locator_params(axis="x", integer=True)
    return Chart(
        f"offsets-{panel.number}",
        "Along the queue",
        "Error of the belief at t about x[t+k], over the same states for every k; bars: 95 % "
        "bootstrap intervals over worlds. A method without a queue is a single mark.",
        axes.figure,
    )


def journey_charts(panel: Panel) -> list[Chart]:
    """Shares of runs against the metres driven, for each score with censoring."""
    charts = []
    runs = (run for own in panel.records.values() for run in own if run.journey)
    end = max((run.journey.curves["way"][-1] for run in runs if run.journey), default=0.0)
    for name, (title, axis, caption) in _CURVES.items():
        if name not in panel.rows:
            continue
        curves = [
            share_curve(whole_runs(panel.runs_of(label), JOURNEY_SCORES[name])).assign(label=label)
            for label in panel.present["label"]
        ]
        last = [own.tail(1).assign(metres=end) for own in curves]  # each goes on to the end
        frame = panel.labelled(pd.concat([*curves, *last]))
        frame[["share", "low", "high"]] *= 100
        axes = line(frame, "metres", "share", "low", "high", band=True, drawstyle="steps-post")
        axes.set(xlabel="driven, m", xlim=(0, end), ylabel=axis, ylim=(0, 102))
        charts.append(
            Chart(
                f"{name.replace('_', '-')}-{panel.number}",
                title,
                f"{caption} Bands: Wilson's 95 % interval at each distance.",
                axes.figure,
            )
        )
    return charts


def swept_charts(panels: Sequence[Panel]) -> list[Chart]:
    """Charts over each number that was swept: maps if three were and runs are scored, else lines.

    Where several are swept, there is a chart for every value of the others. None where methods
    stopped after as many worlds as their decisions needed.
    """
    if any(panel.rule for panel in panels):
        return []
    places = [place_of(panel) for panel in panels]
    axes, charts = swept_axes(places), list[Chart]()
    if len(axes) == 3 and all(panel.aim for panel in panels):
        charts = _maps(panels, places, list(axes))
    if charts:
        return charts
    for key, others in axes.items():
        groups: dict[frozenset[tuple[str, Any]], list[int]] = {}
        for n, place in enumerate(places):
            if is_number(place.get(key)):
                rest = frozenset((k, v) for k, v in place.items() if k not in (key, *others))
                groups.setdefault(rest, []).append(n)
        shared = frozenset.intersection(*groups)
        groups = {rest: own for rest, own in groups.items() if len(own) > 1}
        for rest, members in groups.items():
            where = ", ".join(
                f"{name_of(name)} {value}" for name, value in sorted(rest - shared, key=str)
            )
            rows = pd.concat(
                panels[n].ranked.assign(**{key: places[n][key]}).sort_index() for n in members
            ).sort_values(key, kind="stable")
            aims = {panels[n].aim for n in members}
            charts += _lines(rows, key, others, where, aims.pop() if len(aims) == 1 else None)
    return [chart._replace(name=f"{chart.name}-{n // 2 + 1}") for n, chart in enumerate(charts)]


def place_of(panel: Panel) -> dict[str, Any]:
    """Return where a panel lies: all that can be swept, by dotted name."""
    setting = panel.setting
    disturbed = ", ".join(map(disturbance_words, setting.disturbance)) or "undisturbed"
    parts = {"world": setting.world, "assumed": setting.assumed, "params": panel.swept}
    named = {f"{part}.{name}": v for part, own in parts.items() for name, v in own.items()}
    return {
        "scenario": setting.scenario, "disturbance": disturbed, "lag": setting.lag,
        "seed": setting.seed, **named,
    }  # fmt: skip


def swept_axes(places: Sequence[dict[str, Any]]) -> dict[str, list[str]]:
    """Coordinates with two numbers or more, each with those that change together with it.

    Of those that do, the one with the values of most: of noises in drift, drive and turn, drive.
    """
    keys = dict.fromkeys(key for place in places for key in place if key != "seed")
    varying = [key for key in keys if len({p[key] for p in places if is_number(p.get(key))}) > 1]
    found: dict[str, list[str]] = {}
    for key in varying:
        if any(key in others for others in found.values()):
            continue
        group = [key, *(k for k in varying if k != key and _together(key, k, places))]
        values = {k: [place.get(k) for place in places] for k in group}
        axis = max(group, key=lambda k: list(values.values()).count(values[k]))
        found[axis] = [k for k in group if k != axis]
    return found


def name_of(key: str) -> str:
    """Return what a coordinate is called: as in a sweep file, without its group."""
    return key.removeprefix("world.").removeprefix("params.")


def _together(one: str, other: str, places: Sequence[dict[str, Any]]) -> bool:
    pairs = {(place[one], place[other]) for place in places if one in place and other in place}
    return bool(pairs) and len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


def _lines(
    rows: pd.DataFrame, key: str, others: Sequence[str], where: str, aim: Score | None
) -> list[Chart]:
    """The score, and the difference to the baseline, over one number."""
    scale, unit = (1, "error e of x[t]") if aim is None else (100, "% of runs")
    numbers = [f"{name}{end}" for name in ("score", "apart") for end in ("", "_low", "_high")]
    rows[numbers] = rows[numbers].astype(float) * scale
    swept, place = name_of(key), f": {where}" if where else ""
    of = "Error" if aim is None else f"Runs {aim.words.partition(' (')[0]}"
    score, apart = (_curve(rows, key, column) for column in ("score", "apart"))
    over = swept + (f" (with {', '.join(map(name_of, others))})" if others else "")
    score.set(xlabel=over, ylabel=unit)
    apart.set(xlabel=over, ylabel=f"{unit} - the baseline's")
    known = rows.loc[np.isfinite(rows["score"]) & (rows["score"] > 0), "score"]
    if aim is None and len(known) and known.max() / known.min() > _WIDE:
        score.set_yscale("log")
        score.yaxis.set_major_formatter("{x:g}")
    else:
        score.set_ylim(0, None)
    if aim is None and rows["apart"].notna().any():
        most = _FAR * rows.loc[rows["is_baseline"], "score"].max()
        low, high = apart.get_ylim()
        apart.set_ylim(max(low, -most), min(high, most))
    everywhere = (
        "A method without this parameter is the same everywhere. Bars: 95 % intervals over worlds."
    )
    outside = (
        "On the same worlds; bars: 95 % bootstrap intervals over worlds. Differences beyond "
        f"{_FAR} times the baseline's error are outside."
    )
    return [
        Chart("curve", f"{of} over {swept}{place}", everywhere, score.figure),
        Chart("difference", f"Difference over {swept}{place}", outside, apart.figure),
    ]


def _curve(rows: pd.DataFrame, key: str, column: str) -> Any:
    axes = line(rows[rows[column].notna()], key, column, f"{column}_low", f"{column}_high")
    name_ticks(axes, list(rows[key]))
    axes.axhline(0, color=INK, lw=0.8)
    return axes


def _maps(
    panels: Sequence[Panel], places: Sequence[dict[str, Any]], keys: Sequence[str]
) -> list[Chart]:
    """A map for every tested score of whole runs and every method beside the baseline."""
    x, y, square = map(name_of, keys)
    frame = pd.concat(
        panel.present.assign(**dict(zip((x, y, square), map(place.get, keys), strict=True)))
        for panel, place in zip(panels, places, strict=True)
        if all(key in place for key in keys)
    )
    scores = [one for n, one in JOURNEY_SCORES.items() if one.tested and n in frame]
    charts = []
    for number, label in enumerate(frame.loc[~frame["is_baseline"], "label"].unique(), 1):
        for score in scores:
            rows = frame[frame["label"] == label].copy()
            share, name = score.unit == "share", score.name
            scale = 100 if share else 1
            ends = rows[[f"{name}_diff{end}" for end in ("", "_low", "_high")]] * scale
            form = "+.0f" if share else "+.1f"
            clear = rows[f"{name}_p_holm"] < ALPHA
            rows["words"] = [
                estimated(Interval(*one), form).replace(" (", f"{' *' * sure}\n(")
                for one, sure in zip(ends.itertuples(index=False), clear, strict=True)
            ]
            rows["ahead"] = (-1 if score.censored else 1) * rows[f"{name}_diff"].fillna(0)
            file, what = name.replace("_", "-"), score.words.removesuffix(", median")
            caption = (
                f"Difference to the baseline in {'points' if share else 'metres'}, and its 95 % "
                "interval. Blue: ahead; red: behind; *: p < 0.05, corrected for the tests of a "
                "setting, not for the number of settings."
            )
            drawn = cells(rows, x, y, square, "ahead", "words", least=0.1 if share else 1.0)
            title = f"Where {label} is ahead: {what}"
            charts.append(Chart(f"regimes-{file}-{number}", title, caption, drawn))
    return charts
