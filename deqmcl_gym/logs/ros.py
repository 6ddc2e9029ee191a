"""ROS 1 and ROS 2 bags, read by ``rosbags``, without ROS.

Transforms between the frames of a robot give the scanner's mounting and, if need be, the odometry.
"""

import math
import os
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from deqmcl_gym.files import opened_log
from deqmcl_gym.logs.log import Log, Scanner
from deqmcl_gym.logs.motion import heading_of
from deqmcl_gym.logs.raw_records import NO_ODOMETRY, UNREADABLE, RawRecords
from deqmcl_gym.logs.trajectory import with_own_reference
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import LARGEST, InputError, LogWarning, one_of

SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
POSES: dict[str, Callable[[Any], Any]] = {
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
    ODOMETRY: lambda message: message.pose.pose,
}
_TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
UNIT_TOPIC, REFERENCE_TOPIC = "/deqmcl_unit", "/reference"
ESTIMATE_TOPIC = "/amcl_pose"  # of Nav2's AMCL
_GAP = 1.0  # s without odometry beyond which the pose in between is unknown
_ODOMETRY_FRAME, _ROBOT = "odom", "base_link"
_UPRIGHT = 0.99  # cosine of the largest tilt that is ignored: 8°


class Transforms:
    """All transforms of a bag, from parent to child: static ones, and odometry."""

    def __init__(self) -> None:
        self._edges: dict[tuple[str, str], list[list[float]]] = {}

    def add(self, time: float, message: Any) -> None:
        """Add a TransformStamped of ROS; a row is t, x, y, z, qx, qy, qz, qw, all finite."""
        at, turned = message.transform.translation, message.transform.rotation
        edge = _name(message.header.frame_id), _name(message.child_frame_id)
        row = [time, at.x, at.y, at.z, turned.x, turned.y, turned.z, turned.w]
        known = self._edges.setdefault(edge, [])
        if np.isfinite(row).all() and np.linalg.norm(row[4:]) > 0:
            known.append(row)

    def odometry(self, path: Path, base_frame: str | None) -> tuple[str, Floats]:
        """Return the robot's frame and its poses in odom, rows t, x, y, qx, qy, qz, qw.

        Raises:
            InputError: there are none, or several frames move in odom.
        """
        found = {
            child: rows
            for (parent, child), rows in self._edges.items()
            if parent == _ODOMETRY_FRAME and rows and base_frame in (None, child)
        }
        # a dock may stand in odom, too
        moving = {name: rows for name, rows in found.items() if _still(rows) is None} or found
        if not moving:
            raise InputError(
                f"{path} has no odometry: give the topic of a {ODOMETRY} by odometry_topic; there "
                f"is no moving transform from the frame {_ODOMETRY_FRAME} either."
            )
        base = _only(moving, f"{_ODOMETRY_FRAME} in the transforms of {path}")
        return base, np.array(moving[base])[:, [0, 1, 2, 4, 5, 6, 7]]

    def mounted(self, path: Path, base: str, frame: str, angles: Floats) -> dict[str, Any]:
        """Return a scanner's angles against the robot's heading, its mounting (x, y) and turn.

        Raises:
            InputError: the scanner is tilted.
        """
        chain = self._chain(base, frame)
        if chain is None:
            broken = [" to ".join(edge) for edge, rows in self._edges.items() if not rows]
            why = f" (no finite one from {', '.join(broken)})" if broken else ""
            warnings.warn(
                f"{path} has no static transform from {base} to {frame}{why}: the scanner is "
                "assumed in the robot's centre, looking ahead; if it is not, give "
                "mounting=(x, y, turn).",
                LogWarning,
                stacklevel=2,
            )
            chain = np.eye(4)
        up = chain[2, 2]
        if abs(up) < _UPRIGHT:
            raise InputError(
                f"the scanner is tilted by {math.degrees(math.acos(up)):.0f}°, but must scan a "
                "level plane."
            )
        turn = math.atan2(chain[1, 0], chain[0, 0])
        seen = turn + math.copysign(1.0, up) * angles
        mounting = float(chain[0, 3]), float(chain[1, 3])
        return {"angles": tuple(seen.tolist()), "mounting": mounting, "turn": turn}

    def _chain(self, base: str, frame: str) -> Floats | None:
        """Return the transform from base to frame, 4 x 4; None without static ones between them."""
        steps: dict[str, list[tuple[str, Floats]]] = {}
        for (parent, child), rows in self._edges.items():
            there = _still(rows)
            if there is not None:
                steps.setdefault(parent, []).append((child, there))
                back = np.linalg.inv(there).astype(np.float64)
                steps.setdefault(child, []).append((parent, back))
        reached, queue = {base: np.eye(4)}, [base]
        for here in queue:
            for next_name, step in steps.get(here, ()):
                if next_name not in reached:
                    reached[next_name] = reached[here] @ step
                    queue.append(next_name)
        return reached.get(frame)


