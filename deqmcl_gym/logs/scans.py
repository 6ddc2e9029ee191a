"""Scans as lidars send them, brought to one form: bearings, limits and codes of no return.

Many lidars send another number of beams, another first angle or other limits with each scan. A log
has one list of bearings, and each of them gets the nearest beam of a scan.
"""

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics import Floats, Indices, Reals, Singles
from deqmcl_gym.validation import LARGEST, InputError, array

_TURN = 2 * math.pi
_ROUNDING = 1e-6  # rad
_STEEPEST = 1 / math.tan(math.radians(15))  # growth of a wall's range for each rad, at most
_DIRECTIONS = 0.1  # share of the directions in which it is read …
_CODE = 0.01  # share of all beams that read one number, the largest of a log: no return …
_BEYOND, _DEEPEST = 1e-3, 100  # … if at most such a share, of so many numbers, is beyond it, and …
_STANDS_OUT = 10  # … if it is so many times as frequent as a number usually is
_DROPPED = 0.5  # share of ranges that are no measurements above which that is told


class Fan(NamedTuple):
    """Angles of a scan's beams in the scanner's own frame, and the limits of its measurements."""

    start: float  # the first angle, rad
    step: float
    min_range: float  # as of ``Scanner``; 0 if none is said
    max_range: float

    @property
    def limited(self) -> bool:
        """Whether the largest range is said, as some drivers and simulators do not."""
        return 0 < self.max_range <= LARGEST

    def angles(self, beams: int) -> Floats:
        """Angles of so many beams, (beams,) rad."""
        return self.start + self.step * np.arange(float(beams))


def mark_unmeasured(ranges: Reals, min_range: float, max_range: float) -> None:
    """Overwrite ranges at or beyond max_range by +inf, other ones that measure nothing by NaN."""
    with np.errstate(invalid="ignore"):
        ranges[ranges >= np.float32(max_range)] = np.inf
        ranges[~(ranges > np.float32(min_range))] = np.nan


def usual_fan(sizes: Sequence[int], fans: Sequence[Fan]) -> tuple[int, Fan]:
    """Return the beams that stand for scans that may vary: how many, their angles and limits.

    These are the number and angles of most scans or, if they vary, of beams that cover what they
    cover, and limits within which all scans' are; a max_range of -inf if none has a finite one
    above 0.
    """
    counts = Counter((size, fan[:2]) for size, fan in zip(sizes, fans, strict=True) if size)
    if not counts:
        raise InputError("no scan has a beam.")
    (beams, (start, step)), often = counts.most_common(1)[0]
    if often < len(sizes):
        middle = _middle_fan(sizes, fans)
        wider = abs(step) * (beams + 1) < abs(middle[2]) * middle[0]
        if 2 * often < len(sizes) or wider:  # no two need be alike
            beams, start, step = middle
    nearest = min(fan.min_range for fan in fans)
    farthest = max((fan.max_range for fan in fans if fan.limited), default=-math.inf)
    return beams, Fan(start, step, nearest, farthest)


def at_usual_bearings(
    scans: Sequence[Sequence[float]], fans: Sequence[Fan], beams: int, usual: Fan, max_range: float
) -> tuple[Singles, str | None]:
    """Return the ranges of scans at the bearings of ``usual_fan``, (n, beams), and what to tell.

    They are +inf and NaN where they are no measurements; ``max_range`` is that of scans that have
    none.
    """
    sizes = list(map(len, scans))
    alike: dict[tuple[int, Fan], list[int]] = {}
    for row, key in enumerate(zip(sizes, fans, strict=True)):
        alike.setdefault(key, []).append(row)
    angles = usual.angles(beams)
    ranges = np.full((len(scans), beams), np.nan, np.float32)
    others, largest = 0, 0.0
    for (size, fan), rows in alike.items():
        with np.errstate(over="ignore", invalid="ignore"):
            block = np.array([scans[row] for row in rows], np.float32).reshape(len(rows), size)
        mark_unmeasured(block, fan.min_range, fan.max_range if fan.limited else max_range)
        if size != beams or fan[:2] != usual[:2]:
            others += len(rows)
            if not size:
                continue
            block, off = _seen_at(block, fan.angles(size), angles)
            largest = max(largest, off)
        ranges[rows] = block
    if not others:
        return ranges, None
    numbers = f"{min(sizes)} to {max(sizes)}" if min(sizes) < max(sizes) else str(max(sizes))
    return ranges, (
        f"{others:,} of {len(scans):,} scans have other angles than those of the log "
        f"({numbers} beams a scan): each bearing of the log has the wall between its two "
        f"beams, or the nearest beam, at most {math.degrees(largest):.2g}° off"
    )


