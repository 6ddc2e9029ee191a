"""``deqmcl replay --residuals``: places at which a map is wrong, seen through or hit in free space.

Residuals of a robot that knows where it is concentrate on places of the map and repeat from other
poses; those of a lost one are everywhere. So a place counts only where beams from several poses
contradict the map, and more of them than agree with it. Unknown cells say nothing. Places are
ranked by evidence: how much likelier a share s of their beams is from the poses there than p, that
of all cells, as of a map that is right: poses · KL(s ‖ p) nats.
"""

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd

from benchmarks.report.charts import INK, Chart, styled
from benchmarks.report.runs import ended
from benchmarks.report.tables import Part, Table
from benchmarks.report.tracks import map_axes
from benchmarks.robots import scan_fits
from benchmarks.robots.played import Replay
from benchmarks.tables import percent
from deqmcl_gym.files import utf8
from deqmcl_gym.maps import GridMap, Lidar, Map
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Bools, Indices, Reals
from deqmcl_gym.validation import amount

HIT, THROUGH = "hit in free space", "seen through"
HEADING = "Where is the map wrong?"
PICTURE, TABLE = "residuals.png", "residuals.csv"
_LEAST_POSES, _LEAST_BEAMS, _LEAST_CELLS = 3, 2, 2
_LEAST_SHARE = 0.5  # of the beams that reach a cell, those that contradict the map
_EXPLAINED = 0.75  # of the returns of a scan and most scans around it: the robot is not lost
_AROUND = 10  # scans before and after
_CELL = 0.05  # m, of a map without cells
_BLURRED = 0.7  # of a cell: half of what fits is nearer to walls on a sharp map
_GATHERED = 0.1  # of what does not fit, the share at places that says that things have moved
_USUAL = 0.01, 0.3  # least and most share of the beams that contradict a map that is right
_LISTED = 12  # places in the page; so many have their number in the picture
_LOOKS = {HIT: ("C3", "s"), THROUGH: ("C0", "D")}
_WIDTH = 6.4  # inches


class Place(NamedTuple):
    """A place at which a map is wrong, lengths in the map's unit: centre and size of its cells."""

    kind: str
    x: float
    y: float
    width: float
    height: float
    cells: int
    beams: int  # that contradict the map there
    poses: int  # from where they do, at least 0.5 m apart
    share: float  # of the beams that reach its cells
    evidence: float  # nats, against a map that is right there
    at: Indices  # its cells


