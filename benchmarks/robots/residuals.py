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
from typing import Any, NamedTuple

import cv2
import numpy as np
import pandas as pd

from benchmarks.report.charts import INK, Chart, styled
from benchmarks.report.runs import ended
from benchmarks.report.tables import Part, Table
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


class _Fit(NamedTuple):
    """How each beam of scans fits a map, seen from poses, (n, B) each."""

    ranges: Reals
    expected: Reals  # ∞ where only unknown cells or nothing is met
    returned: Bools  # reflected within range
    short: Bools  # that, and clearly less than from every pose nearby
    long: Bools  # that, and clearly more

    @property
    def fits(self) -> Bools:
        """Which beams are returned, and neither short nor long."""
        return self.returned & ~self.short & ~self.long


@dataclass(frozen=True)
class _Lattice:
    """Square cells along x and y over a map, counted row by row from its lower left corner."""

    x: float
    y: float
    cell: float  # its edge
    shape: tuple[int, int]  # rows, columns

    def count(self, cells: Indices) -> Indices:
        """Count the points in each cell, (k,); -1 is none."""
        return np.bincount(cells[cells >= 0], minlength=math.prod(self.shape))

    def cells(self, points: Floats) -> Indices:
        """Return the cell of each point (..., 2), -1 outside."""
        with np.errstate(invalid="ignore"):
            column, row = np.moveaxis(np.floor((points - [self.x, self.y]) / self.cell), -1, 0)
            inside = (row >= 0) & (row < self.shape[0]) & (column >= 0) & (column < self.shape[1])
        return np.where(inside, row * self.shape[1] + column, -1).astype(np.intp)

    def centres(self, cells: Indices) -> Floats:
        """Return the centres of cells, (n, 2)."""
        row, column = np.divmod(cells, self.shape[1])
        return (self.x, self.y) + self.cell * (np.column_stack([column, row]) + 0.5)


