"""ROS 1 and ROS 2 bags, read by ``rosbags``, without ROS.

Transforms between the frames of a robot give the scanner's mounting and, if need be, the odometry.
"""

import math
import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from deqmcl_gym.files import opened_log
from deqmcl_gym.logs.log import Log, Scanner
from deqmcl_gym.logs.motion import between, heading_of
from deqmcl_gym.logs.pairing import MAX_APART, paired
from deqmcl_gym.logs.raw_records import NO_ODOMETRY, UNREADABLE, RawRecords
from deqmcl_gym.logs.trajectory import with_own_reference
from deqmcl_gym.logs.transforms import ODOMETRY, Transforms, frame_name, only_frame
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import LARGEST, InputError, LogWarning, number, one_of, shown

SCAN = "sensor_msgs/msg/LaserScan"
POSES: dict[str, Callable[[Any], Any]] = {
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
    ODOMETRY: lambda message: message.pose.pose,
}
_TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
UNIT_TOPIC, REFERENCE_TOPIC = "/deqmcl_unit", "/reference"
ESTIMATE_TOPIC = "/amcl_pose"  # of Nav2's AMCL
_GAP = 1.0  # s without odometry beyond which the pose in between is unknown
_ROBOT, _MAP = "base_link", "map"


def require_rosbags() -> None:
    """Check that ``rosbags`` is installed.

    Raises:
        InputError: it is not installed.
    """
    try:
        import rosbags.highlevel  # noqa: F401
    except ModuleNotFoundError:
        raise InputError(
            'ROS bags need rosbags, which is not installed: pip install "deqmcl-gym[ros]".'
        ) from None


def read_bag(
    path: Path,
    scan_topic: str | Sequence[str] | None = None,
    odometry_topic: str | None = None,
    reference_topic: str | None = None,
    base_frame: str | None = None,
    max_gap: float | None = None,
    max_range: float | None = None,
    max_apart: float | None = None,
) -> Log:
    """Read a ROS bag; see ``logs.read``.

    A scan's time is that of its header; its odometry is interpolated between the two messages
    around it. Static transforms give the mounting of the scanner, which may hang upside down.
    Scans of several topics are ``paired``.

    Raises:
        InputError: the bag is missing or damaged, a topic is missing or has to be chosen, the
            scanner is tilted, or no record is usable.
    """
    require_rosbags()
    if not os.path.exists(path):
        raise InputError(f"{path} does not exist: give the path of a bag.")
    asked = _scan_topics(scan_topic)
    if max_apart is not None:
        number("max_apart", max_apart, low=0)
        if len(asked) < 2:
            raise InputError("max_apart is given, but pairs the scans of 2 scan topics or more.")
    with _opened(path) as bag:
        scans = [_topic(path, bag, (SCAN,), "scan_topic", one) for one in asked]
        odometry = _topic(path, bag, (ODOMETRY,), "odometry_topic", odometry_topic, needed=False)
        if reference_topic is None and REFERENCE_TOPIC not in bag.topics:
            reference = None
        else:
            named = reference_topic or REFERENCE_TOPIC
            reference = _topic(path, bag, tuple(POSES), "reference_topic", named)
        messages = _Messages(path, [one for one in scans if one], odometry, reference)
        messages.read(bag)
    _warn_of_frames(path, reference, messages.frames)
    base = None if base_frame is None else frame_name(base_frame)
    return messages.log(base, max_gap, max_range, MAX_APART if max_apart is None else max_apart)


def _scan_topics(given: str | Sequence[str] | None) -> Sequence[str | None]:
    """Return the topics asked for, or None for the only one."""
    if given is None or isinstance(given, str):
        return [given]
    several = isinstance(given, list | tuple) and len(set(map(str, given))) == len(given) > 0
    if not several or not all(isinstance(one, str) for one in given):
        raise InputError(
            f"scan_topic is {shown(given)}, but must be a topic or several different ones."
        )
    return given


