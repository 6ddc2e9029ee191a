"""Odometry as it comes from a robot, judged: late messages, jumps, clocks that were set back.

One judge for a robot's loop (``localizers.Tracker``) and for recorded logs, so that a robot that is
fed with the messages of a log has the odometry of its replay.
"""

import bisect
import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.logs.motion import composed, has_moved, increments_of, one_pose, relative
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Bools, Floats, Indices, Pose, arrays
from deqmcl_gym.validation import LARGEST

FASTEST = 250.0, 2 * math.pi  # px/s (5 m/s), rad/s: what a robot can drive
SLACK = 25.0, 0.5  # px (0.5 m), rad: of a step, whatever its duration
BACK = 1.0  # s by which a stamp may be late; beyond, the clock may have been set back
_GAP = 1.0  # s without odometry beyond which the pose in between is unknown …
_PERIODS, _LONGEST = 3.0, 5.0  # … or so many of its usual periods, but never more than this, s
_PAUSE = 600.0  # s between two messages while a clock is set back, at most
_RECENT = 101  # messages that say which period is usual
_ALTERNATIONS = 10  # steps there and back, faster than a robot, that tell two publishers
_APART = 2.5  # px (0.05 m): of such a step at least
_ORIGIN = 0.1  # of the slack: how near to (0, 0, 0) a driver begins

Limit = tuple[float, float]  # of a length and of an angle


class Taken(enum.Enum):
    """What became of a message."""

    USED = enum.auto()
    RESET = enum.auto()  # used: the clock was set back at the message before, a new stretch begins
    LATE = enum.auto()  # older than the newest, or doubled: left out
    UNUSABLE = enum.auto()  # not finite, or beyond ``LARGEST``: left out


@dataclass
class Stretch:
    """Poses by odometry of one clock: times ascend, jumps are taken out."""

    times: list[float] = field(default_factory=list)  # s
    poses: list[Pose] = field(default_factory=list)  # (x, y, θ), without the jumps
    frames: list[Pose | None] = field(default_factory=list)

    def at(self, time: float) -> Pose | None:
        """Return the pose at a time, on a straight line between the two around it.

        None before the first, after the last, and in a gap of more than 1 s and 3 usual periods, or
        of more than 5 s.
        """
        after = bisect.bisect_left(self.times, time)
        if after < len(self.times) and self.times[after] == time:
            return self.poses[after]
        if after in (0, len(self.times)):
            return None
        begin, end = self.times[after - 1], self.times[after]
        if (gap := end - begin) > _GAP and gap > min(_LONGEST, _PERIODS * usual_period(self.times)):
            return None
        share = (time - begin) / (end - begin)
        (x, y, turn), (x1, y1, turn1) = self.poses[after - 1], self.poses[after]
        turned = math.remainder(turn1 - turn, 2 * math.pi)
        heading = math.remainder(turn + share * turned, 2 * math.pi)
        return x + share * (x1 - x), y + share * (y1 - y), heading

    def frame_at(self, time: float) -> Pose | None:
        """Return the frame of the odometry as it came, at a time that is not before the first."""
        return self.frames[bisect.bisect_right(self.times, time) - 1]

    def forget(self, before: float) -> None:
        """Forget what is older."""
        if old := bisect.bisect_left(self.times, before):
            for values in (self.times, self.poses, self.frames):
                del values[:old]


def usual_period(times: Sequence[float]) -> float:
    """Return the median time between the latest messages, s; 0 of a single one."""
    latest = times[-_RECENT:]
    return float(np.median(np.diff(latest))) if len(latest) > 1 else 0.0


class Odometry:
    """The odometry of a robot, message by message in the order in which they come.

    A step that no robot drives is a jump: of a driver that began anew, or of a first pose that
    means nothing. The robot has not moved in it. Two messages in a row that are older than the
    newest by more than 1 s, in their order, are of a clock that was set back: a new stretch begins
    with the first of them, and the robot has moved as it says, unless that is a jump.
    """

    def __init__(self, unit: str = "m", fastest: tuple[float, float] | None = None) -> None:
        """Begin without a message; steps above ``fastest``, per s and rad/s, are jumps."""
        usual, slack = _limits(unit)
        self._limits = fastest or usual, slack
        self.stretch, self.jumps = Stretch(), 0
        self._raw: Pose | None = None  # the latest as it came
        self._older: tuple[float, Pose] | None = None  # the message before, if far too old

    @property
    def newest(self) -> tuple[float, Pose] | None:
        """Time and pose of the newest message; None before the first."""
        return (self.stretch.times[-1], self.stretch.poses[-1]) if self.stretch.times else None

    def take(self, time: float, raw: Pose) -> Taken:
        """Take a pose with its stamp, s."""
        if not all(abs(value) <= LARGEST for value in (time, *raw)):  # False for NaN, too
            return Taken.UNUSABLE
        if self._raw is None:
            self._keep(time, raw, None)
            return Taken.USED
        taken = Taken.USED
        if time <= self.stretch.times[-1]:
            older, self._older = self._older, None
            if time < self.stretch.times[-1] - BACK:
                self._older = (time, raw)
            if older is None or self._older is None or time <= older[0]:
                return Taken.LATE
            taken, before, self.stretch = Taken.RESET, self.stretch, Stretch()
            self._follow(*older, before, 0.0)
        self._older, last = None, self.stretch
        self.jumps += self._follow(time, raw, last, time - last.times[-1])
        return taken

    def _follow(self, time: float, raw: Pose, last: Stretch, seconds: float) -> bool:
        """Keep a pose so long after the last one of a stretch; return whether it is a jump."""
        assert self._raw is not None
        jumped = _jumps(self._raw, raw, seconds, *self._limits)
        self._keep(time, raw, frame_of(last.poses[-1], raw) if jumped else last.frames[-1])
        return jumped

    def _keep(self, time: float, raw: Pose, frame: Pose | None) -> None:
        pose = raw if frame is None else one_pose(composed(np.array([frame]), np.array(raw)))
        self._raw = raw
        self.stretch.times.append(time)
        self.stretch.poses.append(pose)
        self.stretch.frames.append(frame)


