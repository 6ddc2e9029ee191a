"""Scans of several lidars, each with stamps and a rate of its own, paired as records of one log."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from deqmcl_gym.logs.log import Log, Scanner, said_of_skipped
from deqmcl_gym.logs.motion import nearest_in_time, relative
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Indices, Singles
from deqmcl_gym.validation import InputError, tell

MAX_APART = 0.1  # s


def paired(scanned: Mapping[str, Log], source: str, max_apart: float = MAX_APART) -> Log:
    """Return one log of several lidars on one robot; a record has a scan of each.

    Records are those of the lidar with the fewest scans. Of each other lidar a record gets the scan
    nearest in time, moved by the odometry between the two stamps. No scan is in two records.
    Records without such a scan are left out and counted.

    Args:
        scanned: the log of each lidar, by its topic; its scanner has mounts.
        source: of the log.
        max_apart: of the stamps of a record's scans, s.
    """
    slowest = min(scanned, key=lambda topic: len(scanned[topic]))
    base = scanned[slowest]
    partner = {
        topic: np.arange(len(base)) if topic == slowest else _partners(base, log, max_apart)
        for topic, log in scanned.items()
    }
    whole = np.all([found >= 0 for found in partner.values()], axis=0)
    skipped = Counter(base.skipped)
    for topic, found in partner.items():
        if lost := int((found < 0).sum()):
            skipped[f"without a scan of {topic} within {max_apart:g} s"] += lost
    if not whole.any():
        raise InputError(
            f"{source} has no scans of {' and '.join(scanned)} within {max_apart:g} s of one "
            "another: give a larger max_apart, or one topic, and compare the clocks of the lidars."
        )
    kept = base.of_records(np.flatnonzero(whole))
    ranges = [
        log.ranges[found[whole]] if log is base else _moved(log, found[whole], kept.odometry)
        for log, found in zip(scanned.values(), partner.values(), strict=True)
    ]
    _tell(scanned, slowest, kept, skipped - Counter(base.skipped), source)
    scanners = [log.scanner for log in scanned.values()]
    return replace(
        kept, scanner=_joined(scanners), ranges=np.concatenate(ranges, axis=1), source=source,
        skipped=dict(skipped),
    )  # fmt: skip


def _partners(base: Log, other: Log, max_apart: float) -> Indices:
    """Return for each record of ``base`` the scan nearest in time, its own alone; -1 for none."""
    found, least = nearest_in_time(other.times, base.times)
    found[least > max_apart + 1e-9] = -1
    # of two records with one scan the nearer has it
    order = np.argsort(least, kind="stable")
    _, first = np.unique(found[order], return_index=True)
    lost = np.ones(len(base), np.bool_)
    lost[order[first]] = False
    found[lost] = -1
    return found


def _moved(log: Log, chosen: Indices, poses: Floats) -> Singles:
    """Return scans as the lidar would have taken them from other poses (n, 3) of the odometry.

    Each return is a point, which is seen by the beam that is nearest in angle; of several the
    nearest counts, and a beam that sees none has no return. A scan whose robot did not move is
    unchanged.
    """
    scanner, ranges = log.scanner, log.ranges[chosen]
    moves = relative(poses, log.odometry[chosen])
    driven = np.flatnonzero((moves != 0).any(axis=1))
    bearings, ((ahead, left),) = scanner.bearings, scanner.places
    first = bearings[0]
    step = (bearings[-1] - first) / (scanner.beams - 1) if scanner.beams > 1 else 2 * math.pi
    row, beam = np.nonzero(np.isfinite(ranges[driven]))
    far = ranges[driven[row], beam].astype(np.float64)
    x, y = ahead + far * arrays.cos(bearings[beam]), left + far * arrays.sin(bearings[beam])
    dx, dy, turn = moves[driven[row]].T
    cosine, sine = arrays.cos(turn), arrays.sin(turn)
    x, y = dx + cosine * x - sine * y - ahead, dy + sine * x + cosine * y - left
    angle = np.asarray(arrays.arctan2(y, x)) - first
    seen = np.floor(np.mod(angle / step + 0.5, 2 * math.pi / abs(step))).astype(int)
    inside = seen < scanner.beams
    out = np.full((len(driven), scanner.beams), np.inf, np.float32)
    found = np.sqrt(x * x + y * y).astype(np.float32)
    np.minimum.at(out, (row[inside], seen[inside]), found[inside])
    ranges[driven] = scanner.measured(out)
    return ranges


def _joined(scanners: list[Scanner]) -> Scanner:
    """Return one scanner with the mounts of all; ranges are within those of each already."""
    return Scanner(
        angles=tuple(angle for one in scanners for angle in one.angles),
        mounts=tuple(mount for one in scanners for mount in one.mounts),
        min_range=min(one.min_range for one in scanners),
        max_range=max(one.max_range for one in scanners),
    )


def _tell(
    scanned: Mapping[str, Log], slowest: str, kept: Log, lost: Counter[str], source: str
) -> None:
    """Warn of records left out, and of scans that are in no record."""
    if lost:
        said = said_of_skipped(lost, len(kept))
        tell(f"{source}: {said}.")
    for topic, log in scanned.items():
        if topic != slowest and (unused := len(log) - len(kept)):
            tell(
                f"{source}: {unused:,} of {len(log):,} scans of {topic} are in no record: "
                f"records are those of {slowest}, which has the fewest scans."
            )