def read_pose_topic(path: Path, topic: str | None = None) -> tuple[Floats, Floats | None]:
    """Read the poses that a stack has published in a bag; warn if they are not in the map's frame.

    Args:
        path: of the bag.
        topic: of type ``POSES``; None: ``/amcl_pose``, or the only one.

    Returns:
        Rows t, x, y, θ by the messages' headers, (n, 4), NaN where they are; and the covariances of
        (x, y, θ), (n, 3, 3), NaN where a message has zeros instead, None if all have or the type
        has none.

    Raises:
        InputError: the bag cannot be read, or the topic is missing or has to be chosen.
    """
    require_rosbags()
    if not os.path.exists(path):
        raise InputError(f"{path} does not exist: give the path of a bag.")
    rows: list[list[float]] = []
    spreads: list[Any] = []
    frames: set[str] = set()
    with _opened(path) as bag:
        if topic is None and ESTIMATE_TOPIC in bag.topics:
            topic = ESTIMATE_TOPIC
        asked = _topic(path, bag, tuple(POSES), "the topic in FILE:TOPIC", topic)
        chosen = [one for one in bag.connections if one.topic == asked]
        for connection, _, raw in bag.messages(connections=chosen):
            message = bag.deserialize(raw, connection.msgtype)
            rows.append(_row(connection.msgtype, message))
            frames.add(frame_name(message.header.frame_id))
            spreads.append(getattr(message.pose, "covariance", np.zeros(36)))
    _warn_of_frames(path, asked, frames)
    moments = np.array(spreads, np.float64).reshape(-1, 6, 6)[:, [[0], [1], [5]], [0, 1, 5]]
    moments[(moments == 0).all(axis=(1, 2))] = np.nan
    told = np.isfinite(moments).all(axis=(1, 2)).any()
    return _poses(np.array(rows).reshape(-1, 7)), moments if told else None


def _row(kind: str, message: Any) -> list[float]:
    """Return t, x, y, qx, qy, qz, qw of a message of ``POSES``."""
    pose = POSES[kind](message)
    at, turned = pose.position, pose.orientation
    time = _seconds(message.header.stamp)
    return [time, at.x, at.y, turned.x, turned.y, turned.z, turned.w]


def _warn_of_frames(path: Path, topic: str | None, frames: set[str]) -> None:
    """Warn of poses that are not in the map's frame, as the headers of their messages say."""
    if other := sorted(frames - {"", _MAP}):
        warnings.warn(
            f"the poses of {topic} in {path} are in frame {' and '.join(other)}, but are taken as "
            f"poses in {_MAP}: what lies between the frames, such as the drift of odometry, "
            f"counts as error, so give a topic of poses in {_MAP}.",
            LogWarning,
            stacklevel=3,
        )


class _Messages:
    """The messages of a bag that a log is made of."""

    def __init__(
        self, path: Path, scans: Sequence[str], odometry: str | None, reference: str | None
    ) -> None:
        self.path, self.odometry, self.reference = path, odometry, reference
        one = len(scans) == 1
        self.scanned = {
            topic: RawRecords(str(path) if one else f"{path} {topic}") for topic in scans
        }
        self.transforms = Transforms()
        self.unit = "m"
        self.moved: dict[str, list[list[float]]] = {}  # by frame: t, x, y, qx, qy, qz, qw
        self.truth: list[list[float]] = []
        self.frames: set[str] = set()  # that poses of the truth are in

    def read(self, bag: Any) -> None:
        """Read all messages needed; count those that cannot be decoded."""
        wanted = {*self.scanned, self.odometry, self.reference, UNIT_TOPIC}
        chosen = [
            one for one in bag.connections if one.topic in wanted or one.msgtype in _TRANSFORMS
        ]
        for connection, _, raw in bag.messages(connections=chosen):
            try:
                message = bag.deserialize(raw, connection.msgtype)
            except Exception:  # damaged bytes can raise anything
                first, *_ = self.scanned.values()
                self.scanned.get(connection.topic, first).damage[UNREADABLE] += 1
                continue
            self._take(connection, message)

    def _take(self, connection: Any, message: Any) -> None:
        if connection.msgtype in _TRANSFORMS:
            for one in message.transforms:
                self.transforms.add(_seconds(one.header.stamp), one)
        elif connection.topic == UNIT_TOPIC:
            self.unit = message.data
        elif connection.topic in self.scanned:
            names = "angle_min", "angle_increment", "range_min", "range_max"
            numbers = (float(getattr(message, name)) for name in names)
            same = (0.0 if math.isnan(one) else one for one in numbers)  # NaN is unlike NaN
            geometry = (frame_name(message.header.frame_id), *same)
            records = self.scanned[connection.topic]
            records.add(_seconds(message.header.stamp), (0, 0, 0), message.ranges, geometry)
        else:
            row = _row(connection.msgtype, message)
            if connection.topic == self.reference:
                self.truth.append(row)
                self.frames.add(frame_name(message.header.frame_id))
            if connection.topic == self.odometry:  # it may be both
                self.moved.setdefault(frame_name(message.child_frame_id), []).append(row)

    def log(
        self, base_frame: str | None, max_gap: float | None, max_range: float | None, apart: float
    ) -> Log:
        """Return the log of all messages read; scans of several topics at most ``apart`` s."""
        for topic, records in self.scanned.items():
            if len(records.times) > 1 and not any(records.times):
                raise InputError(
                    f"the headers of {topic} in {self.path} have no stamps (all are 0), so its "
                    "scans have no odometry: write the times of the scans into their headers."
                )
        if self.odometry is None:
            base, rows = self.transforms.odometry(self.path, base_frame)
        elif len(self.moved) < 2:  # its name may be wrong or missing
            (named, moved), *_ = self.moved.items() or [("", [])]
            base, rows = base_frame or named or _ROBOT, np.array(moved).reshape(-1, 7)
        else:
            one = base_frame or only_frame(self.moved, f"{self.odometry} in {self.path}")
            base = one_of("base_frame", one, self.moved)
            rows = np.array(self.moved[base])

        def scanner_of(beams: int, geometry: tuple[str, float, float, float, float]) -> Scanner:
            frame, start, step, least, most = geometry
            if not 0 < most <= LARGEST:  # of simulators and some drivers
                if max_range is None:
                    raise InputError(
                        f"range_max of its scans is {most:g}: give max_range, such as max_range=20."
                    )
                most = max_range
            own = start + step * np.arange(float(beams))
            mount = self.transforms.mounted(self.path, base, frame, beams)
            seen = mount.heading - own if mount.upside_down else mount.heading + own
            place: dict[str, Any] = {"mounts": (mount,)}
            if len(self.scanned) == 1:
                place = {"mounting": (mount.x, mount.y), "turn": mount.heading}
            angles = tuple(seen.tolist())
            return Scanner(angles=angles, min_range=least, max_range=most, **place)

        odometry = _poses(rows)
        scanned = {
            topic: _placed(records, odometry).log(scanner_of, unit=self.unit)
            for topic, records in self.scanned.items()
        }
        (log, *others) = scanned.values()
        if others:
            log = paired(scanned, str(self.path), apart)
        return with_own_reference(log, _poses(np.array(self.truth).reshape(-1, 7)), max_gap)