def _limits(unit: str) -> tuple[Limit, Limit]:
    """Return the fastest that a robot drives, and the slack of a step, in a unit of length."""
    size = pixel(unit)
    return (FASTEST[0] * size, FASTEST[1]), (SLACK[0] * size, SLACK[1])


def _jumps(last: Pose, pose: Pose, seconds: float, fastest: Limit, slack: Limit) -> bool:
    """Whether no robot drives so, or a driver begins anew at (0, 0, 0), maybe after a pause."""
    (far, turned), (along, turn) = fastest, slack
    if has_moved(last, pose, far * seconds + along, turned * seconds + turn):
        return True
    return has_moved(last, pose, along, turn) and not has_moved(
        (0.0, 0.0, 0.0), pose, _ORIGIN * along, _ORIGIN * turn
    )


@dataclass(frozen=True)
class JudgedOdometry:
    """All odometry of a log, judged: its stretches, whose times go on when a clock is set back."""

    begins: Sequence[float]  # number of the message with which each stretch begins
    shifts: Sequence[float]  # what is added to stamps in each stretch, s
    stretches: Sequence[Stretch]
    lost: int  # number of messages that are left out
    jumps: int  # number of steps that were jumps

    @classmethod
    def of(cls, numbers: Floats, received: Floats, rows: Floats, unit: str) -> "JudgedOdometry":
        """Return odometry, rows t, x, y, θ, (n, 4), judged in the order in which it came.

        Numbers of messages ascend, (n,); ``received`` is when each came, s, by a clock that may be
        another; NaN if unknown, (n,).
        """
        odometry, rows = Odometry(unit), rows.copy()
        rows[_far_ahead(rows[:, 0]), 0] = math.nan
        stretches, begins, shifts = [odometry.stretch], [-math.inf], [0.0]
        lost = 0
        for at, (time, *raw) in enumerate(rows.tolist()):
            before = odometry.stretch
            taken = odometry.take(time, (raw[0], raw[1], raw[2]))
            lost += taken in (Taken.LATE, Taken.UNUSABLE)
            if taken is Taken.RESET:
                lost -= 1  # the one before: it is used after all
                elapsed = float(received[at - 1] - received[at - 2])
                if not 0 < elapsed < _PAUSE:
                    elapsed = usual_period(before.times)
                shifts.append(shifts[-1] + before.times[-1] + elapsed - odometry.stretch.times[0])
                begins.append(float(numbers[at - 1]))
                stretches.append(odometry.stretch)
        return cls(begins, shifts, stretches, lost, odometry.jumps)

    def at(self, number: float, time: float) -> tuple[float, Pose] | None:
        """Return the time, shifted, and the pose of a message of this number and stamp, or None."""
        last = bisect.bisect_right(self.begins, number) - 1
        for at in range(last, max(last - 2, -1), -1):
            if (pose := self.stretches[at].at(time)) is not None:
                return time + self.shifts[at], pose
        return None

    def shifted(self, numbers: Floats, times: Floats) -> Floats:
        """Return the stamps of messages of these numbers, shifted, (n,)."""
        at = np.searchsorted(self.begins, numbers, side="right") - 1
        return np.asarray(times + np.array(self.shifts)[at])

    @property
    def remarks(self) -> list[str]:
        """What users are told about it."""
        return remarks_of(len(self.stretches) - 1, self.jumps, self.lost)


def remarks_of(resets: int, jumps: int, lost: int = 0) -> list[str]:
    """Return what is to be told of clocks set back, of odometry that jumps, of lost messages."""
    remarks = []
    if resets:
        remarks.append(f"the clock was set back, {times_words(resets)}: later times are shifted")
    if jumps:
        fast = f"the odometry jumps farther than a robot drives, {times_words(jumps)}"
        remarks.append(f"{fast}: taken as no motion")
    if lost:
        remarks.append(f"{lost:,} odometry messages are left out: late, doubled or not finite")
    return remarks


