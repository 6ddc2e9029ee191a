"""The charts of a panel, and those over what was swept."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.report.charts import (
    INK,
    Chart,
    canvas,
    cells,
    from_zero,
    line,
    points,
    scaled,
)
from benchmarks.report.frames import PanelFrames
from benchmarks.tables.frames import lap_errors, profile, share_curve, whole_runs
from benchmarks.tables.panels import disturbance_words, is_number
from benchmarks.tables.stats import ALPHA, Estimate
from benchmarks.tables.text import estimated, percent
from benchmarks.trials.scores import JOURNEY_SCORES, LEVELS, Score

MOSTLY = 0.9  # share of runs from which on a cell is bold
_ANGLE = "assumed.prior.angle"  # rad; of a start that is wrong
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


def panel_charts(panel: PanelFrames) -> list[Chart]:
    """Return all charts of a panel for which there is something to draw."""
    made = (decision_chart, points_chart, offset_chart, coverage_chart, speed_chart, lap_chart)
    charts = [chart for make in made if (chart := make(panel)) is not None]
    return journey_charts(panel) + charts


def points_chart(panel: PanelFrames) -> Chart | None:
    """Every world's error by method."""
    rows = panel.present[panel.present["error"].notna()]
    if rows.empty:
        return None
    worlds = panel.trials[panel.trials["offset"] == 0]
    means = worlds.groupby(["label", "trial"], observed=True)["error"].mean().reset_index()
    axes = points(means, "error", rows, "error_low", "error_high")
    axes.set_xlabel("error e of x[t], mean over the lap")
    return Chart(
        f"points-{panel.number}",
        "Every world",
        "A mark per world and method; thin lines connect the same world. Above each row: the mean "
        "with its 95 % bootstrap interval.",
        axes.figure,
    )


def lap_chart(panel: PanelFrames) -> Chart:
    """Error over the lap."""
    drawn = [lap_errors(own).assign(label=label) for label, own in panel.records.items()]
    frame = panel.labelled(pd.concat(drawn))
    axes = line(frame, "states", "mean", "low", "high", band=True)
    axes.set(xlabel="step of the state", ylabel="error e", xlim=(0, None), ylim=(0, None))
    return Chart(
        f"lap-errors-{panel.number}",
        "Error over the lap",
        "Line: mean over runs at x[t]; band: the middle 80 % of runs.",
        axes.figure,
    )


def offset_chart(panel: PanelFrames) -> Chart | None:
    """Error against the offset in the queue, over the same states for every offset."""
    profiles = {label: profile(records) for label, records in panel.records.items()}
    if all(len(own) < 2 for own in profiles.values()):
        return None
    lines = [(label, k, *one) for label, own in profiles.items() for k, one in own.items()]
    frame = panel.labelled(pd.DataFrame(lines, columns=["label", "offset", *Estimate._fields]))
    axes = line(frame, "offset", "mean", "low", "high")
    axes.axvline(0, color=INK, lw=0.8)
    axes.set(xlabel="offset k of the state x[t+k] (past < 0 < future)", ylabel="error e")
    from_zero(axes, frame["mean"])
    axes.locator_params(axis="x", integer=True)
    return Chart(
        f"offsets-{panel.number}",
        "Along the queue",
        "Error of the belief at t about x[t+k], over the same states for every k; bars: 95 % "
        "bootstrap intervals over worlds. A method without a queue is a single mark.",
        axes.figure,
    )


def speed_chart(panel: PanelFrames) -> Chart | None:
    """Error against the localizer's time per step."""
    rows = panel.present[panel.present["ms_per_step"].notna()]
    if rows.empty:
        return None
    axes = line(rows, "ms_per_step", "error", "error_low", "error_high", ls="", ms=7)
    times = rows["ms_per_step"]
    if times.min() > 0 and times.max() > 8 * times.min():
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
    else:
        axes.set_xlim(0, None)
    axes.set(
        xlabel="time per step, ms (median over runs)", ylabel="error e of x[t]", ylim=(0, None)
    )
    return Chart(
        f"speed-{panel.number}",
        "Accuracy and time",
        "Lower and further left is better. Times were measured while the trials ran, on a "
        "machine that may have been busy with other work.",
        axes.figure,
    )


def coverage_chart(panel: PanelFrames) -> Chart | None:
    """Share of states inside the credible regions against their level."""
    rows = panel.present[panel.present["coverage_50"].notna()]
    if rows.empty:
        return None
    frames = []
    for level in LEVELS:
        shares = 100 * rows[[f"coverage_{level}{end}" for end in ("", "_low", "_high")]]
        shares.columns = ["share", "low", "high"]
        aside = 1.2 * (np.arange(len(rows)) - (len(rows) - 1) / 2)
        frames.append(shares.assign(label=rows["label"], level=level + aside))
    axes = canvas()
    axes.plot([0, 100], [0, 100], "--", color=INK, lw=0.9, label="calibrated")
    line(pd.concat(frames), "level", "share", "low", "high", axes=axes)
    axes.set(xlim=(40, 102), ylim=(0, 102), xticks=list(LEVELS))
    axes.set(xlabel="level of the credible region, %", ylabel="truth inside, % of states")
    return Chart(
        f"coverage-{panel.number}",
        "Coverage",
        "How often the truth lies inside the belief's credible regions of x[t]. Below the dashed "
        "line a belief is overconfident, above it too cautious. Bars: 95 % bootstrap intervals "
        "over worlds; marks are spread horizontally.",
        axes.figure,
    )


