"""The content of a report, before it is HTML or Markdown."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import matplotlib as mpl

from benchmarks.report.animations import Animator, Promise
from benchmarks.report.laps import Lap, laps
from benchmarks.report.parts import Block, blocks
from benchmarks.report.style import looks
from benchmarks.report.svg import HOUSE_STYLE, Picture
from benchmarks.report.swept import charts_over
from benchmarks.sweeps.results import Results
from benchmarks.tables.panels import Panel
from deqmcl_gym.validation import InputError

PICTURED = 8  # panels with pictures; the tables are of all
ANIMATED = 1  # panels with animations: they are what makes a page large


@dataclass(frozen=True, kw_only=True)
class Section:
    """A panel and its pictures.

    Attributes:
        panel: what its tables are of.
        blocks: tables and charts, part by part.
        laps: animations.
        no_laps: why there are none, if they failed.
    """

    panel: Panel
    blocks: list[Block] = field(default_factory=list)
    laps: list[Lap] = field(default_factory=list)
    no_laps: str = ""


@dataclass(frozen=True, kw_only=True)
class Story:
    """What a report tells: the results, panel by panel, what was swept, and what else there is."""

    results: Results
    sections: list[Section]
    curves: list[Picture]
    notes: Sequence[str] = ()
    warnings: Sequence[str] = ()

    @property
    def panels(self) -> list[Panel]:
        """The panels of its sections."""
        return [section.panel for section in self.sections]

    @property
    def pictures(self) -> list[Picture]:
        """All its charts."""
        shown = (block.pictures for section in self.sections for block in section.blocks)
        return [*self.curves, *(picture for pictures in shown for picture in pictures)]


def story_of(
    results: Results, animator: Animator, notes: Sequence[str] = (), warnings: Sequence[str] = ()
) -> Story:
    """Draw everything; the animations are the animator's."""
    panels = results.panels
    look = looks(label for panel in panels for label in panel.labels.values())
    animated = panels[:ANIMATED]
    with animator.working() as promised, mpl.rc_context(HOUSE_STYLE):
        waiting = [[promised(lap) for lap in laps(panel)] for panel in animated]
        sections = [
            Section(panel=panel, blocks=blocks(panel, look, pictured=panel.number <= PICTURED))
            for panel in panels
        ]
        story = Story(
            results=results,
            sections=sections,
            curves=charts_over(panels, look),
            notes=notes,
            warnings=warnings,
        )
        for picture in story.pictures:  # drawn while workers draw the animations
            _ = picture.source
        for place, drawing in enumerate(waiting):
            sections[place] = replace(sections[place], **_awaited(drawing))
    return story


def _awaited(drawing: Sequence[Promise]) -> dict[str, Any]:
    try:
        return {"laps": [lap() for lap in drawing]}
    except InputError as error:
        return {"no_laps": str(error)}
    except Exception as error:  # a plug-in that is no longer there is no reason to say nothing
        return {"no_laps": f"its trials could not be run again ({type(error).__name__}: {error})"}