def _still(rows: list[list[float]]) -> Floats | None:
    """Return the 4 x 4 matrix of a transform that is the same in all of its rows, else None."""
    values = np.array(rows).reshape(-1, 8)[:, 1:]
    if not len(values):
        return None
    values[values[:, 3:] @ values[0, 3:] < 0, 3:] *= -1  # q and -q are the same turn
    return _matrix(values[0]) if np.ptp(values, axis=0).max() < 1e-6 else None


def _only(frames: Iterable[str], where: str) -> str:
    first, *others = sorted(frames)
    if others:
        said = ", ".join([first, *others])
        raise InputError(f"{where} has the poses of several frames, {said}: choose by base_frame.")
    return first


def _name(frame: str) -> str:
    return frame.lstrip("/")  # tf of ROS 1 wrote names with and without it


def _matrix(values: Floats) -> Floats:
    """Return the 4 x 4 matrix of x, y, z, qx, qy, qz, qw."""
    x, y, z, w = values[3:] / np.linalg.norm(values[3:])
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = values[:3]
    return matrix


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
    scan_topic: str | None = None,
    odometry_topic: str | None = None,
    reference_topic: str | None = None,
    base_frame: str | None = None,
    max_gap: float | None = None,
    max_range: float | None = None,
) -> Log:
    """Read a ROS bag; see ``logs.read``.

    A scan's time is that of its header; its odometry is interpolated between the two messages
    around it. Static transforms give the mounting of the scanner, which may hang upside down.

    Raises:
        InputError: the bag is missing or damaged, a topic is missing or has to be chosen, the
            scanner is tilted, or no record is usable.
    """
    require_rosbags()
    if not os.path.exists(path):
        raise InputError(f"{path} does not exist: give the path of a bag.")
    with _opened(path) as bag:
        scans = _topic(path, bag, (SCAN,), "scan_topic", scan_topic)
        assert scans is not None
        odometry = _topic(path, bag, (ODOMETRY,), "odometry_topic", odometry_topic, needed=False)
        if reference_topic is None and REFERENCE_TOPIC not in bag.topics:
            reference = None
        else:
            asked = reference_topic or REFERENCE_TOPIC
            reference = _topic(path, bag, tuple(POSES), "reference_topic", asked)
        messages = _Messages(path, scans, odometry, reference)
        messages.read(bag)
    return messages.log(None if base_frame is None else _name(base_frame), max_gap, max_range)