def journey_charts(panel: PanelFrames) -> list[Chart]:
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


def decision_chart(panel: PanelFrames) -> Chart | None:
    """The way of every method to its decision: the difference against the worlds seen."""
    if panel.margin is None or panel.interims.empty:
        return None
    frame = panel.interims.copy()
    frame[["difference", "low", "high"]] *= 100
    ends = frame[["low", "high"]].replace([np.inf, -np.inf], np.nan)
    axes = canvas()
    axes.axhspan(-100 * panel.margin, 100 * panel.margin, color=INK, alpha=0.08, lw=0)
    axes.axhline(0, color=INK, lw=0.8)
    line(frame.assign(**ends), "worlds", "difference", "low", "high", axes=axes)
    last = ends.assign(label=frame["label"]).groupby("label", observed=True).tail(1)
    most = 1.15 * max(last[["low", "high"]].abs().max().max(), 200 * panel.margin)
    unit = "%" if panel.aim is None else "points"
    axes.set(xlabel="worlds seen", ylabel=f"difference, {unit}", xlim=(0, None))
    axes.set_ylim(-most, most)
    return Chart(
        f"decisions-{panel.number}",
        "The way to each decision",
        "Difference to the baseline after so many worlds, with the interval that holds at all "
        f"looks. Grey: the margin of {100 * panel.margin:g} %. A method stops where its interval "
        "lies beyond the margin or inside it.",
        axes.figure,
    )


def swept_charts(panels: Sequence[PanelFrames]) -> list[Chart]:
    """Charts over each number that was swept: maps if two or three were and runs are scored.

    Where several are swept, there is a chart for every value of the others. None where methods
    stopped after as many worlds as their decisions needed.
    """
    if any(panel.margin is not None for panel in panels):
        return []
    places = [place_of(panel) for panel in panels]
    axes = swept_axes(places)
    cells_apart = {tuple(place.get(key) for key in axes) for place in places}
    if (
        len(axes) in (2, 3)
        and len(cells_apart) == len(places)
        and all(panel.aim for panel in panels)
        and (charts := _maps(panels, places, list(axes)))
    ):
        return charts
    charts = []
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


def place_of(panel: PanelFrames) -> dict[str, Any]:
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
    from_zero(score, rows["score"].dropna() if aim is None else pd.Series(dtype=float))
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
    scaled(axes, list(rows[key]))
    axes.axhline(0, color=INK, lw=0.8)
    return axes


def _maps(
    panels: Sequence[PanelFrames], places: Sequence[dict[str, Any]], keys: Sequence[str]
) -> list[Chart]:
    """Maps over two numbers of the share of runs, over three of what is tested.

    Of the latter, one for every score of whole runs and every method beside the baseline.
    """
    told = {key: f"{key}, °" if key == _ANGLE else name_of(key) for key in keys}
    frame = pd.concat(
        panel.present.assign(
            **{
                name: np.degrees(place[key]).round(1) if key == _ANGLE else place[key]
                for key, name in told.items()
            }
        )
        for panel, place in zip(panels, places, strict=True)
        if all(key in place for key in keys)
    )
    x, y, *squares = told.values()
    if not squares:
        return [_share_map(frame, x, y, aim) for aim in {panel.aim for panel in panels} if aim]
    (square,) = squares
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
                estimated(Estimate(*one), form).replace(" (", f"{' *' * sure}\n(")
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


def _share_map(frame: pd.DataFrame, x: str, y: str, aim: Score) -> Chart:
    """A map of the share of runs for each method."""
    shares = frame[[aim.name, f"{aim.name}_low", f"{aim.name}_high"]].astype(float)
    words = [
        estimated(Estimate(*one).percent, ".0f", " %").replace(" (", "\n(")
        for one in shares.itertuples(index=False)
    ]
    rows = frame.assign(
        method=frame["label"].astype(str),
        share=shares[aim.name],
        words=words,
        mostly=shares[aim.name] >= MOSTLY,
    )
    drawn = cells(rows, x, y, "method", "share", "words", least=1.0, bold="mostly")
    caption = (
        "Share of runs, and Wilson's 95 % interval, with every value of the two numbers; "
        f"{percent(MOSTLY)} or more is bold."
    )
    return Chart("shares", f"Runs {aim.words}", caption, drawn)
