"""Logs as ROS bags, written by ``rosbags``: /scan, /odom, /tf_static, /reference if there is one.

The scans of several lidars are /scan_1, /scan_2 and so on, from the frames laser_1, laser_2.
ROS lengths are metres. A log in px has an additional topic with its unit, so that it is read back
as it was.
"""

import math
import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deqmcl_gym.logs.bags import SCAN, require_rosbags
from deqmcl_gym.logs.log import Log, Scanner
from deqmcl_gym.logs.ros import REFERENCE_TOPIC, UNIT_TOPIC
from deqmcl_gym.logs.transforms import ODOMETRY
from deqmcl_gym.numerics.types import Pose
from deqmcl_gym.validation import InputError

_TRANSFORMS, _POSE = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PoseStamped"
_WORDS = "std_msgs/msg/String"
_LAST = 2**31 - 1  # s: the seconds of a ROS 2 stamp are int32


def write_bag(log: Log, path: Path) -> None:
    """Write a log as .bag (ROS 1), .mcap (ROS 2), or a folder of a ROS 2 bag (sqlite3).

    Raises:
        InputError: beams that are not evenly spaced, times that ROS cannot hold, or a path that
            cannot be written.
    """
    require_rosbags()
    if any(one.spacing is None for one in log.scanner.parts):
        raise InputError(
            "beams of a ROS bag must be evenly spaced, but those of this log are not: write .csv "
            "or .npz."
        )
    if not 0 <= log.times[0] <= log.times[-1] < _LAST:
        raise InputError(
            f"the log is from {log.times[0]:g} s to {log.times[-1]:g} s, but times in ROS are from "
            f"0 to {_LAST:,} s: shift its times."
        )
    if os.path.isdir(path):
        raise InputError(f"{path} is an existing folder: give another path.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            draft = Path(folder) / "bag"
            _write(log, draft, path.suffix.lower())
            made = next(draft.glob("*.mcap")) if path.suffix.lower() == ".mcap" else draft
            if made.is_dir():
                shutil.move(made, path)
            else:
                os.replace(made, path)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror}): give another path."
        ) from None


def _write(log: Log, draft: Path, ending: str) -> None:
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    first = ending == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    if _TRANSFORMS not in store.types:  # the types of ROS 1 lack tf2
        listed = "geometry_msgs/TransformStamped[] transforms"
        store.register(get_types_from_msg(listed, _TRANSFORMS))
    plugin = StoragePlugin.MCAP if ending == ".mcap" else StoragePlugin.SQLITE3
    writer: Any = Writer1(draft) if first else Writer2(draft, version=8, storage_plugin=plugin)
    encode = store.serialize_ros1 if first else store.serialize_cdr
    with writer:
        topics: dict[str, Any] = {}

        def send(topic: str, kind: str, time: int, message: Any) -> None:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(topics[topic], time, encode(message, kind))

        _Messages(log, store.types, send, sequenced=first).send_all()


@dataclass(frozen=True)
class _Messages:
    """The messages of a log, of ``types``; headers are ``sequenced`` in ROS 1."""

    log: Log
    types: Any
    send: Callable[[str, str, int, Any], None]
    sequenced: bool

    def send_all(self) -> None:
        """Send the mounting and the unit, then each record."""
        log, scanners = self.log, _placed(self.log.scanner)
        times = np.round(log.times * 1e9).astype(np.int64).tolist()
        make = self._make
        header, fixed = self._header(times[0], "base_link"), []
        for scanner, _, _, frame in scanners:
            place = make("geometry_msgs/msg/Vector3", *scanner.mounting, 0.0)
            there = make("geometry_msgs/msg/Transform", place, self._turned(scanner.turn))
            fixed.append(make("geometry_msgs/msg/TransformStamped", header, frame, there))
        self.send("/tf_static", _TRANSFORMS, times[0], make(_TRANSFORMS, fixed))
        if log.unit != "m":
            self.send(UNIT_TOPIC, _WORDS, times[0], make(_WORDS, log.unit))
        nothing, still = np.zeros(36), make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        moving = make("geometry_msgs/msg/Twist", still, still)
        twist = make("geometry_msgs/msg/TwistWithCovariance", moving, nothing)
        for time, record in zip(times, log, strict=True):
            at = self._pose(record.odometry)
            pose = make("geometry_msgs/msg/PoseWithCovariance", at, nothing)
            header = self._header(time, "odom")
            self.send("/odom", ODOMETRY, time, make(ODOMETRY, header, "base_link", pose, twist))
            if record.reference is not None:
                stamped = make(_POSE, self._header(time, "map"), self._pose(record.reference))
                self.send(REFERENCE_TOPIC, _POSE, time, stamped)
            for scanner, rows, topic, frame in scanners:
                ends = scanner.angles[0] - scanner.turn, scanner.angles[-1] - scanner.turn
                scan = make(
                    SCAN, self._header(time, frame), *ends, scanner.spacing or 0.0, 0.0, 0.0,
                    scanner.min_range, scanner.max_range, np.array(record.ranges[rows]),
                    np.empty(0, np.float32),
                )  # fmt: skip
                self.send(topic, SCAN, time, scan)

    def _make(self, kind: str, *values: Any) -> Any:
        return self.types[kind](*values)

    def _header(self, time: int, frame: str) -> Any:
        stamp = self._make("builtin_interfaces/msg/Time", *divmod(time, 1_000_000_000))
        sequence = (0,) if self.sequenced else ()
        return self._make("std_msgs/msg/Header", *sequence, stamp, frame)

    def _pose(self, pose: Pose) -> Any:
        x, y, heading = pose
        at = self._make("geometry_msgs/msg/Point", x, y, 0.0)
        return self._make("geometry_msgs/msg/Pose", at, self._turned(heading))

    def _turned(self, heading: float) -> Any:
        half = heading / 2
        return self._make("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(half), math.cos(half))


def _placed(scanner: Scanner) -> list[tuple[Scanner, slice, str, str]]:
    """Return the scanner of each place, its rows of the ranges, its topic and its frame."""
    ends = [f"_{number}" for number, _ in enumerate(scanner.mounts, 1)] or [""]
    return [
        (part, rows, f"/scan{end}", f"laser{end}")
        for part, rows, end in zip(scanner.parts, scanner.rows, ends, strict=True)
    ]
