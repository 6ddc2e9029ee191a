"""The charts of a panel: its rows, drawn."""

import math
from textwrap import wrap

import numpy as np
from matplotlib.ticker import MaxNLocator

from benchmarks.report.svg import INK, Looks, Picture, canvas, estimates, picture
from benchmarks.tables.pairing import lap_errors, profile
from benchmarks.tables.panels import Panel
from benchmarks.trials.metrics import LEVELS

_ROW = 30  # worlds whose marks fit side by side
_LETTERS = 28  # of a method's name on a line


def points_chart(panel: Panel, looks: Looks) -> Picture:
    """Every world's error by method; thin lines join the same world."""
    rows = panel.present
    labels = [panel.labels[row.method] for row in rows]
    lines = [wrap(label, _LETTERS) for label in labels]
    longest = max(len(line) for label in lines for line in label)
    figure, axes = canvas(4.8, 0.9 + 0.42 * len(rows), left=0.25 + 0.082 * longest)
    worlds = sorted(set().union(*(row.errors for row in rows)))
    height = {world: _spread(i, len(worlds)) for i, world in enumerate(worlds)}
    axes.plot(
        [[row.errors.get(world, math.nan) for world in worlds] for row in rows],
        [[place + height[world] for world in worlds] for place in range(len(rows))],
        color=INK,
        alpha=min(0.35, 8 / max(len(worlds), 1)),
        linewidth=0.7,
    )
    for place, (row, label) in enumerate(zip(rows, labels, strict=True)):
        axes.plot(
            list(row.errors.values()),
            [place + height[world] for world in row.errors],
            looks[label].mark,
            color=looks[label].color,
            alpha=0.75,
            markersize=5 if len(worlds) <= _ROW else 3.5,
            markeredgewidth=0,
        )
        axes.plot(row.error[1:], [place - 0.3] * 2, color=INK, linewidth=1.6)
        axes.plot(row.error.mean, place - 0.3, "|", color=INK, markersize=8, markeredgewidth=2)
    axes.set_yticks(range(len(rows)), ["\n".join(label) for label in lines])
    axes.set_ylim(len(rows) - 0.5, -0.6)
    axes.set(xlim=(0, None), xlabel="error e of x[t], mean over the lap")
    axes.grid(visible=False, axis="y")
    means = (f"{panel.labels[row.method]} mean {row.error.mean:.1f}" for row in rows)
    return picture(
        figure,
        name=f"points-{panel.number}",
        title="Every world",
        caption="One mark per world and method; thin lines connect the same world. The bar "
        "above each row is the mean with its 95 % bootstrap interval. Where there are many worlds, "
        "their marks are spread vertically.",
        alt=f"Error of every world by method, {panel.title}: {'; '.join(means)}",
    )


def time_charts(panel: Panel, looks: Looks) -> list[Picture]:
    """Error over the lap, a chart per method, on one scale."""
    drawn = {row.method: lap_errors(panel.records[row.method]) for row in panel.present}
    tops = (float(np.nanmax(errors.high)) for errors in drawn.values() if errors is not None)
    top = max(tops, default=1.0)
    titles = {method: wrap(label, _LETTERS) for method, label in panel.labels.items()}
    above = 0.1 + 0.18 * max(map(len, titles.values()))
    charts: list[Picture] = []
    for row in panel.present:
        errors, label = drawn[row.method], panel.labels[row.method]
        if errors is None:
            continue
        color = looks[label].color
        figure, axes = canvas(3.2, 2.02 + above, top=above)
        axes.fill_between(errors.states, errors.low, errors.high, color=color, alpha=0.25, lw=0)
        theirs = drawn.get(row.baseline)
        if theirs is not None and not row.is_baseline:
            axes.plot(theirs.states, theirs.mean, "--", color=INK, linewidth=0.9)
        axes.plot(errors.states, errors.mean, color=color)
        past = lap_errors(panel.records[row.method], -panel.setting.lag)
        if past is not None and panel.setting.lag:
            axes.plot(past.states, past.mean, ":", color=color)
        axes.set(ylim=(0, 1.05 * top), xlim=(0, None), xlabel="step of the state", ylabel="error e")
        axes.set_title("\n".join(titles[row.method]), loc="left")
        charts.append(
            picture(
                figure,
                name=f"time-{panel.number}-{len(charts) + 1}",
                title=f"Error over the lap: {label}",
                caption="",
                alt=f"Error of {label} over the lap, {panel.title}; mean over the lap "
                f"{row.error.mean:.1f}",
            )
        )
    return charts