def _placed(records: RawRecords, odometry: Floats) -> RawRecords:
    """Return the records of scans with the odometry at their times, of those that have one."""
    odometry = odometry[np.isfinite(odometry).all(axis=1)]
    odometry = odometry[np.argsort(odometry[:, 0], kind="stable")]
    at, times = odometry[:, 0], np.array(records.times)
    known, poses = np.zeros(times.size, np.bool_), np.empty((times.size, 3))
    if len(odometry):
        after = np.clip(np.searchsorted(at, times), 0, at.size - 1)
        before = np.maximum(after - 1, 0)
        known = (times >= at[0]) & (times <= at[-1])
        known &= np.isin(times, at) | (at[after] - at[before] <= _GAP)
        poses = between(at, odometry[:, 1:], times)
    if lost := int((~known).sum()):
        records.damage[NO_ODOMETRY] += lost
    records.odometry = list(poses)
    return records.kept(np.flatnonzero(known).tolist())


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a bag; any error inside becomes an ``InputError``."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    if not path.is_dir():
        with opened_log(path):  # refuses a pipe, which rosbags would wait for
            pass
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            yield bag
    except InputError:
        raise
    except Exception as error:  # rosbags raises what it meets: struct, sqlite3, yaml, assertions
        said = str(error) or type(error).__name__
        raise InputError(
            f"{path} cannot be read as a ROS bag ({said}): is it whole, and was it closed?"
        ) from None


def _topic(
    path: Path,
    bag: Any,
    types: tuple[str, ...],
    argument: str,
    asked: str | None,
    *,
    needed: bool = True,
) -> str | None:
    """Return the topic asked for, or the only one of some types."""
    there = {one.topic: one.msgtype for one in bag.connections}
    fitting = sorted(topic for topic, kind in there.items() if kind in types)
    listed = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(there.items())) or "none"
    if asked is not None:
        if asked in fitting:
            return asked
        raise InputError(
            f"{argument} is {asked!r}, but must be a topic of type {' or '.join(types)}; those of "
            f"{path}: {listed}."
        )
    if len(fitting) > 1:
        raise InputError(
            f"{path} has {len(fitting)} topics of type {types[0]}, {', '.join(fitting)}: choose "
            f"one by {argument}{', or several' if argument == 'scan_topic' else ''}."
        )
    if not fitting and needed:
        raise InputError(f"{path} has no topic of type {types[0]}; its topics: {listed}.")
    return fitting[0] if fitting else None


def _seconds(stamp: Any) -> float:
    return (int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)) / 1e9


def _poses(rows: Floats) -> Floats:
    """Rows t, x, y, θ of rows t, x, y, qx, qy, qz, qw."""
    finite = np.isfinite(rows).all(axis=1)
    headings = np.full(len(rows), np.nan)
    headings[finite] = heading_of(rows[finite, 3:])
    return np.column_stack([rows[:, :3], headings])
