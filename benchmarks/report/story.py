"""All that a report shows, before it is HTML or Markdown."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import matplotlib as mpl

from benchmarks.report.charts import (
    calibration_chart,
    offset_chart,
    points_chart,
    speed_chart,
    time_charts,
)
from benchmarks.report.curves import DIFFERENCE, ERROR, swept_charts
from benchmarks.report.laps import Lap, laps
from benchmarks.report.style import Look, looks
from benchmarks.report.svg import HOUSE_STYLE, Picture
from benchmarks.report.tables import Table, gap_table, rival_tables
from benchmarks.sweeps.results import Results
from benchmarks.tables.gap import Gap
from benchmarks.tables.panels import Panel

PICTURED = 8  # panels with pictures; the tables are of all
ANIMATED = 1  # panels with animations: they are what makes a page large


@dataclass(frozen=True, kw_only=True)
class Section:
    """A panel and its pictures.

    Attributes:
        panel: what its tables are of.
        rivals: differences to the paper's methods.
        gap: differences to the limit, if there is one.
        charts: each about all its methods.
        over_time: one per method.
        laps: animations.
        no_laps: why there are none, if they failed.
    """

    panel: Panel
    rivals: list[Table]
    gap: Table | None
    charts: list[Picture] = field(default_factory=list)
    over_time: list[Picture] = field(default_factory=list)
    laps: list[Lap] = field(default_factory=list)
    no_laps: str = ""


@dataclass(frozen=True, kw_only=True)
class Story:
    """What a report tells: the results, panel by panel, and what was swept."""

    results: Results
    sections: list[Section]
    curves: list[Picture]

    @property
    def panels(self) -> list[Panel]:
        """The panels of its sections."""
        return [section.panel for section in self.sections]


def story_of(panels: Sequence[Panel], gaps: Sequence[Gap], results: Results) -> Story:
    """Draw everything, and run again the trials that are shown as animations."""
    look = looks(label for panel in panels for label in panel.labels.values())
    with ThreadPoolExecutor() as pool, mpl.rc_context(HOUSE_STYLE):
        # encoding an animation takes as long as drawing all charts, and leaves Python free
        animated = [pool.submit(laps, panel) for panel in panels[:ANIMATED]]
        sections = [_section(panel, gaps, look) for panel in panels]
        curves = [*swept_charts(panels, look, ERROR), *swept_charts(panels, look, DIFFERENCE)]
        for place, drawing in enumerate(animated):
            sections[place] = replace(sections[place], **_awaited(drawing))
    return Story(results=results, sections=sections, curves=curves)


def _section(panel: Panel, gaps: Sequence[Gap], look: Mapping[str, Look]) -> Section:
    own = [row for row in gaps if (row.setting, row.swept) == (panel.setting, panel.swept)]
    section = Section(panel=panel, rivals=rival_tables(panel), gap=gap_table(panel, own))
    if panel.number > PICTURED:
        return section
    drawn = [chart(panel, look) for chart in (offset_chart, calibration_chart, speed_chart)]
    return replace(
        section,
        charts=[points_chart(panel, look), *(chart for chart in drawn if chart)],
        over_time=time_charts(panel, look),
    )


def _awaited(drawing: Future[list[Lap]]) -> dict[str, Any]:
    try:
        return {"laps": drawing.result()}
    except Exception as error:  # a plug-in that is no longer there is no reason to say nothing
        return {"no_laps": f"{type(error).__name__}: {error}"}
