"""Logs as robots of other people write them: bags by rosbags alone, CARMEN's lines."""

import gzip
import math
import shutil

import numpy as np
from rosbags import rosbag1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from deqmcl_gym import logs
from deqmcl_gym.logs.motion import composed, dead_reckoned

STORE = get_typestore(Stores.ROS2_HUMBLE)
SCAN, ODOMETRY, TF = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
POSE, WORDS = "geometry_msgs/msg/PoseStamped", "std_msgs/msg/String"


def make(kind, *values):
    return STORE.types[kind](*values)


def header(time, frame):
    stamp = make("builtin_interfaces/msg/Time", int(time), round(time % 1 * 1e9))
    return make("std_msgs/msg/Header", stamp, frame)


def quaternion(roll=0.0, yaw=0.0):
    half = roll / 2, yaw / 2
    (sr, sy), (cr, cy) = map(math.sin, half), map(math.cos, half)
    return make("geometry_msgs/msg/Quaternion", sr * cy, sr * sy, cr * sy, cr * cy)


def transform(parent, child, x, y, roll=0.0, yaw=0.0, time=0.0, turned=None):
    offset = make("geometry_msgs/msg/Vector3", x, y, 0.3)
    moved = make("geometry_msgs/msg/Transform", offset, turned or quaternion(roll, yaw))
    one = make("geometry_msgs/msg/TransformStamped", header(time, parent), child, moved)
    return make(TF, [one])


def scan(
    time, frame="laser", ranges=(1.0, 2.0, 3.0), farthest=10.0, nearest=0.1, first=-1.0, step=1.0,
    last=None,
):  # fmt: skip
    values = np.ascontiguousarray(ranges, np.float32)
    return make(
        SCAN, header(time, frame), first, -first if last is None else last, step, 0.0, 0.0,
        nearest, farthest, values, np.empty(0, np.float32),
    )  # fmt: skip