def times_words(count: int) -> str:
    """Say how often."""
    return "once" if count == 1 else f"{count:,} times"


def frame_of(there: Pose | Floats, raw: Pose | Floats) -> Pose:
    """Return the frame in which the odometry reading ``raw`` is the pose ``there``."""
    return one_pose(composed(np.array([there]), relative(np.array([raw]), np.zeros((1, 3)))))


def jumps_in(times: Floats, poses: Floats, unit: str) -> Bools:
    """Return which steps between poses (n, 3) at times (n,) no robot drives, (n - 1,)."""
    steps = zip(pairwise(map(tuple, poses.tolist())), np.diff(times).tolist(), strict=True)
    return np.array([_jumps(*pair, seconds, *_limits(unit)) for pair, seconds in steps], np.bool_)


def without_jumps(times: Floats, poses: Floats, unit: str) -> tuple[Floats, int]:
    """Return poses (n, 3) of one clock without the steps that no robot drives, and their number."""
    jumped = jumps_in(times, poses, unit)
    judged = poses.copy()
    for at in np.flatnonzero(jumped) + 1:  # from here on in the frame before
        frame = frame_of(judged[at - 1], poses[at])
        judged[at:] = composed(np.full_like(poses[at:], frame), poses[at:])
    return judged, int(jumped.sum())


def clock_shifts(times: ArrayLike) -> Floats:
    """Return by how much stamps must be shifted so that a clock that was set back goes on, (n,).

    As of ``Odometry``: two stamps in a row that are older than the newest by more than 1 s, in
    their order. The new stretch begins the usual period after the old one.
    """
    stamps = np.asarray(times, dtype=np.float64)
    shifts = np.zeros(stamps.size)
    newest, shift = -math.inf, 0.0
    for at in np.flatnonzero(np.isfinite(stamps) & ~_far_ahead(stamps)):
        time, after = stamps[at], stamps[at + 1 : at + 2]
        if time < newest - BACK and (time < after).any() and (after < newest - BACK).any():
            shift += newest + float(np.median(np.abs(np.diff(stamps)))) - time
            newest = time
        shifts[at] = shift
        newest = max(newest, time)
    return shifts


def _far_ahead(times: Floats) -> Bools:
    """Return which stamps are far ahead of those before and after, which are in order, (n,)."""
    ahead = np.zeros(times.size, np.bool_)
    before, middle, after = times[:-2], times[1:-1], times[2:]
    ahead[1:-1] = (before <= after) & (middle > after + BACK)
    return ahead


def publishers(times: Floats, poses: Floats, sources: Indices, unit: str) -> list[Indices]:
    """Return the messages of each publisher of a topic, by index, the one with most of them first.

    Two publishers are told by their connections, if messages of these alternate, or by poses that
    go there and back faster than any robot, again and again. Then each message belongs to the
    publisher whose next message is nearer to it, from the last one backwards: at first, both may be
    at the same place. Times are those of the headers, (n,) s, in the order in which messages came,
    poses finite, (n, 3), sources the numbers of connections, (n,).
    """
    by_source = [np.flatnonzero(sources == source) for source in np.unique(sources)]
    if np.count_nonzero(np.diff(sources)) > len(by_source) + _ALTERNATIONS:
        return sorted(by_source, key=len, reverse=True)
    size = pixel(unit)
    steps = np.diff(poses[:, :2], axis=0)
    length, seconds = np.hypot(*steps.T), np.abs(np.diff(times))
    fast = length > size * (_APART + FASTEST[0] * seconds)
    back = np.hypot(*(poses[2:, :2] - poses[:-2, :2]).T) < np.minimum(length[1:], length[:-1]) / 2
    turns = np.flatnonzero(fast[1:] & fast[:-1] & back)
    if turns.size < _ALTERNATIONS:
        return [np.arange(len(times))]
    heads, owners = [int(turns[-1]), int(turns[-1]) + 1], np.empty(len(times), np.intp)
    order = [*range(heads[1], -1, -1), *range(heads[1] + 1, len(times))]
    reach = np.array([1.0, 1.0, 50 * size])  # 1 m for each rad
    first = poses[heads].copy()
    ends = first.copy()
    for at in order:
        if at == heads[1] + 1:
            ends = first
        off = poses[at] - ends
        off[:, 2] = arrays.wrapped(off[:, 2])
        owners[at] = int(np.square(off * reach).sum(axis=1).argmin())
        ends[owners[at]] = poses[at]
    return sorted((np.flatnonzero(owners == head) for head in (0, 1)), key=len, reverse=True)


def publisher_words(rows: Floats) -> str:
    """Say how often messages t, x, y, θ come, and how far they say that the robot went."""
    rate = 1 / max(float(np.median(np.diff(rows[:, 0]))), 1e-9)
    steps = increments_of(rows[:, 1:])
    return f"{rate:.3g} Hz, {np.hypot(steps[:, 0], steps[:, 1]).sum():.1f} m"