@dataclass(frozen=True)
class Residuals:
    """Where a map is wrong, by scans from poses on it, one after the other, (n, 3) and (n, B)."""

    floor_plan: Map
    lidar: Lidar
    poses: Reals
    ranges: Reals
    whose: str = ""

    @cached_property
    def _fit(self) -> scan_fits.Fit:
        floor_plan = scan_fits.known_part(self.floor_plan)
        return scan_fits.Fit.of(floor_plan, self.lidar, self.poses, self.ranges)

    @cached_property
    def used(self) -> Bools:
        """Whether the robot is not lost at a scan, by the median share that 21 explain, (n,)."""
        padded = np.pad(self._fit.explained, _AROUND, constant_values=np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # no return in any of them
            return np.asarray(np.nanmedian(windows, axis=1) >= _EXPLAINED)

    @cached_property
    def lattice(self) -> scan_fits.Lattice:
        """The cells that places are made of."""
        return scan_fits.Lattice.over(self.floor_plan)

    @cached_property
    def places(self) -> list[Place]:
        """Where the map is wrong, the place of the most evidence first."""
        used, fit, length = self.used, self._fit, metre(self.floor_plan.unit)
        rays = scan_fits.Rays.of(self.lattice, self.lidar, self.poses[used])
        ranges, expected = self.ranges[used].astype(np.float64), fit.expected[used]
        returned, short, fits = fit.returned[used], fit.short[used], fit.fits[used]
        clear = scan_fits.CLEAR * length
        ends = np.column_stack([points.ravel() for points in rays.points(ranges)])
        hit = short & scan_fits.known_part(self.floor_plan).free(ends).reshape(short.shape)
        solid = self.floor_plan  # all whose unknown cells are free
        solid = replace(solid, unknown="free") if isinstance(solid, GridMap) else solid
        hit[hit] = solid.distance(ends[hit.ravel()]) > clear
        walls = rays.cells(expected + 0.25 * self.lattice.cell)  # just inside the wall
        with np.errstate(invalid="ignore"):
            ended_there = fits & (np.abs(ranges - expected) <= clear)
        passed = rays.passed(np.where(returned, ranges - clear, 0.0))
        stopped = scan_fits.count(walls[ended_there], self.lattice)
        numbers = _numbered(self.poses[used], scan_fits.APART * length)
        seen = {HIT: (rays.cells(ranges), hit, passed), THROUGH: (walls, fit.long[used], stopped)}
        places = list[Place]()
        for kind, (cells, against, agreed) in seen.items():
            poses = numbers[np.nonzero(against)[0]]
            places += self._places(kind, cells[against], poses, agreed)
        return sorted(places, key=lambda place: -place.evidence)

    def _places(
        self, kind: str, cells: Indices, poses: Indices, agreed: Indices
    ) -> Iterator[Place]:
        """Yield places by the cell and the pose of each beam against the map, and what agrees."""
        against = scan_fits.count(cells, self.lattice)
        share = against / np.maximum(against + agreed, 1)
        total = max(int(against.sum() + agreed.sum()), 1)
        usual = float(np.clip(int(against.sum()) / total, *_USUAL))
        labels = self.lattice.groups((against >= _LEAST_BEAMS) & (share >= _LEAST_SHARE))
        inside = cells >= 0
        pairs = np.unique(np.column_stack([labels[cells[inside]], poses[inside]]), axis=0)
        for label in range(1, labels.max() + 1):
            at = np.flatnonzero(labels == label)
            count = int((pairs[:, 0] == label).sum())
            if count < _LEAST_POSES or at.size < _LEAST_CELLS:
                continue
            centres = self.lattice.centres(at)
            x, y = centres.mean(axis=0).tolist()
            width, height = (np.ptp(centres, axis=0) + self.lattice.cell).tolist()
            beams, others = int(against[at].sum()), int(agreed[at].sum())
            part = float(beams / (beams + others))
            other = max(1 - part, 1e-9)
            evidence = part * math.log(part / usual) + other * math.log(other / (1 - usual))
            evidence *= count
            yield Place(kind, x, y, width, height, at.size, beams, count, part, evidence, at)

    @property
    def said(self) -> str:
        """What was found, in words."""
        kinds = [place.kind for place in self.places]
        hit = kinds.count(HIT)
        return (
            f"Where the map is wrong: {amount(hit, 'place')} {HIT}, "
            f"{kinds.count(THROUGH)} {THROUGH}, by {int(self.used.sum()):,} of "
            f"{len(self.used):,} scans of {self.whose}, the run whose scans agree best with the "
            f"map. {self.spread}"
        )

    @property
    def spread(self) -> str:
        """Whether residuals are at walls everywhere, or of things that moved, in words."""
        fit, ranges, unit = self._fit, self.ranges[self.used], self.floor_plan.unit
        fits = fit.fits[self.used]
        if not fits.any():
            return ""
        rays = scan_fits.Rays.of(self.lattice, self.lidar, self.poses[self.used])
        x, y = rays.points(ranges)
        off = scan_fits.known_part(self.floor_plan).distance(np.column_stack([x[fits], y[fits]]))
        cell = getattr(self.floor_plan, "resolution", _CELL * metre(unit))
        blur, against = float(np.median(off)), int((fit.short | fit.long)[self.used].sum())
        things = sum(place.beams for place in self.places) / max(against, 1)
        words = "what does not fit is scattered, as people and edges are"
        if blur > _BLURRED * cell:
            words = "residuals are at walls everywhere, so the map is blurred or the poses are off"
        elif not against:
            return "All returns fit the map."
        elif things > _GATHERED:
            words = "what does not fit is gathered, so things have moved"
        return (
            f"Half of the returns that fit are within {blur:.3f} {unit} of a wall, and "
            f"{percent(things)} of the {against:,} that do not are at these places: {words}."
        )

    def files(self, *, drawn: bool) -> dict[str, bytes]:
        """Return residuals.csv, a line per place, and residuals.png if it can be ``drawn``."""
        frame = pd.DataFrame(self.places, columns=Place._fields).drop(columns="at")
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
            "place": [str(number + 1) for number in range(len(listed))],
            "kind": [place.kind for place in listed],
            f"x, {unit}": [f"{place.x:.1f}" for place in listed],
            f"y, {unit}": [f"{place.y:.1f}" for place in listed],
            f"extent, {unit}": [f"{place.width:.1f} × {place.height:.1f}" for place in listed],
            "beams": [f"{place.beams:,}" for place in listed],
            "poses": [str(place.poses) for place in listed],
            "share": [percent(place.share) for place in listed],
        }
        return Table("residuals", pd.DataFrame(columns), about=len(self.places) - len(listed))

    @cached_property
    def chart(self) -> Chart:
        """The map in grey, with the cells of all places."""
        axes = map_axes(self.floor_plan, _WIDTH)
        x, y = self.poses[self.used, :2].T
        axes.plot(x, y, ".", color=INK, alpha=0.35, ms=1.2, label="poses of the scans")
        x0, y0, x1, y1 = self.floor_plan.bounds
        size = max(self.lattice.cell * 72 * (_WIDTH - 0.8) / max(x1 - x0, y1 - y0), 2.2)
        for kind, (color, mark) in _LOOKS.items():
            if cells := [place.at for place in self.places if place.kind == kind]:
                at = self.lattice.centres(np.concatenate(cells)).T
                axes.plot(*at, mark, color=color, ms=size, mew=0, label=kind)
        for number, place in enumerate(self.places[:_LISTED], 1):
            centre = place.x, place.y
            axes.annotate(str(number), centre, (5, 5), textcoords="offset points", size=8)
        axes.figure.legend(loc="outside lower center", ncols=3, frameon=False)
        listed = min(len(self.places), _LISTED)
        words = f"Numbers: the first {listed} places, as in the table."
        return Chart("residuals", HEADING, words if listed else "No place was found.", axes.figure)

    @property
    def part(self) -> Part:
        """What the page shows."""
        note = (
            f"{self.said} A place counts if beams from {_LEAST_POSES} poses or more, at least "
            "0.5 m apart, read clearly less (hit in free space) or more (seen through) than the "
            "map says, and no more beams agree with it. Unknown cells say nothing."
        )
        with styled():
            return Part(HEADING, note, [self.table()] if self.places else [], [self.chart])


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
    firsts: list[Reals] = []
    numbers = np.empty(len(poses), np.intp)
    for i, place in enumerate(poses[:, :2]):
        off = np.hypot(*(np.array(firsts).reshape(-1, 2) - place).T)
        nearest = int(off.argmin()) if firsts else 0
        if not firsts or off[nearest] >= least:
            nearest = len(firsts)
            firsts.append(place)
        numbers[i] = nearest
    return numbers