def odometry(time, x, heading=0.0, frame="base_footprint", y=0.0):
    at = make("geometry_msgs/msg/Point", x, y, 0.0)
    pose = make("geometry_msgs/msg/Pose", at, quaternion(yaw=heading))
    still = make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
    twist = make("geometry_msgs/msg/Twist", still, still)
    posed = make("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36))
    driven = make("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36))
    return make(ODOMETRY, header(time, "odom"), frame, posed, driven)


def driven(n=41, step=0.02, turn=0.01):
    """Poses of a drive, 0.1 s apart: times and (n, 3)."""
    moves = np.column_stack([np.full(n - 1, step), np.full(n - 1, turn)])
    return 0.1 * np.arange(n), dead_reckoned(moves, (2.0, 1.0, 0.3))


def moving(times, poses, **said):
    posed = zip(times, poses, strict=True)
    return [("/odom", ODOMETRY, odometry(t, x, turn, y=y, **said)) for t, (x, y, turn) in posed]


def scanning(times, topic="/scan", **said):
    return [(topic, SCAN, scan(t, **said)) for t in times]


def by_tf(times, poses, parent="odom", base="base_footprint", topic="/tf"):
    posed = zip(times, poses, strict=True)
    return [(topic, TF, transform(parent, base, x, y, yaw=a, time=t)) for t, (x, y, a) in posed]


def bag(path, *messages, plugin=StoragePlugin.SQLITE3, first=0):
    """Write messages (topic, type, message), received one after another from ``first`` ns on."""
    sent = [(topic, kind, at, one) for at, (topic, kind, one) in enumerate(messages, first)]
    with Writer(path, version=8, storage_plugin=plugin) as writer:
        _send(writer, STORE, sent, STORE.serialize_cdr)
    return path


def written(log, path):
    """Write a log; the ending of the name determines the format. Returns the path."""
    name = path.name.removesuffix(".gz")
    if name.endswith((".csv", ".npz")):
        logs.write(log, path)
    elif name.endswith(".log"):
        text = "\n".join(["# a robot's log", *carmen(log), ""]).encode()
        path.write_bytes(gzip.compress(text) if path.suffix == ".gz" else text)
    elif path.suffix == ".bag":
        _written_in_ros1(path, messages(log))
    else:
        _written_in_ros2(path, messages(log))
    return path


def carmen(log):
    """The lines of a log, as former versions of ours wrote them, all digits."""
    scanner = log.scanner
    mounts = composed(log.odometry, np.array([*scanner.mounting, 0.0])).tolist()
    step = spacing(scanner.angles)
    head = f"0 {scanner.angles[0]!r} {step * scanner.beams!r} {step!r} {scanner.max_range!r} 0.01 0"
    yield f"PARAM deqmcl_scanner {scanner.json} 0 nohost 0"
    yield f"PARAM deqmcl_unit {log.unit} 0 nohost 0"
    for record, mount in zip(log, mounts, strict=True):
        at, laser = (" ".join(map(repr, pose)) for pose in (record.odometry, mount))
        stamp = f"{record.time!r} nohost {record.time!r}"
        ranges = np.nan_to_num(record.ranges, nan=0.0, posinf=scanner.max_range).tolist()
        if record.reference is not None:
            yield f"TRUEPOS {' '.join(map(repr, record.reference))} {at} {stamp}"
        seen = f"{head} {len(ranges)} {' '.join(map(str, ranges))} 0"
        yield f"ROBOTLASER1 {seen} {laser} {at} 0 0 0 0 0 {stamp}"


def messages(log):
    """The messages of a log: topic, type, time in ns, message."""
    times = np.round(log.times * 1e9).astype(np.int64).tolist()
    scanner = log.scanner
    angles = np.unwrap(scanner.angles) - scanner.turn
    there = transform("base", "laser", *scanner.mounting, yaw=scanner.turn)
    yield "/tf_static", TF, times[0], there
    if log.unit != "m":
        yield "/deqmcl_unit", WORDS, times[0], make(WORDS, log.unit)
    for time, record in zip(times, log, strict=True):
        x, y, heading = record.odometry
        yield "/odom", ODOMETRY, time, stamped(odometry(0, x, heading, "base", y), time)
        if record.reference is not None:
            x, y, heading = record.reference
            pose = odometry(0, x, heading, y=y).pose.pose
            yield "/reference", POSE, time, stamped(make(POSE, header(0, "map"), pose), time)
        limits = scanner.max_range, scanner.min_range
        seen = scan(0, "laser", record.ranges, *limits, angles[0], spacing(angles), angles[-1])
        yield "/scan", SCAN, time, stamped(seen, time)


def spacing(angles):
    return (angles[-1] - angles[0]) / max(len(angles) - 1, 1)


def stamped(message, time):
    message.header.stamp = make("builtin_interfaces/msg/Time", *divmod(time, 10**9))
    return message


def _written_in_ros2(path, sent):
    folder = path.with_name("draft") if path.suffix else path
    plugin = StoragePlugin.MCAP if path.suffix else StoragePlugin.SQLITE3
    with Writer(folder, version=8, storage_plugin=plugin) as writer:
        _send(writer, STORE, sent, STORE.serialize_cdr)
    if path.suffix:
        next(folder.glob("*.mcap")).rename(path)
        shutil.rmtree(folder)


def _written_in_ros1(path, sent):
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))

    def encode(message, kind):
        return store.serialize_ros1(_of_ros1(message, store), kind)

    with rosbag1.Writer(path) as writer:
        _send(writer, store, sent, encode)


def _send(writer, store, sent, encode):
    topics = {}
    for topic, kind, time, message in sent:
        if topic not in topics:
            topics[topic] = writer.add_connection(topic, kind, typestore=store)
        if message is not None:
            writer.write(topics[topic], time, encode(message, kind))


def _of_ros1(value, store):
    """A message of ROS 2 as one of ROS 1, whose headers have a number, too."""
    if isinstance(value, list):
        return [_of_ros1(one, store) for one in value]
    kind = getattr(value, "__msgtype__", None)
    if kind is None:
        return value
    parts = {name: _of_ros1(getattr(value, name), store) for name in value.__dataclass_fields__}
    parts.pop("__msgtype__", None)
    own = {"seq": 0} if kind == "std_msgs/msg/Header" else {}
    return store.types[kind](**own, **parts)
