"""Records as they stand in a file, made into a log: damaged ones are skipped and counted.

Scans of several lidars, each with stamps and a rate of its own, are paired as records of one log.
"""

import bisect
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from deqmcl_gym.logs import odometry, scans
from deqmcl_gym.logs.log import Log, Scanner, said_of_skipped
from deqmcl_gym.logs.motion import composed, nearest_in_time, relative
from deqmcl_gym.numerics import Bools, Floats, Indices, Singles, arrays
from deqmcl_gym.validation import LARGEST, InputError, tell

UNREADABLE = "unreadable"
NOT_FINITE = f"with a time or pose that is not finite or beyond {LARGEST:g}"
_EPOCH = 1e6  # s: where most stamps are larger, one of 0 is none
_FEW = 0.5  # share of records with a reference pose below which a warning is given


class RawRecord(NamedTuple):
    """A record as it stands in a file, sound or damaged."""

    time: float
    odometry: Sequence[float]
    ranges: Sequence[float]
    fan: scans.Fan | None = None
    frame: str = ""  # of the scan, "" for none
    reference: Sequence[float] = ()
    number: int = 0  # of its message, as those of the odometry are counted


@dataclass
class RawRecords:
    """All records of a file."""

    source: str  # name of the file in messages
    records: list[RawRecord] = field(default_factory=list)
    damage: Counter[str] = field(default_factory=Counter)
    judged: bool = False  # whether odometry and clock have been judged already

    @property
    def times(self) -> list[float]:
        """The time of each record, s."""
        return [record.time for record in self.records]

    def with_odometry(self, moved: odometry.JudgedOdometry) -> "RawRecords":
        """Return the records with the odometry at their times, of those that have one."""
        records, last = [], None
        for record in self.records:
            placed = moved.at(record.number, record.time)
            if placed is None:
                self.damage["without odometry at that time"] += 1
            elif record.time == last:
                self.damage["doubled"] += 1
            else:
                time, pose = placed
                records.append(record._replace(time=time, odometry=pose))
            last = record.time
        return replace(self, records=records, judged=True)

    def log(
        self, scanner_of: Callable[[int, str, scans.Fan | None], Scanner], *, unit: str = "m"
    ) -> Log:
        """Return the sound records as a log; warn of the others, and of all that is not as usual.

        The scanner has the usual beams and limits of the scans, and is made by
        ``scanner_of(beams, frame, fan)``; scans with other angles are resampled.
        """
        records, frame, resets = self.records, "", 0
        if records:
            ((frame, _),) = Counter(record.frame for record in records).most_common(1)
        for reason, passes in (
            ("with a scan of another frame", lambda r: r.frame == frame),
            (
                "with a scan whose angles are not finite",
                lambda r: r.fan is None or np.isfinite(r.fan[:2]).all(),
            ),
            (NOT_FINITE, lambda r: all(abs(number) <= LARGEST for number in (r.time, *r.odometry))),
        ):
            left = [record for record in records if passes(record)]
            self.damage += Counter({reason: len(records) - len(left)})  # none if there are none
            records = left
        times = np.array([record.time for record in records])
        if not self.judged:
            shifts = odometry.clock_shifts(times)
            times, resets = times + shifts, int(np.count_nonzero(np.diff(shifts)))
        order = ascending(times, self.damage)
        if not order.size:
            why = f" ({said_of_skipped(self.damage, 0)})" if self.damage else ""
            raise InputError(f"{self.source} has no usable record{why}.")
        times, records = times[order], [records[index] for index in order]
        poses = np.array([record.odometry for record in records], dtype=np.float64)
        remarks = [said_of_skipped(self.damage, order.size)] if self.damage else []
        if not self.judged:
            poses, jumps = odometry.without_jumps(times, poses, unit)
            remarks += odometry.remarks_of(resets, jumps)
        fans = [record.fan for record in records if record.fan is not None]
        rows = [record.ranges for record in records]
        varying: str | None = None
        try:
            if fans:
                beams, usual = scans.usual_fan(list(map(len, rows)), fans)
                scanner = scanner_of(beams, frame, usual)
                most = scanner.max_range
                ranges, varying = scans.at_usual_bearings(rows, fans, beams, usual, most)
            else:
                scanner = scanner_of(len(rows[0]), frame, None)
                ranges = scanner.measured(np.array(rows))
        except InputError as error:
            self._tell(remarks)
            raise InputError(f"{self.source}: {error}") from None
        large, small = scans.no_return_codes(ranges)
        for code in (*large, *small):
            share = np.mean(ranges == np.float32(code))
            remarks.append(
                f"{share:.1%} of the ranges read exactly {np.float32(code)}, the "
                f"{'largest' if code in large else 'smallest'} of many: taken as no return"
            )
        limits = max([scanner.min_range, *small]), min([scanner.max_range, *large])
        scanner = replace(scanner, min_range=limits[0], max_range=limits[1])
        ranges = scanner.measured(ranges) if large or small else ranges
        self._tell([*remarks, varying, scans.dropped_words(ranges, limits, unit)])
        log = Log(
            scanner, times, poses, ranges, self._reference(records), unit,
            skipped=dict(self.damage), source=self.source,
        )  # fmt: skip
        warn_of_few(log, self.source)
        return log

    def _tell(self, remarks: Sequence[str | None]) -> None:
        for remark in filter(None, remarks):
            tell(f"{self.source}: {remark}.")

    def _reference(self, records: Sequence[RawRecord]) -> Floats | None:
        """Return the true poses of records, (n, 3); NaN where none is sound."""
        references = sum(len(record.reference) > 0 for record in records)
        poses = np.array([record.reference or (np.nan,) * 3 for record in records], np.float64)
        poses[~usable(poses)] = np.nan
        sound = int(np.isfinite(poses[:, 0]).sum())
        if bad := references - sound:
            self._tell([f"{bad:,} reference poses left out: not finite or beyond {LARGEST:g}"])
        return poses if sound else None


