"""The charts of a panel."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.report.panels import Panel
from benchmarks.report.samples import curves, milliseconds_per_step
from benchmarks.report.style import INK, Look
from benchmarks.report.svg import Picture, canvas, legend, picture
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.pairing import Method, per_world, world_scores
from benchmarks.tables.stats import paired_bootstrap
from benchmarks.trials.scoring import LEVELS
from deqmcl_gym.numerics.types import Floats

Looks = Mapping[Method, Look]

_WIDE = 4.8  # inches
_ROW = 30  # worlds whose marks fit side by side


def points_chart(panel: Panel, look: Looks) -> Picture:
    """Every world's error by method; thin lines join the same world."""
    methods = [row.method for row in panel.present]
    figure, axes = canvas(_WIDE, 0.9 + 0.42 * len(methods))
    errors = [world_scores(panel.own(method), "error") for method in methods]
    worlds = sorted(set().union(*errors))
    places = range(len(methods))
    height = {world: _spread(i, len(worlds)) for i, world in enumerate(worlds)}
    thin = min(0.35, 8 / max(len(worlds), 1))
    for world in worlds:
        axes.plot(
            [by_world.get(world, math.nan) for by_world in errors],
            [place + height[world] for place in places],
            color=INK,
            alpha=thin,
            linewidth=0.7,
        )
    for place, row, by_world in zip(places, panel.present, errors, strict=True):
        mark = look[row.method]
        axes.plot(
            list(by_world.values()),
            [place + height[world] for world in by_world],
            mark.mark,
            color=mark.color,
            alpha=0.75,
            markersize=5 if len(worlds) <= _ROW else 3.5,
            markeredgewidth=0,
        )
        axes.errorbar(
            row.error,
            place - 0.3,
            xerr=_bars(row),
            fmt="|",
            color=INK,
            markersize=8,
            markeredgewidth=2,
            elinewidth=1.6,
            capsize=0,
        )
    axes.set_yticks(list(places), [panel.labels[method] for method in methods])
    axes.set_ylim(len(methods) - 0.5, -0.6)
    axes.set(xlim=(0, None), xlabel="error e of x[t], mean over the lap")
    axes.grid(visible=False, axis="y")
    return picture(
        figure,
        name=f"points-{panel.number}",
        title="Every world",
        caption="One mark per world and method; a thin line joins the same world. The bar "
        "above each row is the mean with its 95 % bootstrap interval. Where there are many worlds "
        "their marks are set apart in height, to be seen.",
        alt=f"Error of every world by method, {panel.title}: "
        + "; ".join(f"{panel.labels[r.method]} mean {r.error:.1f}" for r in panel.present),
    )


def time_charts(panel: Panel, look: Looks) -> list[Picture]:
    """Error over the lap, a chart per method, on one scale."""
    drawn = {row.method: curves(panel.own(row.method), 0) for row in panel.present}
    top = max((float(np.nanquantile(c[1], 0.9, axis=0).max()) for c in drawn.values()), default=1)
    charts: list[Picture] = []
    for row in panel.present:
        method, mark = row.method, look[row.method]
        states, errors = drawn[method]
        figure, axes = canvas(3.2, 2.3)
        low, high = np.nanquantile(errors, [0.1, 0.9], axis=0)
        axes.fill_between(states, low, high, color=mark.color, alpha=0.25, linewidth=0)
        if row.baseline in drawn and row.baseline != method:
            theirs = drawn[row.baseline]
            axes.plot(theirs[0], theirs[1].mean(axis=0), "--", color=INK, linewidth=0.9)
        axes.plot(states, errors.mean(axis=0), color=mark.color)
        past = curves(panel.own(method), -panel.setting.lag) if panel.setting.lag else None
        if past is not None and past[0].size:
            axes.plot(past[0], past[1].mean(axis=0), ":", color=mark.color)
        axes.set(ylim=(0, 1.05 * top), xlim=(0, None), xlabel="step of the state", ylabel="error e")
        axes.set_title(panel.labels[method], loc="left")
        charts.append(
            picture(
                figure,
                name=f"time-{panel.number}-{len(charts) + 1}",
                title=f"Error over the lap: {panel.labels[method]}",
                caption="",
                alt=f"Error of {panel.labels[method]} over the lap, {panel.title}; mean over "
                f"the lap {row.error:.1f}",
            )
        )
    return charts


