"""Log: what a robot recorded, record by record."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.logs.motion import actions_of, composed, dead_reckoned
from deqmcl_gym.logs.scanner import Scanner
from deqmcl_gym.maps import Lidar
from deqmcl_gym.maps.units import PIXELS
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Indices, Singles
from deqmcl_gym.validation import InputError, array, integer, number, one_of

Pose = tuple[float, float, float]


@dataclass(frozen=True)
class Record:
    """What was recorded at one time.

    Attributes:
        time: s.
        odometry: the pose by odometry (x, y, θ), in a frame of its own that drifts.
        ranges: the scan, (beams,); +inf where nothing was measured.
        reference: the true pose (x, y, θ) in the map, as far as anyone knows; None if nobody does.
    """

    time: float
    odometry: Pose
    ranges: Singles
    reference: Pose | None


@final
@dataclass(frozen=True, eq=False)
class Log:
    """Records in the order of their times. Its arrays are read-only, headings in [-π, π].

    Attributes:
        scanner: what took the scans.
        times: s, (n,), none before the last.
        odometry: poses (x, y, θ) of the robot by odometry, (n, 3).
        ranges: (n, beams) float32; +inf where nothing was measured.
        reference: poses in the map, (n, 3), rows of NaN where there is none; None: no reference.
        unit: of all lengths, "m" or "px".
        skipped: how many records were left out when it was read, by reason.
        source: what it was read from.
    """

    scanner: Scanner
    times: Floats
    odometry: Floats
    ranges: Singles = field(repr=False)
    reference: Floats | None = None
    unit: str = "m"
    skipped: Mapping[str, int] = field(default_factory=dict)
    source: str = "the log"

    def __post_init__(self) -> None:
        one_of("unit of length", self.unit, PIXELS)
        times = array(f"times of {self.source}", self.times, (None,))
        n, beams = times.size, self.scanner.beams
        if n == 0:
            raise InputError(f"{self.source} has no record.")
        if (back := np.diff(times) < 0).any():
            raise InputError(
                f"times of {self.source} run backwards after {times[back.argmax()]:.6f} s: give "
                "records in the order of their times."
            )
        odometry = array(f"odometry of {self.source}", self.odometry, (n, 3))
        ranges = self.scanner.measured(self.ranges)
        if ranges.shape != (n, beams):
            raise InputError(
                f"ranges of {self.source} have shape {ranges.shape}, but must be {(n, beams)}: a "
                "row for each time, a column for each beam of the scanner."
            )
        kept: dict[str, NDArray[Any]] = {"times": times, "odometry": odometry, "ranges": ranges}
        if self.reference is not None:
            reference = np.array(self.reference, dtype=np.float64)
            if reference.shape != (n, 3):
                raise InputError(
                    f"the reference of {self.source} has shape {reference.shape}, but must be "
                    f"{(n, 3)}: a pose for each record, NaN for none."
                )
            reference[~np.isfinite(reference).all(axis=1)] = np.nan
            kept["reference"] = reference
            known = np.isfinite(reference[:, 0])
            reference[known, 2] = arrays.wrapped(reference[known, 2])
        odometry[:, 2] = arrays.wrapped(odometry[:, 2])
        for name, values in kept.items():
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
        """Return the log of an episode of a simulated robot; its odometry is what it was told.

        Args:
            scans: at reset and after each step, (T + 1, beams).
            actions: ``info["action"]`` of each step (d, φ), (T, 2).
            truth: the true poses, (T + 1, 3); None if they are not to be recorded.
            lidar: which took the scans.
            unit: of all lengths.
            step: how long a step takes, s.
        """
        odometry = dead_reckoned(actions)
        scanner = lidar if isinstance(lidar, Scanner) else Scanner.of_lidar(lidar)
        times = np.round(np.arange(len(odometry)) * step, 9)
        reference = None if truth is None else np.asarray(truth, dtype=np.float64)
        return cls(scanner, times, odometry, np.asarray(scans), reference, unit, source="episode")

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
        """Return what one wants to know of a log first, on a few lines."""
        seconds, driven = self.times[-1] - self.times[0], np.abs(self.actions[:, 0]).sum()
        degrees = np.degrees(self.scanner.bearings[[0, -1]])
        lines = [
            f"{self.source}: {len(self):,} records, {seconds:,.1f} s, {driven:,.1f} {self.unit} "
            "by odometry",
            f"scanner: {self.scanner.beams} beams from {degrees[0]:.4g}° to {degrees[1]:.4g}°, up "
            f"to {self.scanner.max_range:g} {self.unit}, {np.isinf(self.ranges).mean():.1%} of "
            "the ranges without a return",
        ]
        if self.reference is not None:
            lines.append(f"reference: at {self.referenced.size:,} of {len(self):,} records")
        if self.skipped:
            lines.append(said_of_skipped(self.skipped, len(self)))
        return "\n".join(lines)

    @cached_property
    def actions(self) -> Floats:
        """The odometry's increments as actions (d, φ), (n - 1, 2); see ``logs.motion``."""
        return actions_of(self.odometry)[0]

    @cached_property
    def residuals(self) -> Floats:
        """What each action leaves out, to the left of the new heading, (n - 1,)."""
        return actions_of(self.odometry)[1]

    @cached_property
    def referenced(self) -> Indices:
        """The records that have a reference pose, in order."""
        if self.reference is None:
            return np.empty(0, np.intp)
        return np.flatnonzero(np.isfinite(self.reference[:, 0]))

    def segment(self, start: int = 0, length: int | None = None) -> "Log":
        """Return ``length`` records from the ``start``-th on; None is all the rest."""
        first = integer("start", start, low=0, high=len(self) - 1)
        most = len(self) - first
        count = most if length is None else integer("length", length, low=1, high=most)
        return self.of_records(slice(first, first + count))

    def spaced(self, distance: float, angle: float) -> "Log":
        """Return the records that lie apart: by ``distance`` or by ``angle`` rad from the last one.

        As AMCL's update_min_d and update_min_a: it takes a scan when either is reached. The first
        record stays. The distance is that of the odometry.
        """
        far = number("the distance of every", distance, low=0, finite=False)
        turned = number("the angle of every", angle, low=0, finite=False)
        kept, (x, y, heading) = [0], self.odometry[0].tolist()
        for index, pose in enumerate(self.odometry.tolist()):
            turn = abs(math.remainder(pose[2] - heading, 2 * math.pi))
            if index and (math.hypot(pose[0] - x, pose[1] - y) >= far or turn >= turned):
                kept.append(index)
                x, y, heading = pose
        return self.of_records(np.array(kept))

    def with_beams(self, max_beams: int) -> "Log":
        """Return the log with at most so many beams, spread evenly over those of the scanner."""
        scanner, kept = self.scanner.thinned(max_beams)
        return replace(self, scanner=scanner, ranges=self.ranges[:, kept])

    def at_scanner(self) -> "Log":
        """Return the log of the scanner's place instead of the robot's centre; headings stay.

        For localizers, which see from where they are. The place of a scanner that is not mounted in
        the centre moves sideways when the robot turns: see ``residuals``.
        """
        if self.scanner.mounting == (0.0, 0.0):
            return self
        offset = np.array([*self.scanner.mounting, 0.0])
        reference = self.reference
        if reference is not None:
            known = np.isfinite(reference[:, 0])
            moved = np.full_like(reference, np.nan)
            moved[known] = composed(reference[known], offset)
            reference = moved
        return replace(
            self,
            scanner=replace(self.scanner, mounting=(0.0, 0.0)),
            odometry=composed(self.odometry, offset),
            reference=reference,
        )

    def of_records(self, chosen: slice | Indices) -> "Log":
        """Return the log of some records, in order."""
        return replace(
            self,
            times=self.times[chosen],
            odometry=self.odometry[chosen],
            ranges=self.ranges[chosen],
            reference=None if self.reference is None else self.reference[chosen],
        )

    @cached_property
    def way(self) -> Floats:
        """How far the robot has come at each record, a radian turned as 1 m, (n,)."""
        per_turn = 1 / PIXELS["m"] * PIXELS[self.unit]
        turned = np.abs(arrays.wrapped(np.diff(self.odometry[:, 2])))
        return _sums(self._steps + per_turn * turned)

    @cached_property
    def driven(self) -> Floats:
        """How far the robot has driven at each record, by odometry, (n,)."""
        return _sums(self._steps)

    @cached_property
    def _steps(self) -> Floats:
        """Straight distance from each record to the next, (n - 1,)."""
        across, up = np.diff(self.odometry[:, :2], axis=0).T
        return np.asarray(np.hypot(across, up))


def _sums(steps: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(steps)])


def said_of_skipped(skipped: Mapping[str, int], kept: int) -> str:
    """Return the sentence that says what was left out, most first."""
    total = sum(skipped.values())
    reasons = ", ".join(
        f"{count:,} {reason}" for reason, count in sorted(skipped.items(), key=lambda one: -one[1])
    )
    return f"skipped {total:,} of {total + kept:,} records: {reasons}"
