"""Records as they stand in a file, made into a log: damaged ones are skipped and counted."""

import bisect
import warnings
from collections import Counter
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from deqmcl_gym.logs.log import Log, Scanner, said_of_skipped
from deqmcl_gym.numerics.types import Bools, Floats, Indices
from deqmcl_gym.validation import LARGEST, InputError, LogWarning

UNREADABLE = "unreadable"
OTHER_SCAN = "with a scan of another length, geometry or frame"
NOT_FINITE = f"with a time or pose that is not finite or beyond {LARGEST:g}"
BACKWARDS = "whose time runs backwards"
NO_ODOMETRY = "without odometry at that time"
_FEW = 0.5  # share of records with a reference pose below which a warning is given


@dataclass
class RawRecords:
    """All records of a file, sound or damaged.

    Attributes:
        source: name of the file in messages.
        times, odometry, ranges: of each record.
        geometry: number of beams and anything else that identifies the scanner, of each record.
        references: true poses in the records themselves; () for none.
        damage: number of records that could not be read, by reason.
    """

    source: str
    times: list[float] = field(default_factory=list)
    odometry: list[Sequence[float]] = field(default_factory=list)
    ranges: list[Sequence[float]] = field(default_factory=list)
    geometry: list[tuple[int, Any]] = field(default_factory=list)
    references: list[Sequence[float]] = field(default_factory=list)
    damage: Counter[str] = field(default_factory=Counter)

    def add(
        self,
        time: float,
        odometry: Sequence[float],
        ranges: Sequence[float],
        geometry: Hashable = None,
        reference: Sequence[float] = (),
    ) -> None:
        """Add a record."""
        self.times.append(time)
        self.odometry.append(odometry)
        self.ranges.append(ranges)
        self.geometry.append((len(ranges), geometry))
        self.references.append(reference)

    def kept(self, chosen: Sequence[int]) -> "RawRecords":
        """Return the records of these indices, in order; all damage counts."""
        return replace(
            self,
            times=[self.times[i] for i in chosen],
            odometry=[self.odometry[i] for i in chosen],
            ranges=[self.ranges[i] for i in chosen],
            geometry=[self.geometry[i] for i in chosen],
            references=[self.references[i] for i in chosen],
        )

    def log(self, scanner_of: Callable[[int, Any], Scanner], *, unit: str = "m") -> Log:
        """Return the sound records as a log; warn of the others.

        The scanner is that of most records, made by ``scanner_of(beams, geometry)``.

        Raises:
            InputError: no record is sound.
        """
        kept = np.arange(len(self.times))
        if kept.size:
            times, odometry = np.array(self.times), np.array(self.odometry).reshape(-1, 3)
            (most, _), *_ = Counter(self.geometry).most_common(1)
            same = np.array([geometry == most for geometry in self.geometry])
            kept = self._without(kept, same, OTHER_SCAN)
            sound = usable(np.column_stack([times, odometry]))
            kept = self._without(kept, sound[kept], NOT_FINITE)
            kept = kept[in_order(times[kept], self.damage)]
        if not kept.size:
            why = f" ({said_of_skipped(self.damage, 0)})" if self.damage else ""
            raise InputError(f"{self.source} has no usable record{why}.")
        if self.damage:
            said = said_of_skipped(self.damage, kept.size)
            warnings.warn(f"{self.source}: {said}.", LogWarning, stacklevel=2)
        ranges = np.array([self.ranges[index] for index in kept])
        try:
            scanner = scanner_of(*most)
        except InputError as error:
            raise InputError(f"{self.source}: {error}") from None
        log = Log(
            scanner, times[kept], odometry[kept], ranges, self._reference(kept), unit,
            skipped=dict(self.damage), source=self.source,
        )  # fmt: skip
        warn_of_few(log, self.source)
        return log

    def _reference(self, kept: Indices) -> Floats | None:
        """Return the true poses of the records kept, (n, 3); NaN where none is sound."""
        if not any(map(len, self.references)):
            return None
        given = [self.references[index] or (np.nan,) * 3 for index in kept]
        poses = np.array(given, dtype=np.float64).reshape(-1, 3)
        poses[~usable(poses)] = np.nan
        known = int(np.isfinite(poses[:, 0]).sum())
        if bad := sum(len(self.references[index]) > 0 for index in kept) - known:
            said = f"{bad:,} reference poses left out: not finite or beyond {LARGEST:g}"
            warnings.warn(f"{self.source}: {said}.", LogWarning, stacklevel=3)
        return poses if known else None

    def _without(self, kept: Indices, sound: Bools, reason: str) -> Indices:
        if lost := int((~sound).sum()):
            self.damage[reason] += lost
        left: Indices = kept[sound]
        return left


def warn_of_few(log: Log, reference: str) -> None:
    """Warn if a log has a reference at few of its records."""
    if log.reference is not None and log.referenced.size < _FEW * len(log):
        warnings.warn(
            f"the reference {reference} has a pose for only {log.referenced.size:,} of "
            f"{len(log):,} records of {log.source}.",
            LogWarning,
            stacklevel=3,
        )


def usable(rows: Floats) -> Bools:
    """Whether all numbers of rows (n, k) are finite and at most ``LARGEST``, (n,)."""
    return np.asarray((np.abs(rows) <= LARGEST).all(axis=1))  # False for NaN, too


def in_order(times: Floats, damage: Counter[str]) -> Indices:
    """Return the indices of the longest subsequence of times without decrease; count the others.

    So one time stamp far ahead costs one record, not all records after it.
    """
    if not (np.diff(times) < 0).any():
        return np.arange(times.size)
    ends: list[float] = []  # least last time of a subsequence of each length
    at: list[int] = []  # index of that time
    before = np.full(times.size, -1)
    for index, time in enumerate(times.tolist()):
        length = bisect.bisect_right(ends, time)
        before[index] = at[length - 1] if length else -1
        if length == len(ends):
            ends.append(time)
            at.append(index)
        else:
            ends[length], at[length] = time, index
    chain = [at[-1]]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    damage[BACKWARDS] += times.size - len(chain)
    return np.array(chain[::-1])
