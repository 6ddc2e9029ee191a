"""CARMEN logs: one message per line, its words separated by blanks.

``FLASER n r… x y θ odom_x odom_y odom_θ time host [logger_time]`` does not contain its angles: n
beams begin at -90° and are 180°/n apart if n is even, or reach +90° if n is odd, as those of a SICK
LMS. ``ROBOTLASER1 type start fov step max_range accuracy remission_mode n r… m remission… laser_x
laser_y laser_θ odom_x odom_y odom_θ v ω safety_front safety_side axis time host [logger_time]``
is complete. ``TRUEPOS x y θ odom_x odom_y odom_θ time host [logger_time]``, of CARMEN's simulator,
is the reference. ``PARAM`` lines have the mounting and the range of FLASER's scanner; logs written
here have ``PARAM deqmcl_scanner``, with all digits of the scanner.
"""

import math
import re
import warnings
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from deqmcl_gym.files import numbers_of, save, text_of
from deqmcl_gym.logs.log import Log, Scanner
from deqmcl_gym.logs.motion import composed, relative
from deqmcl_gym.logs.raw_records import UNREADABLE, RawRecords, usable
from deqmcl_gym.logs.trajectory import with_own_reference
from deqmcl_gym.numerics import arrays
from deqmcl_gym.validation import InputError, LogWarning, one_of

SCANS = ("FLASER", "ROBOTLASER1")
SICK_RANGE = 79.0  # m: an LMS in its 80 m mode reports 81.83 or 81.91 where nothing is in range
SMALLEST = 0.01  # m: 0 is a failed beam, and an LMS measures in cm
_OURS, _UNIT = "deqmcl_scanner", "deqmcl_unit"

# How a message of any kind begins and ends
_KIND = re.compile(r"[A-Z_]+\d*")
_STAMP = re.compile(r"(.* )?[\d.]+ [A-Za-z]\S*( [\d.]+)?")

# Other messages of such logs, which are not needed here
_OTHERS = re.compile(
    r"#.*|[RP]?ODOM|PARAM|SYNC|TRUEPOS|(R|RAW|ROBOT|PANTILT|POSITION)?LASER\d?|SONAR|BUMPER|IMU|PANTILT"
    r"|SCANMARK|MARKER|(BASE|ROBOT)VELOCITY|FOLLOWTRAJECTORY|VECTORMOVE|NMEA\w+|GPSVTG|WIFI|POSITION"
)


@dataclass
class _Messages:
    """The messages of a log: scans by the word they begin with, parameters, true poses.

    Attributes:
        others: how many there are of each kind that is not among those known here.
    """

    scans: dict[str, RawRecords]
    others: Counter[str] = field(default_factory=Counter)
    params: dict[str, str] = field(default_factory=dict)
    truth: list[list[float]] = field(default_factory=list)
    mounts: list[list[float]] = field(default_factory=list)  # poses of laser and robot
    unreadable: int = 0

    def read(self, line: str) -> None:
        """Read a line; count it if it is damaged."""
        kind, *words = line.split()
        try:
            if kind == "FLASER":
                self._front_laser(words)
            elif kind == "ROBOTLASER1":
                self._robot_laser(words)
            elif kind == "PARAM":
                name, value, *_ = words
                self.params[name] = value
            elif kind == "TRUEPOS":
                self.truth.append(numbers_of([words[6], *words[:3]]))
            elif _OTHERS.fullmatch(kind):
                pass
            elif _KIND.fullmatch(kind) and _STAMP.fullmatch(" ".join(words[-3:])):
                self.others[kind] += 1
            else:
                self.unreadable += 1
        except (ValueError, IndexError):
            self.unreadable += 1

    def _front_laser(self, words: list[str]) -> None:
        n = int(words[0])
        if n < 1 or len(words) - n not in (9, 10):
            raise ValueError("another number of words")
        ranges, rest = numbers_of(words[1 : 1 + n]), numbers_of(words[1 + n : 8 + n])
        self.scans["FLASER"].add(rest[6], rest[3:6], ranges)

    def _robot_laser(self, words: list[str]) -> None:
        n = int(words[7])
        m = int(words[8 + n])
        if n < 1 or m < 0 or len(words) - n - m not in (22, 23):
            raise ValueError("another number of words")
        _, start, _, step, farthest, *_ = numbers_of(words[:7])
        ranges = numbers_of(words[8 : 8 + n])
        rest = numbers_of(words[9 + n + m : 21 + n + m])
        self.scans["ROBOTLASER1"].add(rest[11], rest[3:6], ranges, (start, step, farthest))
        self.mounts.append(rest[:6])

    def scanner(self, beams: int, geometry: tuple[float, ...] | None) -> Scanner:
        """Return the scanner of messages with a geometry, or without one, as FLASER."""
        if _OURS in self.params:
            return Scanner.of_json(_OURS, self.params[_OURS])
        if geometry is None:
            start, step = -math.pi / 2, math.pi / max(beams - beams % 2, 1)
            farthest = self._param("robot_front_laser_max", SICK_RANGE)
            names = ("offset", "side_offset", "angular_offset")
            x, y, turn = (self._param(f"robot_frontlaser_{name}", 0.0) for name in names)
        else:
            start, step, farthest = geometry
            x, y, turn = self._mounting()
        return Scanner(
            angles=tuple((start + turn + step * np.arange(beams)).tolist()),
            mounting=(x, y),
            turn=turn,
            min_range=SMALLEST,
            max_range=min(farthest, SICK_RANGE),
            no_return=min(farthest, SICK_RANGE),
        )

    @property
    def unit(self) -> str:
        """The unit of all lengths."""
        return self.params.get(_UNIT, "m")

    def _mounting(self) -> list[float]:
        """Median offset of the laser from the robot, to 0.001: x, y, turn."""
        mounts = np.array(self.mounts)
        offsets = relative(mounts[:, 3:], mounts[:, :3])
        offsets = offsets[usable(offsets)]
        if not len(offsets):
            return [math.nan] * 3
        off = offsets - offsets[0]
        off[:, 2] = arrays.wrapped(off[:, 2])  # a turn of π may also read -π
        middle: list[float] = (np.round(offsets[0] + np.median(off, axis=0), 3) + 0.0).tolist()
        return middle

    def _param(self, name: str, default: float) -> float:
        try:
            return numbers_of([self.params[name]])[0]
        except (KeyError, ValueError):
            return default


