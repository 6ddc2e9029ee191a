"""CARMEN logs: one message per line, its words separated by blanks.

``FLASER n r… x y θ odom_x odom_y odom_θ time host [logger_time]`` does not contain its angles: n
beams begin at -90° and are 180°/n apart if n is even, or reach +90° if n is odd, as those of a SICK
LMS, unless ``PARAM laser_front_laser_fov`` and ``…_resolution`` (degrees) or an argument say
otherwise. ``RAWLASER1 type start fov step max_range accuracy remission_mode n r… m remission… time
host [logger_time]`` has its angles but no odometry, which is that of the lines ``ODOM x y θ v ω a
time host [logger_time]`` around it. ``ROBOTLASER1``, which begins as RAWLASER1, goes on with
``laser_x laser_y laser_θ odom_x odom_y odom_θ v ω safety_front safety_side axis`` before its time
and is complete. ``TRUEPOS x y θ odom_x odom_y odom_θ time host [logger_time]``, of CARMEN's
simulator, is the reference. ``PARAM`` lines have the mounting and the range of FLASER's scanner;
logs that former versions wrote have ``PARAM deqmcl_scanner``, with all digits of it.
"""

import math
import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from deqmcl_gym.files import numbers_of, text_of
from deqmcl_gym.logs.log import Log, Scanner
from deqmcl_gym.logs.motion import relative
from deqmcl_gym.logs.odometry import JudgedOdometry
from deqmcl_gym.logs.raw_records import UNREADABLE, RawRecord, RawRecords, usable
from deqmcl_gym.logs.scans import Fan
from deqmcl_gym.logs.trajectory import with_own_reference
from deqmcl_gym.numerics import arrays
from deqmcl_gym.validation import InputError, like, number, one_of, tell

SCAN_KINDS = ("FLASER", "ROBOTLASER1", "RAWLASER1")
SICK_RANGE = 79.0  # m: an LMS in its 80 m mode reports 81.83 or 81.91 where nothing is in range
_NARROWEST = math.radians(10)  # of a field of view: less is none, or rad
_SICK = (90, 91, 180, 181, 360, 361)  # numbers of beams of an LMS over 180°
_OURS, _UNIT = "deqmcl_scanner", "deqmcl_unit"

_OTHERS = re.compile(r"#.*|[A-Z_]+\d*")  # comments, and messages that are not needed here