def _seen_at(ranges: Singles, beams: Floats, onto: Floats) -> tuple[Singles, float]:
    """Return scans (k, B) of beams at angles (B,) at bearings ``onto``, (k, b), rad.

    The point between two returns of a straight wall that is not seen at less than 15°, else the
    nearest beam's range, NaN if that is more than half the usual angle between bearings off. Also
    returned is how far off a beam that is used is at most, rad.
    """
    around = np.mod(beams, _TURN)
    order = np.argsort(around, kind="stable")
    at = np.searchsorted(around[order], np.mod(onto, _TURN), side="right")
    before, after = order[at - 1], order[at % order.size]  # clockwise, counterclockwise
    past = np.mod(onto - beams[before], _TURN)  # from the beam before to the bearing
    past[past > _TURN - _ROUNDING] = 0.0  # of a beam at the bearing itself
    gap = np.mod(beams[after] - beams[before], _TURN)
    gap[gap < past] += _TURN
    spacing = np.abs(np.diff(onto))
    within = (float(np.median(spacing)) / 2 if spacing.size else math.pi) + _ROUNDING
    off = np.minimum(past, gap - past)
    nearer = np.where(past <= gap / 2, before, after)
    nearest = np.where(off <= within, ranges[:, nearer], np.float32(np.nan))
    first, second = ranges[:, before], ranges[:, after]
    with np.errstate(invalid="ignore", divide="ignore"):
        wall = np.abs(second - first) <= _STEEPEST * gap * (first + second) / 2
        wall &= (off > _ROUNDING) & (gap <= 4 * within)
        straight = first * second * np.sin(gap)
        straight /= first * np.sin(past) + second * np.sin(gap - past)
    joined = np.where(wall, straight, nearest).astype(np.float32)
    return joined, float(off[off <= within].max(initial=0.0))


def _middle_fan(sizes: Sequence[int], fans: Sequence[Fan]) -> tuple[int, float, float]:
    """Return number, first angle and median increment of beams that cover what scans cover, rad."""
    seen = [(size, fan) for size, fan in zip(sizes, fans, strict=True) if size]
    steps = np.array([fan.step for _, fan in seen])
    sense = 1.0 if (steps > 0).sum() >= (steps < 0).sum() else -1.0
    step = float(np.median(np.abs(steps)))
    ends = np.array([sorted((fan.start, fan.start + fan.step * (size - 1))) for size, fan in seen])
    low, high = float(np.quantile(ends[:, 0], 0.05)), float(np.quantile(ends[:, 1], 0.95))
    if not step > 0:
        return 1, low, 0.0
    beams = min(round((high - low) / step), math.floor(_TURN / step + _ROUNDING)) + 1
    return beams, (low if sense > 0 else low + step * (beams - 1)), sense * step


def resampled(ranges: ArrayLike, bearings: ArrayLike, onto: Floats) -> Singles:
    """Return a scan (B,) at other bearings ``onto``, (b,) rad, by the walls between its beams."""
    scan = np.asarray(ranges, dtype=np.float32)
    angles = array("bearings", bearings, (None,)) if np.size(bearings) else np.empty(0)
    if scan.shape != angles.shape:
        raise InputError(
            f"the scan has {scan.size} ranges and {angles.size} bearings: give one for each."
        )
    if not scan.size:
        return np.full(onto.size, np.nan, np.float32)
    seen: Singles = _seen_at(scan[None], angles, onto)[0][0]
    return seen


def no_return_codes(ranges: Singles) -> tuple[list[float], list[float]]:
    """Return the numbers that stand for no return in the ranges of a log: large ones, small ones.

    A number is one if a per cent or more of all beams read it to the last digit, in several
    directions, hardly a reading is beyond it, and it stands out: numbers of beams that hit walls
    differ. Without it, the next may be, too.
    """
    values, counts = np.unique(ranges[np.isfinite(ranges)], return_counts=True)
    large = _codes(values[::-1].tolist(), counts[::-1], ranges)
    return large, _codes(values.tolist(), counts, ranges)


def _codes(values: list[float], counts: Indices, ranges: Singles) -> list[float]:
    """Return the codes among values of ranges, counted from their end on."""
    codes: list[float] = []
    beyond, total = 0, ranges.size
    several = max(2.0, _DIRECTIONS * ranges.shape[1])  # one beam at a wall as the robot stands
    for at, (value, count) in enumerate(zip(values[:_DEEPEST], counts.tolist(), strict=False)):
        rest = counts[at + 1 :]
        if not rest.size or beyond > _BEYOND * total:
            break
        stands_out = count >= _CODE * total and count >= _STANDS_OUT * float(np.median(rest))
        if stands_out and (ranges == value).any(axis=0).sum() >= several:
            codes.append(value)
        else:
            beyond += count
    return codes


def dropped_words(ranges: Singles, limits: Sequence[float], unit: str) -> str | None:
    """Say that most ranges of a log are no measurements, and why; None if they are not most."""
    beyond, none = float(np.isinf(ranges).mean()), float(np.isnan(ranges).mean())
    if beyond + none <= _DROPPED:
        return None
    least, most = limits
    return (
        f"{beyond + none:.0%} of the ranges are no measurements: {beyond:.0%} are at or beyond "
        f"max_range, {most:g} {unit} (nothing within reach), and {none:.0%} at or below min_range, "
        f"{least:g} {unit}, or not a number"
    )
