"""Tables and curves of panels about robots that are lost, kidnapped, or drive to a goal."""

import math
from collections.abc import Mapping

from benchmarks.report.svg import Looks, Picture, canvas, picture
from benchmarks.report.tables import Table
from benchmarks.report.words import estimated, p_value
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.journeys import JourneyScore, ShareCurve
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import Estimate
from benchmarks.tables.text import fixed, percent
from benchmarks.trials.journeys import JOURNEY_SCORES, Group, Score

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
_CURVES = {
    "metres_to_localize": (
        "Localized against metres driven",
        "localized for good, % of runs",
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
    """Return a curve over the metres driven for each score that is censored."""
    held = {name for row in panel.present for name in row.journey}
    end = max((way for own in panel.whole.values() for way in own.longest.values()), default=0.0)
    return [
        share_chart(
            {panel.labels[method]: own.curve(score) for method, own in panel.whole.items()},
            looks,
            end=end,
            name=f"{name.replace('_', '-')}-{panel.number}",
            words=_CURVES[name],
        )
        for name, score in JOURNEY_SCORES.items()
        if score.censored and name in held
    ]


def share_chart(
    curves: Mapping[str, ShareCurve],
    looks: Looks,
    *,
    end: float,
    name: str,
    words: tuple[str, str, str],
) -> Picture:
    """Draw shares of runs against metres driven, each with its band.

    Args:
        curves: by label.
        looks: of the labels.
        end: of the axis, m.
        name: of the picture.
        words: its title, what the axis of shares says, and the caption.
    """
    title, axis, caption = words
    figure, axes = canvas(4.8, 2.9, legend_of=list(curves))
    for label, curve in curves.items():
        low, high = ([*100 * part, 100 * part[-1]] for part in (curve.low, curve.high))
        metres, share = [*curve.metres, end], [*100 * curve.share, 100 * curve.share[-1]]
        color = looks[label].color
        axes.fill_between(metres, low, high, step="post", color=color, alpha=0.15, lw=0)
        axes.step(metres, share, where="post", color=color, label=label)
    axes.set(xlabel="driven, m", xlim=(0, end), ylabel=axis, ylim=(0, 102))
    ends = (f"{label} {curve.share[-1]:.0%}" for label, curve in curves.items())
    return picture(
        figure,
        name=name,
        title=title,
        caption=f"{caption} Bands: Wilson's 95 % interval at each distance.",
        alt=f"{caption} At the end: {', '.join(ends)}.",
    )


def score_header(score: Score) -> list[str]:
    """Return what the columns of a score of whole runs are of."""
    points = "points" if score.unit == "share" else score.unit
    return [score.words, *([f"difference, {points}", "p, Holm"] if score.tested else [])]


def score_cells(row: Comparison, score: Score) -> list[str]:
    """Return a score of a method's runs, and how it compares with the baseline's."""
    own = row.journey.get(score.name, JourneyScore(value=Estimate()))
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