def warn_of_few(log: Log, reference: str) -> None:
    """Warn if a log has a reference at few of its records."""
    if log.reference is not None and log.referenced.size < _FEW * len(log):
        tell(
            f"the reference {reference} has a pose for only {log.referenced.size:,} of "
            f"{len(log):,} records of {log.source}."
        )


def stamped(rows: Floats) -> Floats:
    """Return rows t, … (n, k), NaN for a time of 0 before the clock was known."""
    unknown = (rows[:, 0] == 0) & (len(rows) > 0 and bool(np.median(rows[:, 0]) > _EPOCH))
    return np.where(unknown[:, None], np.nan, rows)


def usable(rows: Floats) -> Bools:
    """Whether all numbers of rows (n, k) are finite and at most ``LARGEST``, (n,)."""
    return np.asarray((np.abs(rows) <= LARGEST).all(axis=1))  # False for NaN, too


def ascending(times: Floats, damage: Counter[str]) -> Indices:
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
    damage["whose time runs backwards"] += times.size - len(chain)
    return np.array(chain[::-1])


def paired_scans(scanned: Mapping[str, Log], source: str, max_apart: float) -> Log:
    """Return one log of several lidars on one robot, by topic; a record has a scan of each.

    Records are those of the lidar with the fewest scans. Of each other lidar a record gets the scan
    nearest in time, at most ``max_apart`` s off, moved by the odometry between the two stamps. No
    scan is in two records. Records without such a scan are left out and counted.
    """
    slowest = min(scanned, key=lambda topic: len(scanned[topic]))
    base, unpaired = scanned[slowest], Counter[str]()
    partner = {topic: _partners(base, log, max_apart) for topic, log in scanned.items()}
    for topic, rows in partner.items():
        reason = f"without a scan of {topic} within {max_apart:g} s"
        unpaired += Counter({reason: int((rows < 0).sum())})
    whole = np.all([rows >= 0 for rows in partner.values()], axis=0)
    if not whole.any():
        raise InputError(
            f"{source} has no scans of {' and '.join(scanned)} within {max_apart:g} s of one "
            "another: give a larger max_apart, or one topic, and compare the clocks of the lidars."
        )
    paired = base.of_records(np.flatnonzero(whole))
    ranges = [
        log.ranges[rows[whole]] if log is base else _moved(log, rows[whole], paired.odometry)
        for log, rows in zip(scanned.values(), partner.values(), strict=True)
    ]
    if unpaired:
        tell(f"{source}: {said_of_skipped(unpaired, len(paired))}.")
    for topic, log in scanned.items():
        if topic != slowest and (unused := len(log) - len(paired)):
            tell(
                f"{source}: {unused:,} of {len(log):,} scans of {topic} are in no record: "
                f"records are those of {slowest}, which has the fewest scans."
            )
    scanners = [log.scanner for log in scanned.values()]
    joined = Scanner(  # ranges are within those of each already
        angles=tuple(angle for scanner in scanners for angle in scanner.angles),
        mounts=tuple(mount for scanner in scanners for mount in scanner.mounts),
        min_range=min(scanner.min_range for scanner in scanners),
        max_range=max(scanner.max_range for scanner in scanners),
    )
    return replace(
        paired, scanner=joined, ranges=np.concatenate(ranges, axis=1), source=source,
        skipped=dict(Counter(base.skipped) + unpaired),
    )  # fmt: skip


def _partners(base: Log, other: Log, max_apart: float) -> Indices:
    """Return for each record of ``base`` the scan nearest in time, its own alone; -1 for none."""
    if other is base:
        return np.arange(len(base))
    nearest, least = nearest_in_time(other.times, base.times)
    nearest[least > max_apart + 1e-9] = -1
    # of two records with one scan the nearer has it
    order = np.argsort(least, kind="stable")
    _, first = np.unique(nearest[order], return_index=True)
    nearest[np.setdiff1d(order, order[first])] = -1
    return nearest


def _moved(log: Log, chosen: Indices, poses: Floats) -> Singles:
    """Return scans as the lidar would have taken them from other poses (n, 3) of the odometry."""
    # a return is a point, seen by the beam nearest in angle; of several the nearest counts
    scanner, ranges = log.scanner, log.ranges[chosen]
    moves = relative(poses, log.odometry[chosen])
    driven = np.flatnonzero((moves != 0).any(axis=1))
    bearings, ((ahead, left),) = scanner.bearings, scanner.places
    first = bearings[0]
    step = (bearings[-1] - first) / (scanner.beams - 1) if scanner.beams > 1 else 2 * math.pi
    row, beam = np.nonzero(np.isfinite(ranges[driven]))
    far = ranges[driven[row], beam].astype(np.float64)
    x, y = ahead + far * arrays.cos(bearings[beam]), left + far * arrays.sin(bearings[beam])
    points = composed(moves[driven[row]], np.column_stack([x, y, np.zeros(x.size)]))
    x, y = points[:, 0] - ahead, points[:, 1] - left
    angle = np.asarray(arrays.arctan2(y, x)) - first
    seen = np.floor(np.mod(angle / step + 0.5, 2 * math.pi / abs(step))).astype(int)
    inside = seen < scanner.beams
    out = np.full((len(driven), scanner.beams), np.inf, np.float32)
    distances = np.sqrt(x * x + y * y).astype(np.float32)
    np.minimum.at(out, (row[inside], seen[inside]), distances[inside])
    ranges[driven] = scanner.measured(out)
    return ranges
