"""The charts of a panel, its rows drawn: errors, and runs of robots lost, kidnapped or driving."""

import math
from statistics import median

import numpy as np
from matplotlib.ticker import MaxNLocator

from benchmarks.report import decisions
from benchmarks.report.curves import FAR, LOG_RATIO, left_out, spaced
from benchmarks.report.svg import INK, Looks, Picture, breadth, canvas, estimates, lines_of, picture
from benchmarks.report.tables import Table
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.journeys import JourneyScore
from benchmarks.tables.pairing import lap_errors, profile
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import UNKNOWN, Estimate
from benchmarks.tables.text import estimated, fixed, p_value, percent
from benchmarks.trials.scores import JOURNEY_SCORES, LEVELS, Group, Score

WORDS = {  # by group: heading, what its columns mean
    "lost": (
        "Localized",
        "Of the best cluster. Localized to the end: within that distance and angle of the truth in "
        "every step of the last 25 % of the run. Metres to localize: driven until it stays within "
        "1 m and 30° to the end; never: half of the runs or more do not. False commitment: "
        "quality above 0.5 while more than 2 m off, in a step of the last 25 %; beside it, as a "
        "share of all steps.",
    ),
    "ambiguity": (
        "Two places that fit",
        "A half turn gives the same map, so that scans fit two poses. Weight within 1 m and 30° of "
        "each, on average over the last 25 % of a run; the smaller of the two as a share of both: "
        "½ is undecided, 0 has picked one.",
    ),
    "recovery": (
        "Found again",
        "After the kidnap. Recovered: the best cluster is within 0.45 m of the truth for 20 steps "
        "in a row. Metres to recover: driven from the kidnap until these steps begin.",
    ),
    "log": (
        "Against the reference",
        "Of the best cluster, at the records that have a reference: mean over runs of the median.",
    ),
    "driving": (
        "Arrived",
        "Arrived: ends within 0.5 m of the goal, without contact. SPL: success weighted by path "
        "length, shortest / max(driven, shortest) of runs that arrive, 0 of others. Contacts: "
        "steps that a wall stopped. Clearance: least distance of the robot's rim to a wall.",
    ),
}
_TESTS = (
    " Difference to the baseline: on the same worlds; where it never happens, metres count as the "
    "longest way driven in that world. p: sign test over worlds for shares, signed-rank test for "
    "metres, corrected by Holm's method for all tests of this section. Intervals: 95 %."
)
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


def journey_table(panel: Panel, group: Group) -> Table | None:
    """Return the table of a group of scores of whole runs; None if it was not scored."""
    scores = [s for s in group.scores if any(s.name in row.journey for row in panel.present)]
    if not scores:
        return None
    header = ["method"]
    for score in scores:
        header += score_header(score)
    lines = [
        [panel.labels[row.method], *(cell for score in scores for cell in score_cells(row, score))]
        for row in panel.ranked
    ]
    tested = any(score.tested for score in scores)
    return Table(WORDS[group.name][1] + (_TESTS if tested else ""), header, lines)


def journey_charts(panel: Panel, looks: Looks) -> list[Picture]:
    """Draw shares of runs against the metres driven, with bands, for each score with censoring."""
    held = {name for row in panel.present for name in row.journey}
    end = max((way for own in panel.whole.values() for way in own.longest.values()), default=0.0)
    charts = []
    for name, score in JOURNEY_SCORES.items():
        if not score.censored or name not in held:
            continue
        title, axis, caption = _CURVES[name]
        curves = {panel.labels[method]: own.curve(score) for method, own in panel.whole.items()}
        figure, axes = canvas(4.8, 2.9, legend_of=curves)
        for label, curve in curves.items():
            low, high = ([*100 * part, 100 * part[-1]] for part in (curve.low, curve.high))
            metres, share = [*curve.metres, end], [*100 * curve.share, 100 * curve.share[-1]]
            color = looks[label].color
            axes.fill_between(metres, low, high, step="post", color=color, alpha=0.15, lw=0)
            axes.step(metres, share, where="post", color=color, label=label)
        axes.set(xlabel="driven, m", xlim=(0, end), ylabel=axis, ylim=(0, 102))
        ends = (f"{label} {percent(curve.share[-1])}" for label, curve in curves.items())
        charts.append(
            picture(
                figure,
                name=f"{name.replace('_', '-')}-{panel.number}",
                title=title,
                caption=f"{caption} Bands: Wilson's 95 % interval at each distance.",
                alt=f"{caption} At the end: {', '.join(ends)}.",
            )
        )
    return charts


def score_header(score: Score) -> list[str]:
    """Return what the columns of a score of whole runs are of."""
    points = "points" if score.unit == "share" else score.unit
    return [score.words, *([f"difference, {points}", "p, Holm"] if score.tested else [])]


def score_cells(row: Comparison, score: Score) -> list[str]:
    """Return a score of a method's runs, and how it compares with the baseline's."""
    own = row.journey.get(score.name, JourneyScore(value=UNKNOWN))
    cells = [_value(own.value, score)]
    if score.tested and row.is_baseline:
        cells += ["baseline", "–"]
    elif score.tested:
        diff = own.diff.percent if score.unit == "share" else own.diff
        cells += [estimated(diff, f"+.{_digits(score)}f"), p_value(own.p_holm)]
    return cells