def read_pose_topic(path: Path, topic: str | None = None) -> tuple[Floats, Floats | None]:
    """Read the poses that a stack has published in a bag.

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
    with _opened(path) as bag:
        if topic is None and ESTIMATE_TOPIC in bag.topics:
            topic = ESTIMATE_TOPIC
        asked = _topic(path, bag, tuple(POSES), "the topic in FILE:TOPIC", topic)
        chosen = [one for one in bag.connections if one.topic == asked]
        for connection, _, raw in bag.messages(connections=chosen):
            message = bag.deserialize(raw, connection.msgtype)
            rows.append(_row(connection.msgtype, message))
            spreads.append(getattr(message.pose, "covariance", np.zeros(36)))
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


class _Messages:
    """The messages of a bag that a log is made of."""

    def __init__(self, path: Path, scans: str, odometry: str | None, reference: str | None) -> None:
        self.path, self.scans, self.odometry, self.reference = path, scans, odometry, reference
        self.scanned = RawRecords(str(path))
        self.transforms = Transforms()
        self.unit = "m"
        self.moved: dict[str, list[list[float]]] = {}  # by frame: t, x, y, qx, qy, qz, qw
        self.truth: list[list[float]] = []

    def read(self, bag: Any) -> None:
        """Read all messages needed; count those that cannot be decoded."""
        wanted = {self.scans, self.odometry, self.reference, UNIT_TOPIC}
        chosen = [
            one for one in bag.connections if one.topic in wanted or one.msgtype in _TRANSFORMS
        ]
        for connection, _, raw in bag.messages(connections=chosen):
            try:
                message = bag.deserialize(raw, connection.msgtype)
            except Exception:  # damaged bytes can raise anything
                self.scanned.damage[UNREADABLE] += 1
                continue
            self._take(connection, message)

    def _take(self, connection: Any, message: Any) -> None:
        if connection.msgtype in _TRANSFORMS:
            for one in message.transforms:
                self.transforms.add(_seconds(one.header.stamp), one)
        elif connection.topic == UNIT_TOPIC:
            self.unit = message.data
        elif connection.topic == self.scans:
            names = "angle_min", "angle_increment", "range_min", "range_max"
            numbers = (float(getattr(message, name)) for name in names)
            same = (0.0 if math.isnan(one) else one for one in numbers)  # NaN is unlike NaN
            geometry = (_name(message.header.frame_id), *same)
            self.scanned.add(_seconds(message.header.stamp), (0, 0, 0), message.ranges, geometry)
        else:
            row = _row(connection.msgtype, message)
            if connection.topic == self.reference:
                self.truth.append(row)
            if connection.topic == self.odometry:  # it may be both
                self.moved.setdefault(_name(message.child_frame_id), []).append(row)

    def log(self, base_frame: str | None, max_gap: float | None, max_range: float | None) -> Log:
        """Return the log of all messages read."""
        if len(self.scanned.times) > 1 and not any(self.scanned.times):
            raise InputError(
                f"the headers of {self.scans} in {self.path} have no stamps (all are 0), so its "
                "scans have no odometry: write the times of the scans into their headers."
            )
        if self.odometry is None:
            base, rows = self.transforms.odometry(self.path, base_frame)
        elif len(self.moved) < 2:  # its name may be wrong or missing
            (named, moved), *_ = self.moved.items() or [("", [])]
            base, rows = base_frame or named or _ROBOT, np.array(moved).reshape(-1, 7)
        else:
            one = base_frame or _only(self.moved, f"{self.odometry} in {self.path}")
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
            angles = start + step * np.arange(float(beams))
            mounted = self.transforms.mounted(self.path, base, frame, angles)
            return Scanner(**mounted, min_range=least, max_range=most)

        log = self._placed(_poses(rows)).log(scanner_of, unit=self.unit)
        return with_own_reference(log, _poses(np.array(self.truth).reshape(-1, 7)), max_gap)

    def _placed(self, odometry: Floats) -> RawRecords:
        """Return the records of scans with the odometry at their times, of those that have one."""
        odometry = odometry[np.isfinite(odometry).all(axis=1)]
        odometry = odometry[np.argsort(odometry[:, 0], kind="stable")]
        at, times = odometry[:, 0], np.array(self.scanned.times)
        known, poses = np.zeros(times.size, np.bool_), np.empty((times.size, 3))
        if len(odometry):
            after = np.clip(np.searchsorted(at, times), 0, at.size - 1)
            before = np.maximum(after - 1, 0)
            known = (times >= at[0]) & (times <= at[-1])
            known &= np.isin(times, at) | (at[after] - at[before] <= _GAP)
            x, y, heading = odometry[:, 1:].T
            columns = [np.interp(times, at, column) for column in (x, y, np.unwrap(heading))]
            poses = np.column_stack([*columns[:2], arrays.wrapped(columns[2])])
        if lost := int((~known).sum()):
            self.scanned.damage[NO_ODOMETRY] += lost
        self.scanned.odometry = list(poses)
        return self.scanned.kept(np.flatnonzero(known).tolist())


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
            f"one by {argument}."
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
