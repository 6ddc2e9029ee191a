"""Log: scans, odometry and reference poses of a robot, record by record, and its scanner."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.logs.motion import dead_reckoned, has_moved, increments_of, lengths_of, sideways_of
from deqmcl_gym.logs.scans import mark_unmeasured
from deqmcl_gym.maps import Lidar
from deqmcl_gym.maps.map import LENGTH, PIXELS, bounded
from deqmcl_gym.numerics import Bools, Floats, Indices, Pose, Singles, arrays
from deqmcl_gym.validation import InputError, array, integer, number, one_of, real

_NAMES = ("angles", "mounting", "turn", "mounts", "max_range", "min_range", "sigma")


@final
@dataclass(frozen=True, kw_only=True)
class Scanner(Lidar):
    """A lidar with beams at any angles, and the meaning of its ranges, in the log's unit.

    A range is a measurement if min_range < range < max_range, as in ROS' ``LaserScan`` and Nav2's
    AMCL. At or beyond max_range nothing is within reach: +inf. All else, at or below min_range or
    not a number, is no reading: NaN. Angles include the turn of the mounting and of the mounts;
    they count counterclockwise, in the order of the ranges.
    """

    beams: int = field(init=False)
    field_of_view: float = field(init=False)
    max_range: float = bounded(kind=LENGTH, low=0, above=True)
    sigma: float = bounded(0.0, LENGTH, low=0)
    angles: tuple[float, ...] = field(repr=False)  #: against the robot's heading, (beams,) rad
    turn: float = 0.0  #: of the mounting, rad

    def __post_init__(self) -> None:
        angles = array("scanner.angles", self.angles, (None,)).tolist()
        if not angles:
            raise InputError("scanner.angles is empty, but a scanner needs 1 beam or more.")
        object.__setattr__(self, "angles", tuple(angles))
        object.__setattr__(self, "beams", len(angles))
        object.__setattr__(self, "field_of_view", 2 * math.pi)
        super().__post_init__()
        span = max(max(angles[rows]) - min(angles[rows]) for rows in self.rows)
        if span > 2 * math.pi + 1e-5:  # rad: float32 angles of a LaserScan are no better
            raise InputError(
                f"scanner.angles span {span:.4g} rad, but must span at most 2π: are they degrees?"
            )
        object.__setattr__(self, "field_of_view", min(span or 2 * math.pi, 2 * math.pi))
        number("the turn of mounting, in rad,", self.turn, low=-2 * math.pi, high=2 * math.pi)
        number("scanner.min_range", self.min_range, low=0, high=self.max_range)

    @classmethod
    def of_json(cls, what: str, text: str) -> "Scanner":
        """Return the scanner that :attr:`json` describes; ``what`` names the text in messages."""
        try:
            values = json.loads(text)
        except (ValueError, RecursionError):
            values = None
        if not isinstance(values, dict) or not {"angles", "max_range"} <= values.keys():
            raise InputError(
                f"{what} is not a JSON object with a scanner's angles and max_range: give "
                '{"angles": [rad, …], "max_range": …}.'
            )
        for name in values:
            one_of(f"name in {what}", name, _NAMES)
        return cls(**values)

    @property
    def json(self) -> str:
        """This scanner as JSON without blanks."""
        # "turn" and "mounts" only if there are any: as logs were before them
        names = (name for name in _NAMES if name not in ("turn", "mounts") or getattr(self, name))
        values = {name: getattr(self, name) for name in names}
        return json.dumps(values, separators=(",", ":"), default=asdict)

    @property
    def bearings(self) -> Floats:
        """Angles of the beams against the robot's heading, (beams,) rad."""
        return np.array(self.angles)

    def measured(self, ranges: ArrayLike) -> Singles:
        """Return ranges (..., beams) as float32, +inf or NaN where they are no measurements."""
        values = real("ranges", ranges)
        with np.errstate(over="ignore", invalid="ignore"):
            values = np.array(values, dtype=np.float32)
        self.lose(values, blind=np.nan)
        return values

    @cached_property
    def loses(self) -> bool:
        """True: any range may be no measurement."""
        return True

    def lose(self, ranges: NDArray[Any], blind: float = math.inf) -> None:
        """Overwrite readings (..., beams) that are no measurements by +inf and NaN, in place."""
        ranges[..., self.blind] = blind
        mark_unmeasured(ranges, self.min_range, self.max_range)

    def thinned(self, max_beams: int) -> tuple["Scanner", Sequence[int]]:
        """Return the scanner with at most ``max_beams`` beams, spread evenly, and their indices.

        The first and the last beam are kept; a single beam is the middle one.
        """
        integer("max_beams", max_beams, low=1)
        if max_beams >= self.beams:
            return self, range(self.beams)
        ends = (0.0, self.beams - 1.0) if max_beams > 1 else ((self.beams - 1) / 2,) * 2
        beams = np.rint(np.linspace(*ends, max_beams)).astype(int).tolist()
        angles = tuple(self.angles[i] for i in beams)
        left = [sum(rows.start <= i < rows.stop for i in beams) for rows in self.rows]
        pairs = zip(self.mounts, left, strict=False)
        mounts = tuple(replace(mount, beams=n) for mount, n in pairs if n)
        return replace(self, angles=angles, mounts=mounts), beams


