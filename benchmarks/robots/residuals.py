"""``deqmcl replay --residuals``: places at which a map is wrong, seen through or hit in free space.

Residuals of a robot that knows where it is concentrate on places of the map and repeat from other
poses; those of a lost one are everywhere. So a place counts only where beams from several poses
contradict the map, and more of them than agree with it. Unknown cells say nothing. Places are
ranked by evidence: how much likelier a share s of their beams is from the poses there than p, that
of all cells, as of a map that is right: poses · KL(s ‖ p) nats.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import pandas as pd

from benchmarks.report.charts import INK, Chart, styled
from benchmarks.report.runs import ended
from benchmarks.report.tables import Part, Table, words
from benchmarks.report.tracks import map_axes
from benchmarks.robots import Replay
from benchmarks.robots.calibration import known_part
from benchmarks.tables import percent
from deqmcl_gym.files import utf8
from deqmcl_gym.maps import GridMap, Lidar, Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Bools, Floats, Indices, Reals
from deqmcl_gym.validation import amount

HIT, THROUGH = "hit in free space", "seen through"
HEADING = "Where is the map wrong?"
PICTURE, TABLE = "residuals.png", "residuals.csv"
_CLEAR = 0.2  # m by which a reading differs from all that the map says from poses nearby
_SIGMAS = 3.0  # of the lidar's noise, if that is more
_NEARBY = (0.1, np.radians(2.0))  # m, rad: how far off a pose of a robot that is localized may be
_CELL = 0.1  # m, or a cell of the map if that is larger
_APART = 0.5  # m between poses that count as different ones
_LEAST_POSES, _LEAST_BEAMS, _LEAST_CELLS = 3, 2, 2
_LEAST_SHARE = 0.5  # of the beams that reach a cell, those that contradict the map
_EXPLAINED = 0.75  # of the returns of a scan and most scans around it: the robot is not lost
_AROUND = 10  # scans before and after
_FINE = 0.05  # m, a cell of a map without cells
_BLURRED = 0.7  # of a cell: half of what fits is nearer to walls on a sharp map
_GATHERED = 0.1  # of what does not fit, the share at places that says that things have moved
_USUAL = 0.01, 0.3  # least and most share of the beams that contradict a map that is right
_LISTED = 12  # places in the page; so many have their number in the picture
_PLACE = [  # of cells that are near each other: centre and size, in the map's unit
    *("kind", "x", "y", "width", "height", "cells"),
    "beams",  # that contradict the map there
    "poses",  # from where they do, at least 0.5 m apart
    "share",  # of the beams that reach its cells
    "evidence",  # nats, against a map that is right there
    "at",  # its cells
]
_LOOKS = {HIT: ("C3", "s"), THROUGH: ("C0", "D")}
_WIDTH = 6.4  # inches


class Residuals:
    """Where a map is wrong, by scans (n, B) from poses on it (n, 3), one after the other.

    A beam that grazes a wall, or passes its corner, reads something else from 0.1 m beside: a
    reading contradicts the map if it clearly differs from what is read from all poses nearby.
    Readings without a number are no returns.
    """

    def __init__(
        self, floor_plan: Map, lidar: Lidar, poses: Reals, ranges: Reals, whose: str = ""
    ) -> None:
        self.floor_plan, self.whose = floor_plan, whose
        self._known, self._metre = known_part(floor_plan), metre(floor_plan.unit)
        near, turn = _NEARBY[0] * self._metre, _NEARBY[1]
        steps = np.vstack([np.zeros(3), *(sign * np.diag((near, near, turn)) for sign in (-1, 1))])
        around = (steps[:, None] + poses).reshape(-1, 3)
        seen = lidar.ranges(self._known, around.T).reshape(len(steps), len(ranges), -1)
        clear = max(_CLEAR * self._metre, _SIGMAS * lidar.sigma)
        returned = np.isfinite(ranges) & (ranges < lidar.max_range)
        short = returned & (ranges < seen.min(axis=0) - clear)
        long = returned & (ranges > seen.max(axis=0) + clear)
        fits = returned & ~short & ~long
        explained = pd.Series(fits.sum(axis=1)) / returned.sum(axis=1)
        around_it = explained.rolling(2 * _AROUND + 1, center=True, min_periods=1)
        self.used: Bools = (around_it.median() >= _EXPLAINED).to_numpy()  # the robot is not lost
        self._poses, self._ranges = poses[self.used], ranges[self.used]
        self._expected: Reals = seen[0, self.used]  # ∞ where only unknown cells or nothing is met
        self._short, self._long = short[self.used], long[self.used]
        self._returned, self._fits = returned[self.used], fits[self.used]
        rays = np.array([lidar.rays(pose) for pose in self._poses]).reshape(-1, lidar.beams, 3)
        self._starts, angles = rays[..., :2], rays[..., 2]
        self._directions: Floats = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        self._cell = max(_CELL * self._metre, getattr(floor_plan, "resolution", 0.0))
        x0, y0, x1, y1 = floor_plan.bounds
        self._corner = np.array([x0, y0])  # of square cells over the map, counted row by row
        self._shape = tuple(math.ceil(side / self._cell) + 1 for side in (y1 - y0, x1 - x0))
        # a row for each place at which the map is wrong, that of the most evidence first
        rows = pd.DataFrame([*self._places()], columns=_PLACE)
        self.places = rows.sort_values("evidence", ascending=False, kind="stable")

    def _cells(self, points: Floats) -> Indices:
        """Return the cell of each point (..., 2), -1 outside."""
        rows, columns = self._shape
        with np.errstate(invalid="ignore"):
            column, row = np.moveaxis(np.floor((points - self._corner) / self._cell), -1, 0)
            inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.where(inside, row * columns + column, -1).astype(np.intp)

    def _count(self, cells: Indices) -> Indices:
        """Count the points in each cell, (k,); -1 is none."""
        return np.bincount(cells[cells >= 0], minlength=math.prod(self._shape))

    def _centres(self, cells: Indices) -> Floats:
        """Return the centres of cells, (n, 2)."""
        row, column = np.divmod(cells, self._shape[1])
        return self._corner + self._cell * (np.column_stack([column, row]) + 0.5)

    def _points(self, ranges: Reals) -> Floats:
        """Return the point on each ray so far away, (n, B, 2); NaN for ∞."""
        far = np.where(np.isfinite(ranges), ranges, np.nan)
        return self._starts + far[..., None] * self._directions

    def _passed(self, ranges: Floats) -> Indices:
        """Count the rays that pass each cell before they are so far, sampled at each cell."""
        beams, step = ranges > 0, 0
        start, ahead = self._starts[beams], self._directions[beams] * self._cell
        far, passed = ranges[beams], np.zeros(math.prod(self._shape), np.intp)
        while far.size:
            passed += self._count(self._cells(start + step * ahead))
            step += 1
            on = far > step * self._cell
            start, ahead, far = start[on], ahead[on], far[on]
        return passed

    def _places(self) -> Iterator[tuple[Any, ...]]:
        ranges, clear = self._ranges.astype(np.float64), _CLEAR * self._metre
        ends = self._points(ranges)
        hit = self._short & self._known.free(ends.reshape(-1, 2)).reshape(ranges.shape)
        solid = self.floor_plan  # all whose unknown cells are free
        solid = replace(solid, unknown="free") if isinstance(solid, GridMap) else solid
        hit[hit] = solid.distance(ends[hit]) > clear
        walls = self._cells(self._points(self._expected + 0.25 * self._cell))  # just inside them
        with np.errstate(invalid="ignore"):
            ended_there = self._fits & (np.abs(ranges - self._expected) <= clear)
        passed = self._passed(np.where(self._returned, ranges - clear, 0.0))
        numbers = _numbered(self._poses, _APART * self._metre)
        yield from self._places_of(HIT, self._cells(ends), hit, numbers, passed)
        stopped = self._count(walls[ended_there])
        yield from self._places_of(THROUGH, walls, self._long, numbers, stopped)

    def _places_of(
        self, kind: str, cells: Indices, beams: Bools, poses: Indices, agreed: Indices
    ) -> Iterator[tuple[Any, ...]]:
        """Yield places by the cells of beams against the map, their poses, and what agrees."""
        poses, cells = poses[np.nonzero(beams)[0]], cells[beams]
        against = self._count(cells)
        share = against / np.maximum(against + agreed, 1)
        total = max(int(against.sum() + agreed.sum()), 1)
        usual = float(np.clip(int(against.sum()) / total, *_USUAL))
        marked = (against >= _LEAST_BEAMS) & (share >= _LEAST_SHARE)
        image = marked.reshape(self._shape).astype(np.uint8)
        wide = cv2.dilate(image, np.ones((3, 3), np.uint8))  # joins what is a cell or two apart
        labels = np.where(marked, cv2.connectedComponents(wide, connectivity=8)[1].ravel(), 0)
        for label in range(1, labels.max() + 1):
            at = np.flatnonzero(labels == label)
            count = np.unique(poses[np.isin(cells, at)]).size
            if count < _LEAST_POSES or at.size < _LEAST_CELLS:
                continue
            centres = self._centres(at)
            x, y = centres.mean(axis=0).tolist()
            width, height = (np.ptp(centres, axis=0) + self._cell).tolist()
            hits, others = int(against[at].sum()), int(agreed[at].sum())
            part = float(hits / (hits + others))
            other = max(1 - part, 1e-9)
            evidence = part * math.log(part / usual) + other * math.log(other / (1 - usual))
            evidence *= count
            yield kind, x, y, width, height, at.size, hits, count, part, evidence, at

    @property
    def said(self) -> str:
        """What was found, in words."""
        kinds = [*self.places["kind"]]
        return (
            f"Where the map is wrong: {amount(kinds.count(HIT), 'place')} {HIT}, "
            f"{kinds.count(THROUGH)} {THROUGH}, by {int(self.used.sum()):,} of "
            f"{len(self.used):,} scans of {self.whose}, the run whose scans agree best with the "
            f"map. {self._spread}"
        )

    @property
    def _spread(self) -> str:
        """Whether residuals are at walls everywhere, or of things that moved, in words."""
        fits, unit = self._fits, self.floor_plan.unit
        if not fits.any():
            return ""
        off = self._known.distance(self._points(self._ranges)[fits])
        cell = getattr(self.floor_plan, "resolution", _FINE * self._metre)
        blur, against = float(np.median(off)), int((self._short | self._long).sum())
        things = self.places["beams"].sum() / max(against, 1)
        why = "what does not fit is scattered, as people and edges are"
        if blur > _BLURRED * cell:
            why = "residuals are at walls everywhere, so the map is blurred or the poses are off"
        elif not against:
            return "All returns fit the map."
        elif things > _GATHERED:
            why = "what does not fit is gathered, so things have moved"
        return (
            f"Half of the returns that fit are within {blur:.3f} {unit} of a wall, and "
            f"{percent(things)} of the {against:,} that do not are at these places: {why}."
        )

    def files(self, *, drawn: bool) -> dict[str, bytes]:
        """Return residuals.csv, a line per place, and residuals.png if it can be ``drawn``."""
        frame = self.places.drop(columns="at").reset_index(drop=True)
        lengths = ["x", "y", "width", "height"]
        frame[lengths] = frame[lengths].astype(object).map("{:.3f}".format)
        frame["share"] = frame["share"].astype(object).map("{:.4f}".format)
        named = frame.rename(columns={name: f"{name}_{self.floor_plan.unit}" for name in lengths})
        named.index += 1
        files = {TABLE: utf8(named.to_csv(index_label="place", lineterminator="\n"))}
        if drawn:
            with styled():
                files[PICTURE] = self.chart.drawn("png", dpi=200)
        return files

    def table(self) -> Table:
        """Return the first places."""
        unit, listed = self.floor_plan.unit, self.places[:_LISTED]
        columns = {
            "place": range(1, len(listed) + 1),
            "kind": list(listed["kind"]),
            f"x, {unit}": words(listed, "{:.1f}".format, "x"),
            f"y, {unit}": words(listed, "{:.1f}".format, "y"),
            f"extent, {unit}": words(listed, "{:.1f} × {:.1f}".format, "width", "height"),
            "beams": words(listed, "{:,}".format, "beams"),
            "poses": words(listed, str, "poses"),
            "share": words(listed, percent, "share"),
        }
        return Table("residuals", pd.DataFrame(columns), about=len(self.places) - len(listed))

    @cached_property
    def chart(self) -> Chart:
        """The map in grey, with the cells of all places."""
        axes = map_axes(self.floor_plan, _WIDTH)
        x, y, _ = self._poses.T
        axes.plot(x, y, ".", color=INK, alpha=0.35, ms=1.2, label="poses of the scans")
        x0, y0, x1, y1 = self.floor_plan.bounds
        size = max(self._cell * 72 * (_WIDTH - 0.8) / max(x1 - x0, y1 - y0), 2.2)
        for kind, (color, mark) in _LOOKS.items():
            if len(cells := self.places.loc[self.places["kind"] == kind, "at"]):
                at = self._centres(np.concatenate([*cells])).T
                axes.plot(*at, mark, color=color, ms=size, mew=0, label=kind)
        listed = self.places[:_LISTED]
        for number, centre in enumerate(zip(listed["x"], listed["y"], strict=True), 1):
            axes.annotate(str(number), centre, (5, 5), textcoords="offset points", size=8)
        axes.figure.legend(loc="outside lower center", ncols=3, frameon=False)
        caption = f"Numbers: the first {len(listed)} places, as in the table."
        caption = caption if len(listed) else "No place was found."
        return Chart("residuals", HEADING, caption, axes.figure)

    @property
    def part(self) -> Part:
        """What the page shows."""
        note = (
            f"{self.said} A place counts if beams from {_LEAST_POSES} poses or more, at least "
            "0.5 m apart, read clearly less (hit in free space) or more (seen through) than the "
            "map says, and no more beams agree with it. Unknown cells say nothing."
        )
        with styled():
            return Part(HEADING, note, [self.table()] if len(self.places) else [], [self.chart])


def residuals_of(replay: Replay, runs: pd.DataFrame) -> Residuals | None:
    """Return where the map is wrong, by best clusters of the best run; None if none has ended."""
    done = ended(runs)
    if done.empty:
        return None
    run = done.iloc[int(done["agreement_03"].argmax())]
    track, floor_plan = run["track"], replay.scenario.recording()[1]
    whose = f"{run['label']}, seed {run['seed']}"
    return Residuals(floor_plan, track.log.scanner, track.best, track.log.ranges, whose)


def _numbered(poses: Reals, least: float) -> Indices:
    """Number positions (n, 2+); one nearer than ``least`` to an earlier one gets its number."""
    firsts, numbers = np.empty((0, 2)), np.empty(len(poses), np.intp)
    for i, place in enumerate(poses[:, :2]):
        off = np.hypot(*(firsts - place).T)
        if not (off < least).any():
            firsts = np.vstack([firsts, place])
        numbers[i] = off.argmin() if len(off) == len(firsts) else len(off)
    return numbers