@dataclass(frozen=True)
class Residuals:
    """Where a map is wrong, by scans from poses on it, one after the other, (n, 3) and (n, B)."""

    floor_plan: Map
    lidar: Lidar
    poses: Reals
    ranges: Reals
    whose: str = ""

    @cached_property
    def _of_all(self) -> _Fit:
        """How all scans fit; readings without a number are no returns.

        A beam that grazes a wall, or passes its corner, reads something else from 0.1 m beside: a
        reading contradicts the map if it clearly differs from what is read from all poses nearby.
        """
        length, ranges = metre(self.floor_plan.unit), self.ranges
        near, turn = _NEARBY[0] * length, _NEARBY[1]
        steps = np.vstack([np.zeros(3), *(sign * np.diag((near, near, turn)) for sign in (-1, 1))])
        around = (steps[:, None] + self.poses).reshape(-1, 3)
        seen = self.lidar.ranges(known_part(self.floor_plan), around.T)
        seen = seen.reshape(len(steps), len(ranges), -1)
        clear = max(_CLEAR * length, _SIGMAS * self.lidar.sigma)
        returned = np.isfinite(ranges) & (ranges < self.lidar.max_range)
        short = returned & (ranges < seen.min(axis=0) - clear)
        long = returned & (ranges > seen.max(axis=0) + clear)
        return _Fit(ranges, seen[0], returned, short, long)

    @cached_property
    def used(self) -> Bools:
        """Whether the robot is not lost at a scan, by the median share that 21 explain, (n,)."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # no return in a scan, or in 21
            explained = self._of_all.fits.sum(axis=1) / self._of_all.returned.sum(axis=1)
            padded = np.pad(explained, _AROUND, constant_values=np.nan)
            windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1)
            return np.asarray(np.nanmedian(windows, axis=1) >= _EXPLAINED)

    @cached_property
    def _fit(self) -> _Fit:
        """How the scans that are used fit."""
        used: Any = (part[self.used] for part in self._of_all)
        return _Fit(*used)

    @cached_property
    def lattice(self) -> _Lattice:
        """Cells of 0.1 m, or of the map's resolution if that is coarser, over the map."""
        x0, y0, x1, y1 = self.floor_plan.bounds
        cell = max(_CELL * metre(self.floor_plan.unit), getattr(self.floor_plan, "resolution", 0.0))
        rows, columns = (int(np.ceil(side / cell)) + 1 for side in (y1 - y0, x1 - x0))
        return _Lattice(x0, y0, cell, (rows, columns))

    @cached_property
    def _rays(self) -> Floats:
        """Starts and angles in the map of the rays of the scans that are used, (3, n, B)."""
        poses = self.poses[self.used]
        rays = np.empty((3, len(poses), self.lidar.beams))
        for origins, rows in self.lidar.fans(poses.T):
            rays[:, :, rows] = origins[:, :, None]
        rays[2] += self.lidar.bearings
        return rays

    def _points(self, ranges: Reals) -> Floats:
        """Return the point on each ray so far away, (n, B, 2); NaN for ∞."""
        x, y, angles = self._rays
        far = np.where(np.isfinite(ranges), ranges, np.nan)
        return np.stack([x + far * np.cos(angles), y + far * np.sin(angles)], axis=-1)

    def _passed(self, ranges: Floats) -> Indices:
        """Count the rays that pass each cell before they are so far, sampled at each cell."""
        beams, step = ranges > 0, 0
        start, angle, far = self._rays[:2, beams].T, self._rays[2, beams], ranges[beams]
        ahead = np.column_stack([np.cos(angle), np.sin(angle)]) * self.lattice.cell
        passed = np.zeros(math.prod(self.lattice.shape), np.intp)
        while far.size:
            passed += self.lattice.count(self.lattice.cells(start + step * ahead))
            step += 1
            on = far > step * self.lattice.cell
            start, ahead, far = start[on], ahead[on], far[on]
        return passed

    @cached_property
    def places(self) -> list[Place]:
        """Where the map is wrong, the place of the most evidence first."""
        fit, lattice, length = self._fit, self.lattice, metre(self.floor_plan.unit)
        ranges, clear = fit.ranges.astype(np.float64), _CLEAR * length
        ends = self._points(ranges)
        free = known_part(self.floor_plan).free(ends.reshape(-1, 2))
        hit = fit.short & free.reshape(ranges.shape)
        solid = self.floor_plan  # all whose unknown cells are free
        solid = replace(solid, unknown="free") if isinstance(solid, GridMap) else solid
        hit[hit] = solid.distance(ends[hit]) > clear
        walls = lattice.cells(self._points(fit.expected + 0.25 * lattice.cell))  # just inside them
        with np.errstate(invalid="ignore"):
            ended_there = fit.fits & (np.abs(ranges - fit.expected) <= clear)
        passed = self._passed(np.where(fit.returned, ranges - clear, 0.0))
        stopped = lattice.count(walls[ended_there])
        numbers = _numbered(self.poses[self.used], _APART * length)
        seen = {HIT: (lattice.cells(ends), hit, passed), THROUGH: (walls, fit.long, stopped)}
        places = list[Place]()
        for kind, (cells, against, agreed) in seen.items():
            poses = numbers[np.nonzero(against)[0]]
            places += self._places(kind, cells[against], poses, agreed)
        return sorted(places, key=lambda place: -place.evidence)

    def _places(
        self, kind: str, cells: Indices, poses: Indices, agreed: Indices
    ) -> Iterator[Place]:
        """Yield places by the cell and the pose of each beam against the map, and what agrees."""
        against = self.lattice.count(cells)
        share = against / np.maximum(against + agreed, 1)
        total = max(int(against.sum() + agreed.sum()), 1)
        usual = float(np.clip(int(against.sum()) / total, *_USUAL))
        marked = (against >= _LEAST_BEAMS) & (share >= _LEAST_SHARE)
        image = marked.reshape(self.lattice.shape).astype(np.uint8)
        wide = cv2.dilate(image, np.ones((3, 3), np.uint8))  # joins what is a cell or two apart
        labels = np.where(marked, cv2.connectedComponents(wide, connectivity=8)[1].ravel(), 0)
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
        return (
            f"Where the map is wrong: {amount(kinds.count(HIT), 'place')} {HIT}, "
            f"{kinds.count(THROUGH)} {THROUGH}, by {int(self.used.sum()):,} of "
            f"{len(self.used):,} scans of {self.whose}, the run whose scans agree best with the "
            f"map. {self.spread}"
        )

    @property
    def spread(self) -> str:
        """Whether residuals are at walls everywhere, or of things that moved, in words."""
        fit, unit = self._fit, self.floor_plan.unit
        if not fit.fits.any():
            return ""
        off = known_part(self.floor_plan).distance(self._points(fit.ranges)[fit.fits])
        cell = getattr(self.floor_plan, "resolution", _FINE * metre(unit))
        blur, against = float(np.median(off)), int((fit.short | fit.long).sum())
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
            "place": range(1, len(listed) + 1),
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
