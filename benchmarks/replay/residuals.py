"""``deqmcl replay --residuals``: where the map is wrong, by the run that fits it best."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from benchmarks.pictures import styled
from benchmarks.replay.map_places import HIT, LEAST_POSES, THROUGH, Place, Scans, places_of
from benchmarks.replay.options import Replay
from benchmarks.report.charts import INK, STYLE, Chart
from benchmarks.report.tables import Table
from benchmarks.report.tracks import ended, map_axes
from benchmarks.tables.text import csv_text, percent
from deqmcl_gym.files import utf8
from deqmcl_gym.maps import Map

HEADING = "Where is the map wrong?"
PICTURE, TABLE = "residuals.png", "residuals.csv"
_LISTED = 12  # places in the page; so many have their number in the picture
_NUMBERS = ("x", "y", "width", "height")
_COLORS = {HIT: "C3", THROUGH: "C0"}
_MARKS = {HIT: "s", THROUGH: "D"}
_WIDTH = 6.4  # inches


@dataclass(frozen=True)
class Residuals:
    """Where the map is wrong, by the scans of one run, from the poses of its best clusters.

    Attributes:
        run: of a localizer, the one whose scans agree best with the map.
        floor_plan: the map that it was given.
    """

    run: pd.Series
    floor_plan: Map

    @cached_property
    def scans(self) -> Scans:
        """Its scans, and where they were taken."""
        track = self.run["track"]
        return Scans(self.floor_plan, track.log.scanner, track.best, track.log.ranges)

    @cached_property
    def places(self) -> list[Place]:
        """Where the map is wrong, the largest place first."""
        return places_of(self.scans.evidence)

    @property
    def said(self) -> str:
        """What was found, in words."""
        kinds = [place.kind for place in self.places]
        found = f"{kinds.count(HIT)} places hit in free space, {kinds.count(THROUGH)} seen through"
        basis = (
            f"by {int(self.scans.used.sum()):,} of {len(self.scans.used):,} scans of "
            f"{self.run['label']}, seed {self.run['seed']}, the run whose scans agree best with "
            "the map"
        )
        return f"Where the map is wrong: {found}, {basis}."

    @property
    def csv(self) -> str:
        """residuals.csv: a line per place."""
        unit = self.floor_plan.unit
        header = ["place", "kind", *(f"{name}_{unit}" for name in _NUMBERS)]
        lines = (
            [
                *(number, place.kind),
                *(f"{getattr(place, name):.3f}" for name in _NUMBERS),
                *(place.cells, place.beams, place.poses, f"{place.share:.4f}"),
            ]
            for number, place in enumerate(self.places, 1)
        )
        return csv_text([*header, "cells", "beams", "poses", "share"], lines)

    @property
    def table(self) -> Table | None:
        """The largest places; None if there is none."""
        if not self.places:
            return None
        unit = self.floor_plan.unit
        header = ["place", "kind", f"x, {unit}", f"y, {unit}", f"extent, {unit}"]
        header += ["beams", "poses", "share"]
        lines = [
            [
                *(str(number), place.kind, f"{place.x:.1f}", f"{place.y:.1f}"),
                f"{place.width:.1f} × {place.height:.1f}",
                *(f"{place.beams:,}", str(place.poses), percent(place.share)),
            ]
            for number, place in enumerate(self.places[:_LISTED], 1)
        ]
        rest = len(self.places) - len(lines)
        caption = (
            "Share: of the beams that reach its cells, those that contradict the map. Poses: at "
            "least 0.5 m apart." + (f" The {rest} smaller places are in {TABLE}." if rest else "")
        )
        return Table(caption, pd.DataFrame(lines, columns=header))

    @cached_property
    def chart(self) -> Chart:
        """The map in grey, with the cells of all places."""
        axes = map_axes(self.floor_plan, _WIDTH)
        x, y = self.scans.poses[self.scans.used, :2].T
        axes.plot(x, y, ".", color=INK, alpha=0.35, ms=1.2, label="poses of the scans")
        x0, y0, x1, y1 = self.floor_plan.bounds
        lattice = self.scans.evidence.lattice
        size = max(lattice.cell * 72 * (_WIDTH - 0.8) / max(x1 - x0, y1 - y0), 2.2)
        for kind, color in _COLORS.items():
            if cells := [place.at for place in self.places if place.kind == kind]:
                at = lattice.centres(np.concatenate(cells)).T
                axes.plot(*at, _MARKS[kind], color=color, ms=size, mew=0, label=kind)
        for number, place in enumerate(self.places[:_LISTED], 1):
            axes.annotate(
                str(number), (place.x, place.y), (5, 5), textcoords="offset points", size=8
            )
        axes.figure.legend(loc="outside lower center", ncols=3, frameon=False)
        listed = min(len(self.places), _LISTED)
        caption = f"Numbers: the {listed} largest places, as in the table."
        return Chart(
            "residuals", HEADING, caption if listed else "No place was found.", axes.figure
        )

    @property
    def part(self) -> tuple[str, str, list[Table], list[Chart]]:
        """What the page shows: heading, how to read it, table, picture."""
        note = (
            f"{self.said} A place counts if beams from {LEAST_POSES} poses or more, at least "
            "0.5 m apart, read clearly less (hit in free space) or more (seen through) than the "
            "map says, and no more beams agree with it. Unknown cells say nothing."
        )
        with styled(STYLE):
            return HEADING, note, [self.table] if self.table else [], [self.chart]


def residuals_of(replay: Replay, runs: pd.DataFrame) -> Residuals | None:
    """Return where the map is wrong, by the run that fits it best; None if no run has ended."""
    done = ended(runs)
    if done.empty:
        return None
    best = int(done["agreement_03"].argmax())
    return Residuals(done.iloc[best], replay.scenario.recording()[1])


def files_of(found: Residuals, *, drawn: bool) -> Mapping[str, bytes]:
    """Return residuals.csv and, if it can be ``drawn``, residuals.png, by name."""
    files = {TABLE: utf8(found.csv)}
    if drawn:
        with styled(STYLE):
            files[PICTURE] = found.chart.drawn("png", dpi=200)
    return files