def offset_chart(panel: Panel, look: Looks) -> Picture | None:
    """Error against the offset in the queue, over the same states for every offset."""
    figure, axes = canvas(_WIDE, 3.3)
    several = False
    for row in panel.present:
        by_offset: dict[int, dict[tuple[int, int], float | None]] = {}
        for record in panel.own(row.method):
            run = record["trial"]["trial"], record["trial"]["filter_seed"]
            for offset, error in record.get("profile", {}).items():
                by_offset.setdefault(int(offset), {})[run] = error
        if not by_offset:
            continue
        offsets = sorted(by_offset)
        several |= len(offsets) > 1
        errors = [np.array(list(per_world(by_offset[k]).values())) for k in offsets]
        mark = look[row.method]
        axes.errorbar(
            offsets,
            [values.mean() for values in errors],
            yerr=_spans(errors),
            fmt=f"-{mark.mark}",
            color=mark.color,
            markersize=5,
            elinewidth=0.9,
            label=panel.labels[row.method],
        )
    if not several:
        return None
    axes.axvline(0, color=INK, linewidth=0.8)
    axes.set(xlabel="offset k of the state x[t+k] (past < 0 < future)", ylabel="error e")
    axes.set_ylim(0, None)
    legend(figure, axes, panel.labels.values())
    return picture(
        figure,
        name=f"offsets-{panel.number}",
        title="Along the queue",
        caption="Error of the belief at t about x[t+k], over the same states for every k; bars are "
        "95 % bootstrap intervals over worlds. A method without a queue is a single mark.",
        alt=f"Error against the offset of the state, {panel.title}",
    )


def speed_chart(panel: Panel, look: Looks) -> Picture | None:
    """Error against the localizer's time per step."""
    figure, axes = canvas(_WIDE, 3.3)
    shown = 0
    for row in panel.present:
        milliseconds = milliseconds_per_step(panel.own(row.method))
        if math.isnan(milliseconds):
            continue
        shown += 1
        mark = look[row.method]
        axes.errorbar(
            milliseconds,
            row.error,
            yerr=_bars(row),
            fmt=mark.mark,
            color=mark.color,
            markersize=7,
            elinewidth=0.9,
            label=panel.labels[row.method],
        )
    if not shown:
        return None
    axes.set(xlabel="localizer's time per step, ms (median over runs)", xlim=(0, None))
    axes.set(ylabel="error e of x[t]", ylim=(0, None))
    legend(figure, axes, panel.labels.values())
    return picture(
        figure,
        name=f"speed-{panel.number}",
        title="Accuracy and time",
        caption="Lower and further left is better. Times are of the machine that ran the trials, "
        "with whatever else ran beside them.",
        alt=f"Error against milliseconds per step, {panel.title}",
    )


def calibration_chart(panel: Panel, look: Looks) -> Picture | None:
    """Share of states inside the credible regions against their level."""
    figure, axes = canvas(_WIDE, 3.3)
    shown = [row for row in panel.present if not math.isnan(row.means["coverage_50"])]
    if not shown:
        return None
    axes.plot([0, 100], [0, 100], "--", color=INK, linewidth=0.9, label="calibrated")
    for place, row in enumerate(shown):
        own = panel.own(row.method)
        covered = [
            100 * np.array(list(world_scores(own, f"coverage_{level}").values()))
            for level in LEVELS
        ]
        mark = look[row.method]
        axes.errorbar(
            [level + 1.2 * (place - (len(shown) - 1) / 2) for level in LEVELS],
            [values.mean() for values in covered],
            yerr=_spans(covered),
            fmt=f"-{mark.mark}",
            color=mark.color,
            markersize=5,
            linewidth=0.8,
            elinewidth=0.9,
            label=panel.labels[row.method],
        )
    axes.set(xlim=(40, 102), ylim=(0, 102), xticks=list(LEVELS))
    axes.set(xlabel="level of the credible region, %", ylabel="truth inside, % of states")
    legend(figure, axes, [*panel.labels.values(), "calibrated"])
    return picture(
        figure,
        name=f"calibration-{panel.number}",
        title="Calibration",
        caption="How often the truth lies inside the belief's credible regions of x[t]. Below the "
        "line a belief is too sure of itself, above it too cautious. Bars: 95 % bootstrap over "
        "worlds; marks are set apart sideways to be seen.",
        alt=f"Observed against nominal coverage, {panel.title}: "
        + "; ".join(
            f"{panel.labels[row.method]} "
            + ", ".join(f"{100 * row.means[f'coverage_{level}']:.0f}" for level in LEVELS)
            for row in shown
        ),
    )


def _spread(index: int, count: int) -> float:
    """A height within a row for each of many worlds: golden steps, so that neighbours differ."""
    return ((index * 0.618034) % 1 - 0.5) * 0.3 if count > _ROW else 0.0


def _bars(row: Comparison) -> list[list[float]] | None:
    if math.isnan(row.error_low):
        return None
    return [[row.error - row.error_low], [row.error_high - row.error]]


def _spans(columns: Sequence[Floats]) -> list[list[float]] | None:
    ends = [paired_bootstrap(values) for values in columns]
    if any(math.isnan(low) for low, _ in ends):
        return None
    return [
        [float(v.mean()) - low for v, (low, _) in zip(columns, ends, strict=True)],
        [high - float(v.mean()) for v, (_, high) in zip(columns, ends, strict=True)],
    ]