@dataclass
class _Messages:
    """The messages of a log: scans by the word they begin with, parameters, true poses."""

    scans: dict[str, RawRecords]
    params: dict[str, str] = field(default_factory=dict)
    truth: list[list[float]] = field(default_factory=list)
    mounts: list[list[float]] = field(default_factory=list)  # poses of laser and robot
    odometry: list[list[float]] = field(default_factory=list)  # number of the line, t, x, y, θ
    lines: int = 0
    unreadable: int = 0
    lasers: Counter[str] = field(default_factory=Counter)  # other scans

    def read(self, line: str) -> None:
        """Read a line; count it if it is damaged."""
        kind, *words = line.split()
        self.lines += 1
        try:
            if kind in SCAN_KINDS:
                self._scan(kind, words)
            elif kind == "ODOM":
                self.odometry.append([self.lines, *numbers_of([words[6], *words[:3]])])
            elif kind == "PARAM":
                name, value, *_ = words
                self.params[name] = value
            elif kind == "TRUEPOS":
                self.truth.append(numbers_of([words[6], *words[:3]]))
            elif _OTHERS.fullmatch(kind):
                self.lasers.update([kind] if "LASER" in kind else [])
            else:
                self.unreadable += 1
        except (ValueError, IndexError):
            self.unreadable += 1

    def _scan(self, kind: str, words: list[str]) -> None:
        """Read a scan: its fan, n, its ranges, perhaps m, remissions, poses, a time."""
        first, poses = {"FLASER": (1, 6), "ROBOTLASER1": (8, 11), "RAWLASER1": (8, 0)}[kind]
        n = int(words[first - 1])
        remissions = int(words[first + n]) if first > 1 else -1
        after = first + n + 1 + remissions
        if n < 1 or (first > 1 and remissions < 0) or len(words) - after - poses not in (2, 3):
            raise ValueError("another number of words")
        ranges = numbers_of(words[first : first + n])
        *places, stamp = numbers_of(words[after : after + poses + 1])
        fan = None
        if first > 1:
            _, start, _, step, farthest, *_ = numbers_of(words[:7])
            fan = Fan(start, step, 0.0, min(farthest, SICK_RANGE))
        record = RawRecord(stamp, places[3:6] or (0, 0, 0), ranges, fan, number=self.lines)
        self.scans[kind].records.append(record)
        if kind == "ROBOTLASER1":
            self.mounts.append(places[:6])

    def records(self, kind: str, field_of_view: float | None) -> RawRecords:
        """Return the records of a kind of scan, with all that other messages say of them."""
        records = self.scans[kind]
        records.damage += Counter({UNREADABLE: self.unreadable})
        if _OURS in self.params:
            records.records = [record._replace(fan=None) for record in records.records]
        elif kind == "RAWLASER1":
            table = np.array(self.odometry).reshape(-1, 5)
            unknown = np.full(len(table), np.nan)
            judged = JudgedOdometry.of(table[:, 0], unknown, table[:, 1:], self.unit)
            for remark in judged.remarks:
                tell(f"{records.source}: {remark}.")
            return records.with_odometry(judged)
        elif kind == "FLASER":
            logged_fov = math.radians(self._param("laser_front_laser_fov", math.nan))
            if field_of_view is None and _NARROWEST <= logged_fov <= 2 * math.pi:
                field_of_view = logged_fov
            sizes = Counter(len(record.ranges) for record in records.records)
            fans = {beams: self._fan(beams, field_of_view) for beams in sizes}
            records.records = [r._replace(fan=fans[len(r.ranges)]) for r in records.records]
            usual = max(sizes, key=lambda beams: sizes[beams], default=_SICK[0])
            if field_of_view is None and usual not in _SICK:
                tell(
                    f"{records.source}: FLASER lines do not say their angles: {usual} beams are "
                    "taken as those of a SICK LMS, from -90° to 90°; for another lidar give "
                    f"field_of_view in rad{like('field_of_view', 4.712)} for 270°."
                )
        return records

    def _fan(self, beams: int, field_of_view: float | None) -> Fan:
        """Return the fan of FLASER."""
        view = math.pi if field_of_view is None else field_of_view
        step = math.radians(self._param("laser_front_laser_resolution", math.nan))
        if field_of_view is None or not (step > 0 and abs(step * beams - view) < 2 * step):
            step = view / max(beams - beams % 2, 1)
        farthest = min(self._param("robot_front_laser_max", SICK_RANGE), SICK_RANGE)
        return Fan(-view / 2, step, 0.0, farthest if farthest > 0 else SICK_RANGE)

    def scanner(self, beams: int, kind: str, fan: Fan | None) -> Scanner:
        """Return the scanner of a kind of message with the usual angles and limits."""
        if _OURS in self.params:
            return Scanner.of_json(_OURS, self.params[_OURS])
        assert fan is not None
        names = ("offset", "side_offset", "angular_offset")
        x, y, turn = (self._param(f"robot_frontlaser_{name}", 0.0) for name in names)
        if kind == "ROBOTLASER1":
            x, y, turn = self._mounting()
        return Scanner(
            angles=tuple((turn + fan.angles(beams)).tolist()),
            mounting=(x, y),
            turn=turn,
            max_range=fan.max_range,
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
        return list((np.round(offsets[0] + np.median(off, axis=0), 3) + 0.0).tolist())

    def _param(self, name: str, default: float) -> float:
        try:
            return numbers_of([self.params[name]])[0]
        except (KeyError, ValueError):
            return default


def read_carmen(
    path: Path,
    scan_topic: str | None = None,
    max_gap: float | None = None,
    reference_tolerance: float | None = None,
    field_of_view: float | None = None,
) -> Log:
    """Read a CARMEN log, gzipped or not; see ``logs.read``."""
    if field_of_view is not None:
        number("field_of_view", field_of_view, low=0, above=True, high=2 * math.pi)
    name = str(path)
    messages = _Messages({kind: RawRecords(name) for kind in SCAN_KINDS})
    for line in filter(str.strip, text_of(path).splitlines()):
        messages.read(line)
    kind = _kind(name, messages, scan_topic)
    records = messages.records(kind, field_of_view)
    log = records.log(lambda beams, _, fan: messages.scanner(beams, kind, fan), unit=messages.unit)
    return with_own_reference(log, messages.truth, max_gap, reference_tolerance)


def _kind(name: str, messages: _Messages, asked: str | None) -> str:
    if asked is not None:
        return one_of("kind of scan in a CARMEN log", asked, SCAN_KINDS)
    kinds = [kind for kind, scans in messages.scans.items() if scans.records]
    whole = [kind for kind in kinds if kind != "RAWLASER1"] or kinds  # raw ones are the same scans
    if len(whole) == 1:
        return whole[0]
    if whole:
        raise InputError(
            f"{name} has scans of two kinds, {' and '.join(whole)}: choose one by "
            f"scan_topic{like('scan_topic', whole[0])}."
        )
    damaged = f", and {messages.unreadable:,} unreadable lines" if messages.unreadable else ""
    lasers = [f"{count:,} {kind}" for kind, count in messages.lasers.items()]
    others = f", but {', '.join(lasers)}, which are not read" if lasers else ""
    raise InputError(
        f"{name} has no scan{damaged}{others}: a CARMEN log has lines that begin with "
        f"{', '.join(SCAN_KINDS)}."
    )
