"""All that a report shows, before it is HTML or Markdown."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from benchmarks.report.charts import (
    calibration_chart,
    offset_chart,
    points_chart,
    speed_chart,
    time_charts,
)
from benchmarks.report.curves import DIFFERENCE, ERROR, swept_charts
from benchmarks.report.laps import Lap, laps
from benchmarks.report.panels import Panel, panels
from benchmarks.report.rivals import Table, gap_table, rival_tables
from benchmarks.report.style import Look, looks
from benchmarks.report.svg import Picture, house_style
from benchmarks.sweeps.results import Results
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.gap import Gap
from benchmarks.tables.pairing import Method

PICTURED = 8  # panels with pictures; the tables are of all
ANIMATED = 1  # panels with animations: they are what makes a page large


@dataclass(frozen=True, kw_only=True)
class Section:
    """A panel and its pictures.

    Attributes:
        panel: with its tables.
        charts: each about all its methods.
        over_time: one per method.
        laps: animations.
        no_laps: why there are none, if they failed.
        rivals: tables of differences to the paper's methods.
        gap: table of differences to the limit, without lines if there is none.
    """

    panel: Panel
    charts: list[Picture] = field(default_factory=list)
    over_time: list[Picture] = field(default_factory=list)
    laps: list[Lap] = field(default_factory=list)
    no_laps: str = ""
    rivals: list[Table] = field(default_factory=list)
    gap: Table = field(default_factory=lambda: ([], []))


@dataclass(frozen=True, kw_only=True)
class Story:
    """What a report tells: the results, panel by panel, and what was swept."""

    results: Results
    sections: list[Section]
    curves: list[Picture]


def story_of(rows: Sequence[Comparison], gaps: Sequence[Gap], results: Results) -> Story:
    """Draw everything, and run again the trials that are shown as animations."""
    shown = panels(rows, results.records, results.baseline)
    look = looks(label for panel in shown for label in panel.labels.items())
    with house_style():
        return Story(
            results=results,
            sections=[
                replace(
                    _section(panel, look), rivals=rival_tables(panel), gap=gap_table(panel, gaps)
                )
                for panel in shown
            ],
            curves=[
                *swept_charts(rows, look, ERROR),
                *swept_charts(rows, look, DIFFERENCE),
            ],
        )


def _section(panel: Panel, look: Mapping[Method, Look]) -> Section:
    if panel.number > PICTURED:
        return Section(panel=panel)
    charts = [points_chart(panel, look)]
    for chart in (offset_chart, calibration_chart, speed_chart):
        drawn = chart(panel, look)
        charts += [drawn] if drawn else []
    animations: list[Lap] = []
    reason = ""
    if panel.number <= ANIMATED:
        try:
            animations = laps(panel)
        except Exception as error:  # a plug-in that is no longer there is no reason to say nothing
            reason = f"{type(error).__name__}: {error}"
    return Section(
        panel=panel,
        charts=charts,
        over_time=time_charts(panel, look),
        laps=animations,
        no_laps=reason,
    )