def offset_chart(panel: Panel, looks: Looks) -> Picture | None:
    """Error against the offset in the queue, over the same states for every offset."""
    profiles = {panel.labels[m]: profile(records) for m, records in panel.records.items()}
    if all(len(errors) < 2 for errors in profiles.values()):
        return None
    figure, axes = canvas(4.8, 2.9, legend_of=profiles)
    for label, errors in profiles.items():
        estimates(axes, list(errors), list(errors.values()), looks[label], label)
    axes.axvline(0, color=INK, linewidth=0.8)
    axes.set(xlabel="offset k of the state x[t+k] (past < 0 < future)", ylabel="error e")
    axes.set_ylim(0, None)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return picture(
        figure,
        name=f"offsets-{panel.number}",
        title="Along the queue",
        caption="Error of the belief at t about x[t+k], over the same states for every k; bars are "
        "95 % bootstrap intervals over worlds. A method without a queue is a single mark.",
        alt=f"Error against the offset of the state, {panel.title}",
    )


def speed_chart(panel: Panel, looks: Looks) -> Picture | None:
    """Error against the localizer's time per step."""
    timed = [row for row in panel.present if not math.isnan(row.milliseconds)]
    if not timed:
        return None
    figure, axes = canvas(4.8, 2.9, legend_of=[panel.labels[row.method] for row in timed])
    for row in timed:
        label = panel.labels[row.method]
        estimates(axes, [row.milliseconds], [row.error], looks[label], label, size=7)
    axes.set(xlabel="localizer's time per step, ms (median over runs)", xlim=(0, None))
    axes.set(ylabel="error e of x[t]", ylim=(0, None))
    return picture(
        figure,
        name=f"speed-{panel.number}",
        title="Accuracy and time",
        caption="Lower and further left is better. Times were measured while the trials ran, on a "
        "machine that may have been busy with other work.",
        alt=f"Error against milliseconds per step, {panel.title}",
    )


def calibration_chart(panel: Panel, looks: Looks) -> Picture | None:
    """Share of states inside the credible regions against their level."""
    inside = {
        panel.labels[row.method]: [row.scores[f"coverage_{level}"].percent for level in LEVELS]
        for row in panel.present
        if not math.isnan(row.scores["coverage_50"].mean)
    }
    if not inside:
        return None
    figure, axes = canvas(4.8, 2.9, legend_of=[*inside, "calibrated"])
    for place, (label, shares) in enumerate(inside.items()):
        aside = 1.2 * (place - (len(inside) - 1) / 2)
        estimates(axes, [level + aside for level in LEVELS], shares, looks[label], label)
    axes.plot([0, 100], [0, 100], "--", color=INK, linewidth=0.9, label="calibrated", zorder=1)
    axes.set(xlim=(40, 102), ylim=(0, 102), xticks=list(LEVELS))
    axes.set(xlabel="level of the credible region, %", ylabel="truth inside, % of states")
    covered = (
        f"{label} " + ", ".join(f"{share.mean:.0f}" for share in shares)
        for label, shares in inside.items()
    )
    return picture(
        figure,
        name=f"calibration-{panel.number}",
        title="Calibration",
        caption="How often the truth lies inside the belief's credible regions of x[t]. Below the "
        "line a belief is overconfident, above it too cautious. Bars: 95 % bootstrap intervals "
        "over worlds; marks are spread horizontally.",
        alt=f"Observed against nominal coverage, {panel.title}: {'; '.join(covered)}",
    )


def _spread(index: int, count: int) -> float:
    """A height within a row for each of many worlds: golden steps, so that neighbours differ."""
    return ((index * 0.618034) % 1 - 0.5) * 0.3 if count > _ROW else 0.0