def ascending_times(source: str, what: str, given: ArrayLike) -> Floats:
    """Return times, s, which must be in order and not none; ``what`` has each of them."""
    times = array(f"times of {source}", given, (None,))
    if not times.size:
        raise InputError(f"{source} has no {what}.")
    if (back := np.diff(times) < 0).any():
        raise InputError(
            f"times of {source} run backwards after {times[back.argmax()]:.6f} s: give {what}s in "
            "the order of their times."
        )
    return times


@dataclass(frozen=True)
class Record:
    """One record of a log."""

    time: float  #: s
    odometry: Pose  #: pose in its drifting frame
    ranges: Singles  #: (beams,); +inf where nothing is within reach, NaN where a beam failed
    reference: Pose | None  #: best estimate of the true pose in the map; None if unknown


@final
@dataclass(frozen=True, eq=False)
class Log:
    """Records in the order of their times. Arrays are read-only, headings in [-π, π]."""

    scanner: Scanner
    times: Floats  #: s, (n,), not decreasing
    odometry: Floats  #: poses by odometry, (n, 3)
    ranges: Singles = field(repr=False)  #: (n, beams); +inf: nothing in reach, NaN: failed
    reference: Floats | None = None  #: in the map, (n, 3), NaN in rows without one
    unit: str = "m"  #: of lengths
    skipped: Mapping[str, int] = field(default_factory=dict)  #: records left out, by reason
    source: str = "the log"  #: in messages
    interpolated: Bools | None = field(default=None, repr=False)  #: given by two others, (n,)

    def __post_init__(self) -> None:
        one_of("unit of length", self.unit, PIXELS)
        times = ascending_times(self.source, "record", self.times)
        n, beams = times.size, self.scanner.beams
        odometry = array(f"odometry of {self.source}", self.odometry, (n, 3))
        if (shape := np.shape(self.ranges)) != (n, beams):
            raise InputError(
                f"ranges of {self.source} have shape {shape}, but must be {(n, beams)}: a row for "
                "each time, a column for each beam of the scanner."
            )
        ranges = self.scanner.measured(self.ranges)
        columns: dict[str, NDArray[Any]] = {"times": times, "odometry": odometry, "ranges": ranges}
        if self.reference is not None:
            given = real(f"the reference of {self.source}", self.reference)
            reference = np.array(given, dtype=np.float64)
            if reference.shape != (n, 3):
                raise InputError(
                    f"the reference of {self.source} has shape {reference.shape}, but must be "
                    f"{(n, 3)}: a pose for each record, NaN for none."
                )
            reference[~np.isfinite(reference).all(axis=1)] = np.nan
            columns["reference"] = reference
            reference[:, 2] = arrays.wrapped(reference[:, 2])
        odometry[:, 2] = arrays.wrapped(odometry[:, 2])
        for name, values in columns.items():
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    @classmethod
    def of_episode(
        cls,
        scans: ArrayLike,
        actions: ArrayLike,
        truth: ArrayLike | None,
        lidar: Lidar,
        *,
        unit: str,
        step: float = 1.0,
    ) -> "Log":
        """Return the log of a simulated episode; its odometry is dead reckoning of the commands.

        Scans are those at reset and after each step of ``step`` s, (T + 1, beams), actions
        ``info["command"]`` of each, (d, φ) or (forward, left, turn), (T, 2 or 3), ``truth`` the
        true poses, (T + 1, 3).
        """
        odometry = dead_reckoned(actions)
        if not isinstance(lidar, Scanner):
            mounts = zip(lidar.mounts, lidar.rows, strict=False)
            lidar = Scanner(
                angles=tuple(lidar.bearings),
                max_range=float(lidar.max_range),
                sigma=lidar.sigma,
                mounting=lidar.mounting,
                mounts=tuple(replace(each, beams=r.stop - r.start) for each, r in mounts),
                min_range=lidar.min_range,
            )
        times = np.round(np.arange(len(odometry)) * step, 9)
        reference = None if truth is None else np.asarray(truth, dtype=np.float64)
        return cls(lidar, times, odometry, np.asarray(scans), reference, unit, source="episode")

    def __len__(self) -> int:
        """Return the number of records."""
        return len(self.times)

    def __getitem__(self, index: int) -> Record:
        """Return one record; -1 is the last."""
        x, y, heading = self.odometry[index].tolist()
        at: Pose | None = None
        if self.reference is not None and np.isfinite(self.reference[index, 0]):
            at = tuple(self.reference[index].tolist())
        return Record(float(self.times[index]), (x, y, heading), self.ranges[index], at)

    def __iter__(self) -> Iterator[Record]:
        return (self[index] for index in range(len(self)))

    def __str__(self) -> str:
        """Return a summary of a few lines."""
        seconds, unit = self.times[-1] - self.times[0], self.unit
        degrees = np.degrees(self.scanner.bearings[[0, -1]])
        aside = np.abs(self.residuals).sum()
        lines = [
            f"{self.source}: {len(self):,} records, {seconds:,.1f} s, {self.driven[-1]:,.1f} "
            f"{unit} by odometry, {aside:,.1f} {unit} of it sideways",
            f"scanner: {self.scanner.beams} beams from {degrees[0]:.4g}° to {degrees[1]:.4g}°, up "
            f"to {self.scanner.max_range:g} {self.unit}, {np.mean(~np.isfinite(self.ranges)):.1%} "
            "of the ranges without a return",
        ]
        if self.reference is not None:
            count, between = self.referenced.size, self.referenced.size - self.posed.size
            more = f", {between:,} of them interpolated" if between else ""
            lines.append(f"reference: at {count:,} of {len(self):,} records{more}")
        if self.skipped:
            lines.append(said_of_skipped(self.skipped, len(self)))
        return "\n".join(lines)

    @cached_property
    def increments(self) -> Floats:
        """The odometry's increments (forward, left, turn), (n - 1, 3); see ``logs.motion``."""
        return increments_of(self.odometry)

    @cached_property
    def residuals(self) -> Floats:
        """Component of each increment to the left of the mean heading, (n - 1,): 0 on an arc.

        What a robot with two driven wheels cannot do. Large ones are those of a robot that moves
        sideways, of wheels that slip, or of poses that are not of the robot's base.
        """
        return sideways_of(self.increments)

    @cached_property
    def referenced(self) -> Indices:
        """Indices of the records with a reference pose, ascending."""
        if self.reference is None:
            return np.empty(0, np.intp)
        return np.flatnonzero(np.isfinite(self.reference[:, 0]))

    @property
    def posed(self) -> Indices:
        """Indices of the records with a reference pose of their own time, none interpolated."""
        at = self.referenced
        return at if self.interpolated is None else at[~self.interpolated[at]]

    def segment(self, start: int = 0, length: int | None = None) -> "Log":
        """Return ``length`` records from index ``start`` on; None is all that follow."""
        first = integer("start", start, low=0, high=len(self) - 1)
        most = len(self) - first
        count = most if length is None else integer("length", length, low=1, high=most)
        return self.of_records(slice(first, first + count))

    def spaced(self, distance: float, angle: float) -> "Log":
        """Return the records at least ``distance`` or ``angle`` rad from the last one kept.

        Like AMCL's update_min_d and update_min_a: a record is kept when either is reached. The
        first record is always kept. Distances are by odometry.
        """
        far = number("the distance of every", distance, low=0, finite=False)
        turned = number("the angle of every", angle, low=0, finite=False)
        poses, indices = self.odometry.tolist(), [0]
        for index, pose in enumerate(poses[1:], 1):
            if has_moved(poses[indices[-1]], pose, far, turned):
                indices.append(index)
        return self.of_records(np.array(indices))

    def with_beams(self, max_beams: int) -> "Log":
        """Return the log with at most ``max_beams`` beams, spread evenly over the scanner's."""
        scanner, beams = self.scanner.thinned(max_beams)
        return replace(self, scanner=scanner, ranges=self.ranges[:, beams])

    def of_records(self, chosen: slice | Indices) -> "Log":
        """Return the log of the chosen records, in order."""
        return replace(
            self,
            times=self.times[chosen],
            odometry=self.odometry[chosen],
            ranges=self.ranges[chosen],
            reference=None if self.reference is None else self.reference[chosen],
            interpolated=None if self.interpolated is None else self.interpolated[chosen],
        )

    @cached_property
    def way(self) -> Floats:
        """Distance driven up to each record by odometry, plus 1 m for each radian turned, (n,)."""
        per_turn = 1 / PIXELS["m"] * PIXELS[self.unit]
        turned = np.abs(arrays.wrapped(np.diff(self.odometry[:, 2])))
        return np.append(0.0, np.cumsum(lengths_of(self.increments) + per_turn * turned))

    @cached_property
    def driven(self) -> Floats:
        """Distance driven up to each record, by odometry, (n,)."""
        return np.append(0.0, np.cumsum(lengths_of(self.increments)))


def said_of_skipped(skipped: Mapping[str, int], kept: int) -> str:
    """Return the sentence on records left out, by reason, the most frequent first."""
    total, reasons = sum(skipped.values()), sorted(skipped.items(), key=lambda item: -item[1])
    listed = ", ".join(f"{count:,} {reason}" for reason, count in reasons)
    return f"skipped {total:,} of {total + kept:,} records: {listed}"
