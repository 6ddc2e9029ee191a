"""The parts of a section of the page, one after the other: ``PARTS`` is the list to add to."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from benchmarks.report import error_tables, tables, track_charts, tracks
from benchmarks.report.charts import (
    calibration_chart,
    offset_chart,
    points_chart,
    speed_chart,
    time_charts,
)
from benchmarks.report.journeys import WORDS, journey_charts, journey_table
from benchmarks.report.style import Look
from benchmarks.report.svg import Picture
from benchmarks.report.tables import Table
from benchmarks.tables.panels import Panel
from benchmarks.tables.verdict import verdict
from benchmarks.trials.journeys import GROUPS, Group

Looks = Mapping[str, Look]  # by label


@dataclass(frozen=True, kw_only=True)
class Block:
    """What a part shows of one panel.

    Attributes:
        heading: "" for none.
        note: how to read it.
        tables, pictures: its content.
        folded: whether it is closed until it is clicked on; never in print.
        small: whether its pictures are small ones without words of their own.
    """

    heading: str
    note: str
    tables: Sequence[Table]
    pictures: Sequence[Picture]
    folded: bool
    small: bool


@dataclass(frozen=True, kw_only=True)
class Part:
    """A heading, and what stands below it for any panel; see ``Block``."""

    heading: str = ""
    note: Callable[[Panel], str] = lambda panel: ""
    tables: Callable[[Panel], Sequence[Table | None]] = lambda panel: ()
    pictures: Callable[[Panel, Looks], Sequence[Picture | None]] = lambda panel, looks: ()
    folded: bool = False
    small: bool = False

    def of(self, panel: Panel, looks: Looks, *, pictured: bool) -> Block | None:
        """Return what it shows of a panel; None if there is nothing to show."""
        shown = [table for table in self.tables(panel) if table]
        drawn = [one for one in self.pictures(panel, looks) if one] if pictured else []
        if not shown and not drawn:
            return None
        return Block(
            heading=self.heading,
            note=self.note(panel),
            tables=shown,
            pictures=drawn,
            folded=self.folded,
            small=self.small,
        )


def _of_journeys(group: Group) -> Part:
    return Part(heading=WORDS[group.name][0], tables=lambda panel: [journey_table(panel, group)])


TRACKS: Sequence[Part] = (
    Part(tables=tracks.track_tables),
    Part(
        heading="On the map",
        note=lambda panel: track_charts.ON_THE_MAP,
        pictures=track_charts.track_charts,
    ),
    Part(
        heading="Over the distance driven",
        note=lambda panel: track_charts.OVER_THE_WAY,
        pictures=track_charts.error_charts,
        small=True,
    ),
    Part(heading="APE and RPE", tables=tracks.evo_tables),
)
PARTS: Sequence[Part] = (
    *TRACKS,
    *map(_of_journeys, GROUPS),
    Part(
        pictures=lambda panel, looks: [
            *journey_charts(panel, looks),
            points_chart(panel, looks),
            offset_chart(panel, looks),
            calibration_chart(panel, looks),
            speed_chart(panel, looks),
        ]
    ),
    Part(
        heading="Error over the lap",
        note=lambda panel: (
            "Solid: mean over worlds at x[t]; band: the middle 80 % of runs; dashed: the "
            "baseline's mean"
            + (f"; dotted: x[t-{lag}], a past state." if (lag := panel.setting.lag) else ".")
        ),
        pictures=time_charts,
        small=True,
    ),
    Part(heading="Against the paper's methods", tables=error_tables.rival_tables, folded=True),
    Part(heading="Optimality gap", tables=lambda panel: [error_tables.gap_table(panel)]),
    Part(heading="Calibration", tables=lambda panel: [tables.calibration_table(panel)]),
    Part(heading=tables.DETECTION, tables=lambda panel: [tables.detection_table(panel)]),
    Part(
        heading="Errors at every offset",
        tables=lambda panel: [error_tables.offsets_table(panel)],
        folded=True,
    ),
)


def blocks(panel: Panel, looks: Looks, *, pictured: bool) -> list[Block]:
    """Return what all parts show of a panel, with or without pictures; few if no error is known."""
    parts = TRACKS if verdict(panel) is None else PARTS
    shown = (part.of(panel, looks, pictured=pictured) for part in parts)
    return [block for block in shown if block is not None]
