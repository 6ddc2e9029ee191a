"""The content of a report, before it is HTML or Markdown: ``PARTS`` is the list to add to."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from benchmarks.pictures import styled
from benchmarks.report import charts, decisions, error_tables, tables, tracks, words
from benchmarks.report.animations import ANIMATED, Drawn, Figure, animations_of
from benchmarks.report.svg import HOUSE_STYLE, Looks, Picture, looks
from benchmarks.report.swept import charts_over
from benchmarks.report.tables import Table
from benchmarks.sweeps.drawing import Animation, Promise, drawing
from benchmarks.sweeps.results import Results
from benchmarks.tables.panels import Panel
from benchmarks.trials.scores import GROUPS, Group
from deqmcl_gym.validation import InputError, in_words


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
    heading, _ = charts.WORDS[group.name]
    return Part(heading=heading, tables=lambda panel: [charts.journey_table(panel, group)])


TRACKS: Sequence[Part] = (
    Part(tables=lambda panel: tracks.tables_of(tracks.shown(panel)[0])),
    Part(
        heading="On the map",
        note=lambda panel: (
            "Best clusters: the heaviest cell of a histogram of the belief (1 m × 1 m × 30°) and "
            "its neighbours, the one place that it favours. The cross is where the robot was when "
            "it was last lost: from there on the estimate is never again within 1 m and 30°."
        ),
        pictures=tracks.track_charts,
    ),
    Part(
        heading="Over the distance driven",
        note=lambda panel: "Line: median over runs; band: least to largest; dotted: 1 m.",
        pictures=tracks.error_charts,
        small=True,
    ),
    Part(heading="APE and RPE", tables=tracks.evo_tables),
)
PARTS: Sequence[Part] = (
    *TRACKS,
    *map(_of_journeys, GROUPS),
    Part(
        pictures=lambda panel, looks: [
            charts.decision_chart(panel, looks),
            *charts.journey_charts(panel, looks),
            charts.points_chart(panel, looks),
            charts.offset_chart(panel, looks),
            charts.calibration_chart(panel, looks),
            charts.speed_chart(panel, looks),
        ]
    ),
    Part(
        heading="Error over the lap",
        note=lambda panel: (
            "Solid: mean over worlds at x[t]; band: the middle 80 % of runs; dashed: the "
            "baseline's mean"
            + (f"; dotted: x[t-{lag}], a past state." if (lag := panel.setting.lag) else ".")
        ),
        pictures=charts.time_charts,
        small=True,
    ),
    Part(heading="Against the paper's methods", tables=error_tables.rival_tables, folded=True),
    Part(heading="Optimality gap", tables=lambda panel: [error_tables.gap_table(panel)]),
    Part(heading="Calibration", tables=lambda panel: [tables.calibration_table(panel)]),
    Part(
        heading="Does the quality detect large errors?",
        tables=lambda panel: [tables.detection_table(panel)],
    ),
    Part(
        heading="Lost, or is the map wrong here?",
        tables=lambda panel: [tables.told_apart_table(panel)],
    ),
    Part(
        heading="Errors at every offset",
        tables=lambda panel: [error_tables.offsets_table(panel)],
        folded=True,
    ),
)


def blocks(panel: Panel, looks: Looks, *, pictured: bool) -> list[Block]:
    """Return what all parts show of a panel, with or without pictures; few if no error is known."""
    parts = TRACKS if panel.verdict is None else PARTS
    shown = (part.of(panel, looks, pictured=pictured) for part in parts)
    return [block for block in shown if block is not None]


PICTURED = 8  # panels with pictures; the tables are of all
_LISTED = 100  # files left out


@dataclass(frozen=True, kw_only=True)
class Section:
    """A panel and its pictures.

    Attributes:
        panel: what its tables are of.
        verdict: who is best.
        runner_up, findings, power: sentences.
        table: of its methods, the best first.
        blocks: tables and charts, part by part.
        animations: of the best, median and worst world.
        no_animation: why there is none, if they failed.
    """

    panel: Panel
    verdict: words.Said
    runner_up: str
    findings: list[str]
    power: str
    table: Table
    blocks: list[Block]
    animations: list[Animation] = field(default_factory=list)
    no_animation: str = ""


@dataclass(frozen=True, kw_only=True)
class Story:
    """What a report tells: the results, panel by panel, and what was swept.

    Attributes:
        results: what it is about.
        conclusion: who is best, on all that was run.
        overview, progress: sentences.
        glances: tables with a line for each section; empty if there is one section.
        validity: of plans, with a line for several sections.
        sections: panel by panel.
        curves: over what was swept.
        figures: the paper's, if the folder has them.
        failed, left_out: trials without a result, files that are no trial.
        notes, warnings: further sentences, if whoever writes the report has some.
    """

    results: Results
    conclusion: words.Said
    overview: str
    progress: str
    glances: list[Table]
    validity: Table | None
    sections: list[Section]
    curves: list[Picture]
    figures: Sequence[Figure]
    failed: Table
    left_out: Table
    notes: Sequence[str] = ()
    warnings: Sequence[str] = ()

    @property
    def pictures(self) -> list[Picture]:
        """All its charts."""
        shown = [block for section in self.sections for block in section.blocks]
        return [*self.curves, *(picture for block in shown for picture in block.pictures)]


def story_of(
    results: Results, drawn: Drawn | None, notes: Sequence[str] = (), warnings: Sequence[str] = ()
) -> Story:
    """Draw everything, but for the animations if they are kept."""
    panels = results.panels
    look = looks(tables.all_labels(panels))
    animated = panels[:ANIMATED]
    with drawn.given() if drawn else drawing() as promised, styled(HOUSE_STYLE):
        waiting = [[promised(one) for one in animations_of(panel)] for panel in animated]
        sections = [
            Section(
                panel=panel,
                verdict=words.spoken(panel),
                runner_up=words.runner_up(panel),
                findings=words.findings(panel),
                power=words.power_hint(panel),
                table=error_tables.verdict_table(panel),
                blocks=blocks(panel, look, pictured=panel.number <= PICTURED),
            )
            for panel in panels
        ]
        several = panels if len(panels) > 1 else []
        glances = (error_tables.glance_table(several), tables.detection_glance(several))
        story = Story(
            results=results,
            conclusion=words.conclusion(results),
            overview=" ".join(
                filter(None, (words.overview(results, panels), decisions.summary(panels)))
            ),
            progress=words.progress(results),
            glances=[glance for glance in glances if glance and several],
            validity=tables.validity_table(several),
            sections=sections,
            curves=charts_over(panels, look),
            figures=drawn.figures if drawn else (),
            failed=_failed(results),
            left_out=_left_out(results),
            notes=notes,
            warnings=warnings,
        )
        for picture in story.pictures:  # drawn while workers draw the animations
            _ = picture.source
        for place, promises in enumerate(waiting):
            sections[place] = replace(sections[place], **_awaited(promises))
    return story


def _failed(results: Results) -> Table:
    lines = []
    for failure in results.failures:
        trial = failure.trial
        where = f"{trial.localizer} on {trial.scenario}, world {trial.trial}"
        lines.append([f"{where}, filter seed {trial.filter_seed}", failure.reason])
    caption = "Trials that raised an error; no mean includes them."
    return Table(caption, ["trial", "reason"], lines, words=True)


def _left_out(results: Results) -> Table:
    listed = list(results.left_out.items())
    lines = [[name, why] for name, why in listed[:_LISTED]]
    if len(listed) > _LISTED:
        lines.append([f"… and {len(listed) - _LISTED:,} more", ""])
    caption = "Files in the folder that are no trials of this sweep."
    return Table(caption, ["file", "why"], lines, words=True)


def _awaited(promises: Sequence[Promise]) -> dict[str, Any]:
    try:
        return {"animations": [promise() for promise in promises]}
    except InputError as error:
        return {"no_animation": str(error)}
    except Exception as error:  # a plug-in that is no longer there is no reason to say nothing
        return {"no_animation": f"its trials could not be run again ({in_words(error)})"}
