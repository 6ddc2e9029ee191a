"""Bags as robots of other people write them: their messages, by rosbags alone."""

import math

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
SCAN, ODOMETRY, TF = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"


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
    time, frame="laser", ranges=(1.0, 2.0, 3.0), farthest=10.0, nearest=0.1, first=-1.0, step=1.0
):
    values = np.ascontiguousarray(ranges, np.float32)
    return make(
        SCAN, header(time, frame), first, -first, step, 0.0, 0.0, nearest, farthest, values,
        np.empty(0, np.float32),
    )  # fmt: skip


def odometry(time, x, heading=0.0, frame="base_footprint", y=0.0):
    at = make("geometry_msgs/msg/Point", x, y, 0.0)
    pose = make("geometry_msgs/msg/Pose", at, quaternion(yaw=heading))
    still = make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
    twist = make("geometry_msgs/msg/Twist", still, still)
    posed = make("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36))
    driven = make("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36))
    return make(ODOMETRY, header(time, "odom"), frame, posed, driven)


def bag(path, *messages, plugin=StoragePlugin.SQLITE3, first=0):
    """Write messages (topic, type, message), received one after another from ``first`` ns on."""
    with Writer(path, version=8, storage_plugin=plugin) as writer:
        topics = {}
        for number, (topic, kind, message) in enumerate(messages, first):
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=STORE)
            if message is not None:
                writer.write(topics[topic], number, STORE.serialize_cdr(message, kind))
    return path