def _value(value: Estimate, score: Score) -> str:
    if math.isnan(value.mean):
        return "n/a"
    words = [_word(end, score) for end in value]
    return words[0] if math.isnan(value.low) else f"{words[0]} ({words[1]} to {words[2]})"


def _word(value: float, score: Score) -> str:
    if score.unit == "share":
        return percent(value)
    if math.isinf(value):
        return "never"
    return fixed(value, _digits(score))


def _digits(score: Score) -> int:
    """How many a number of a score has behind the point."""
    if score.digits is not None:
        return score.digits
    return {"share": 0, "m": 1, "steps": 1}.get(score.unit, 2)


_ROW = 30  # worlds whose marks fit side by side
_LETTERS = 28  # of a method's name on a line


def points_chart(panel: Panel, looks: Looks) -> Picture:
    """Every world's error by method; thin lines join the same world."""
    rows = panel.present
    labels = [panel.labels[row.method] for row in rows]
    lines = [lines_of(label, _LETTERS) for label in labels]
    longest = max(breadth(line) for label in lines for line in label)
    figure, axes = canvas(4.8, 0.9 + 0.42 * len(rows), left=0.25 + 0.082 * longest)
    worlds = sorted(set().union(*(row.errors for row in rows)))
    spread = 0.3 if len(worlds) > _ROW else 0.0  # by golden steps, so that neighbours differ
    height = {world: ((i * 0.618034) % 1 - 0.5) * spread for i, world in enumerate(worlds)}
    if len(rows) > 1:
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
    titles = {method: lines_of(label, _LETTERS) for method, label in panel.labels.items()}
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


def decision_chart(panel: Panel, looks: Looks) -> Picture | None:
    """Draw the way of every method to its decision: the difference against the worlds seen."""
    shown = {panel.labels[row.method]: row.decision for row in panel.present if row.decision}
    shown = {label: own for label, own in shown.items() if own.interims}
    if not shown or panel.rule is None:
        return None
    figure, axes = canvas(4.8, 2.9, left=0.75, legend_of=shown)
    margin = 100 * panel.rule.margin
    axes.axhspan(-margin, margin, color=INK, alpha=0.08, linewidth=0)
    axes.axhline(0, color=INK, linewidth=0.8)
    most = 2 * margin
    for label, own in shown.items():
        worlds = [one.worlds for one in own.interims]
        apart = [one.interval.percent for one in own.interims]
        look = looks[label]
        low, high = ([getattr(one, end) for one in apart] for end in ("low", "high"))
        means = [one.mean for one in apart]
        axes.fill_between(worlds, low, high, color=look.color, alpha=0.15, linewidth=0)
        if len(worlds) == 1 and math.isfinite(low[0] + high[0]):
            axes.plot(worlds * 2, [low[0], high[0]], color=look.color, alpha=0.4, linewidth=3)
        axes.plot(worlds, means, color=look.color)
        done = own.relation != "open"
        axes.plot(
            worlds[-1],
            means[-1],
            look.mark,
            color=look.color,
            markerfacecolor=look.color if done else "none",
            label=label,
        )
        last = apart[-1]
        most = max([most, *(1.15 * abs(end) for end in last if math.isfinite(end))])
    unit = "%" if panel.aim is None else "points"
    axes.set(xlabel="worlds seen", ylabel=f"difference, {unit}", ylim=(-most, most))
    axes.set_xlim(0, None)
    return picture(
        figure,
        name=f"decisions-{panel.number}",
        title="The way to each decision",
        caption="Difference to the baseline after so many worlds, with the interval that holds at "
        f"all looks. Grey: the margin of {margin:g} %. A method stops where "
        "its interval lies beyond the margin or inside it: filled marks; hollow: still open.",
        alt="; ".join(f"{label}: {decisions.standing(own)}" for label, own in shown.items()),
    )


def offset_chart(panel: Panel, looks: Looks) -> Picture | None:
    """Error against the offset in the queue, over the same states for every offset."""
    profiles = {panel.labels[m]: profile(records) for m, records in panel.records.items()}
    if all(len(errors) < 2 for errors in profiles.values()):
        return None
    most = {label: max(one.mean for one in own.values()) for label, own in profiles.items() if own}
    out = [label for label, error in most.items() if error > FAR * median(most.values())]
    profiles = {label: errors for label, errors in profiles.items() if label not in out}
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
        f"95 % bootstrap intervals over worlds. A method without a queue is a single mark."
        f"{left_out(out, 'the median')}",
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
    times = [row.milliseconds for row in timed]
    wide = min(times) > 0 and max(times) > LOG_RATIO * min(times)
    axes.set(xlabel="localizer's time per step, ms (median over runs)")
    if wide:
        spaced(axes, [one * 10**power for power in range(-3, 6) for one in (1, 2, 5)])
        axes.set_xlim(0.7 * min(times), 1.4 * max(times))
    else:
        axes.set_xlim(0, None)
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
        title="Coverage",
        caption="How often the truth lies inside the belief's credible regions of x[t]. Below the "
        "line a belief is overconfident, above it too cautious. Bars: 95 % bootstrap intervals "
        "over worlds; marks are spread horizontally.",
        alt=f"Observed against nominal coverage, {panel.title}: {'; '.join(covered)}",
    )