def read_carmen(path: Path, scan_topic: str | None = None, max_gap: float | None = None) -> Log:
    """Read a CARMEN log, gzipped or not.

    Args:
        path: the file.
        scan_topic: "FLASER" or "ROBOTLASER1"; None takes the one in the file.
        max_gap: of the true poses in it; see ``referenced``.

    Raises:
        InputError: there is no scan, a choice of two kinds, or no usable record.
    """
    messages = _Messages({kind: RawRecords(str(path)) for kind in SCANS})
    for line in text_of(path).splitlines():
        if line.strip():
            messages.read(line)
    found = messages.scans[_kind(path, messages, scan_topic)]
    if messages.unreadable:
        found.damage[UNREADABLE] += messages.unreadable
    log = found.log(messages.scanner, unit=messages.unit)
    if messages.others:
        left_out = ", ".join(f"{count:,} {kind}" for kind, count in messages.others.most_common())
        warnings.warn(f"{path}: left out messages of other kinds: {left_out}.", LogWarning, 2)
    return with_own_reference(log, messages.truth, max_gap)


def write_carmen(log: Log, path: Path) -> None:
    """Write ODOM and ROBOTLASER1 lines, and TRUEPOS where there is a reference, with all digits.

    Raises:
        InputError: beams are not evenly spaced, or the file cannot be written.
    """
    scanner, step = log.scanner, log.scanner.spacing
    if step is None:
        raise InputError(
            "beams of a CARMEN log must be evenly spaced, but those of this log are not: write "
            ".csv or .npz."
        )
    mounts = composed(log.odometry, np.array([*scanner.mounting, 0.0])).tolist()
    farthest = min(scanner.no_return, scanner.max_range)
    head = _words(0, scanner.angles[0], step * scanner.beams, step, farthest, 0.01, 0)
    lines = [
        "# CARMEN log of deqmcl-gym",
        f"PARAM {_OURS} {scanner.json} 0 nohost 0",
        f"PARAM {_UNIT} {log.unit} 0 nohost 0",
    ]
    for record, mount in zip(log, mounts, strict=True):
        odometry, stamp = _words(*record.odometry), f"{record.time!r} nohost {record.time!r}"
        ranges = np.where(np.isinf(record.ranges), np.float32(scanner.no_return), record.ranges)
        scan = " ".join(map(str, ranges.tolist()))
        lines.append(f"ODOM {odometry} 0 0 0 {stamp}")
        if record.reference is not None:
            lines.append(f"TRUEPOS {_words(*record.reference)} {odometry} {stamp}")
        lines.append(
            f"ROBOTLASER1 {head} {len(ranges)} {scan} 0 {_words(*mount)} {odometry} 0 0 0 0 0 "
            f"{stamp}"
        )
    save(path, ("\n".join(lines) + "\n").encode())


def _kind(path: Path, messages: _Messages, asked: str | None) -> str:
    if asked is not None:
        return one_of("kind of scan in a CARMEN log", asked, SCANS)
    there = [kind for kind, found in messages.scans.items() if found.times]
    if len(there) == 1:
        return there[0]
    if there:
        raise InputError(
            f"{path} has scans of two kinds, {' and '.join(there)}: choose one by scan_topic."
        )
    damaged = f", and {messages.unreadable:,} unreadable lines" if messages.unreadable else ""
    raise InputError(
        f"{path} has no scan{damaged}: a CARMEN log has lines that begin with {' or '.join(SCANS)}."
    )


def _words(*values: float) -> str:
    return " ".join(map(repr, values))
