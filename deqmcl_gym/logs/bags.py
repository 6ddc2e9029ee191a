"""ROS 1 and ROS 2 bags, opened by ``rosbags`` without ROS: topics, messages, poses of a topic.

On /tf a stack says how the map lies to the odometry, from ``map`` to ``odom``: its pose is that,
composed with the odometry at the same time.
"""

import heapq
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from deqmcl_gym.files import opened, refusing
from deqmcl_gym.logs import transforms as tf
from deqmcl_gym.logs.motion import composed
from deqmcl_gym.logs.odometry import JudgedOdometry
from deqmcl_gym.numerics import Floats
from deqmcl_gym.validation import InputError, like, tell

SCAN = "sensor_msgs/msg/LaserScan"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_REMEDIES = {".mcap": "mcap recover", ".bag": "rosbag reindex"}
_ESTIMATE = "/amcl_pose"  # of Nav2's AMCL


@dataclass(frozen=True)
class Bag:
    """The parts of a bag, whose messages come in the order of their receipt."""

    name: str  # in messages
    readers: Sequence[Any]  # one for each part

    @property
    def topics(self) -> Mapping[str, str]:
        """The type of each topic."""
        return {c.topic: c.msgtype for reader in self.readers for c in reader.connections}

    def messages(self, topics: set[str | None], kinds: Sequence[str] = ()) -> Iterator[tf.Sent]:
        """Yield the messages of some topics, and of some types."""

        def received(reader: Any) -> Iterator[tf.Sent]:
            chosen = [c for c in reader.connections if c.topic in topics or c.msgtype in kinds]
            publishers: dict[str, list[int]] = {}  # of each topic
            messages = reader.messages(connections=chosen) if chosen else ()  # [] would mean all
            for connection, moment, raw in messages:
                topic, kind = connection.topic, connection.msgtype
                ids = publishers.setdefault(topic, [])
                if connection.id not in ids:
                    ids.append(connection.id)
                decoded = partial(reader.deserialize, raw, kind)
                yield tf.Sent(0, moment / 1e9, ids.index(connection.id), topic, kind, decoded)

        parts = map(received, self.readers)
        for number, sent in enumerate(heapq.merge(*parts, key=lambda message: message.received)):
            yield sent._replace(number=number)

    def topic(
        self,
        types: Sequence[str],
        argument: str,
        asked: str | None,
        *,
        beside: str | None = None,
        needed: bool = True,
    ) -> str | None:
        """Return the topic asked for, or the only one of some types; None if it is not ``needed``.

        Of several it is the one whose namespace is most like that of ``beside``, of the same robot.
        ``argument`` is what users choose it by.
        """
        fitting = sorted(topic for topic, kind in self.topics.items() if kind in types)
        sent = {c.topic for reader in self.readers for c in reader.connections if c.msgcount}
        fitting = [topic for topic in fitting if topic in sent] or fitting  # their driver ran
        listed = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(self.topics.items()))
        if asked is not None:
            if self.topics.get(asked) in types:
                return asked
            raise InputError(
                f"{argument} is {asked!r}, but must be a topic of type {' or '.join(types)}; those "
                f"of {self.name}: {listed or 'none'}."
            )
        if len(fitting) > 1 and beside is not None:
            alike = [len(os.path.commonpath([beside, topic])) for topic in fitting]
            fitting = [topic for topic, n in zip(fitting, alike, strict=True) if n == max(alike)]
        if len(fitting) > 1:
            raise InputError(
                f"{self.name} has {len(fitting)} topics of type {types[0]}, {', '.join(fitting)}: "
                f"choose {'one or several' if argument == 'scan_topic' else 'one'} by {argument}"
                f"{like(argument, fitting[0]) if argument.endswith('_topic') else ''}."
            )
        if not fitting and needed:
            raise InputError(
                f"{self.name} has no topic of type {types[0]}; its topics: {listed or 'none'}."
            )
        return fitting[0] if fitting else None


@contextmanager
def opened_bag(paths: Sequence[Path]) -> Iterator[Bag]:
    """Open the parts of a bag; any error inside becomes an ``InputError``."""
    try:
        import rosbags.highlevel  # noqa: F401
    except ModuleNotFoundError:
        raise InputError(
            'ROS bags need rosbags, which is not installed: pip install "deqmcl-gym[ros]".'
        ) from None
    at, *others = paths
    name = f"{at} and {len(others)} more" if others else str(at)
    try:
        with ExitStack() as stack:
            readers = []
            for at in paths:
                readers.append(stack.enter_context(_reader(at)))
            yield Bag(name, readers)
    except InputError:
        raise
    except Exception as error:  # rosbags raises what it meets: struct, sqlite3, yaml, assertions
        why = str(error) or type(error).__name__
        remedy = _REMEDIES.get(at.suffix.lower(), "ros2 bag reindex")
        raise InputError(
            f"{at} cannot be read as a ROS bag ({why}): if it was cut, or not closed, mend it by "
            f"{remedy}."
        ) from None


def _reader(path: Path) -> Any:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    if not os.path.exists(path):
        raise InputError(f"{path} does not exist: give the path of a bag.")
    if path.is_dir() and not (path / "metadata.yaml").exists():
        raise InputError(f"{path} has no metadata.yaml: give the .mcap or .db3 files in it.")
    if not path.is_dir():
        with refusing(path), opened(path):  # refuses a pipe, which rosbags would wait for
            pass
    return AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))


def warn_of_frames(name: str, topic: str | None, frames: set[str]) -> None:
    """Warn of poses that are not in the map's frame, as the headers of their messages say."""
    if other := sorted(frames - {"", tf.MAP_FRAME}):
        tell(
            f"the poses of {topic} in {name} are in frame {' and '.join(other)}, but are taken as "
            f"poses in {tf.MAP_FRAME}: what lies between the frames, such as the drift of "
            f"odometry, counts as error, so give a topic of poses in {tf.MAP_FRAME}."
        )


def poses_of_topic(path: Path, topic: str | None) -> tuple[Floats, Floats | None]:
    """Return rows t, x, y, θ that a stack has published in a bag, and covariances if any."""
    poses, spreads = tf.PoseRows(), list[Any]()
    with opened_bag([path]) as bag:
        chosen = _chosen(bag, topic)
        if bag.topics[chosen] in TRANSFORMS:
            return _composed(bag, chosen), None
        for sent in bag.messages({chosen}):
            message = sent.decoded()
            poses.add(sent, message)
            spreads.append(getattr(message.pose, "covariance", np.zeros(36)))
    warn_of_frames(str(path), chosen, poses.frames)
    moments = np.array(spreads, np.float64).reshape(-1, 6, 6)[:, [[0], [1], [5]], [0, 1, 5]]
    moments[(moments == 0).all(axis=(1, 2))] = np.nan
    known = np.isfinite(moments).all(axis=(1, 2)).any()
    return poses.poses, moments if known else None


def _chosen(bag: Bag, asked: str | None) -> str:
    """Return the topic of poses asked for, or the one that a stack's pose is on."""
    kinds = [*tf.POSE_TYPES, *TRANSFORMS]
    if asked is None:
        if _ESTIMATE in bag.topics:
            return _ESTIMATE
        estimates = [kind for kind in tf.POSE_TYPES if kind != tf.ODOMETRY]
        if any(kind in estimates for kind in bag.topics.values()):
            kinds = estimates
        else:
            for topic in sorted(topic for topic, kind in bag.topics.items() if kind in TRANSFORMS):
                if _frames_of(bag, topic).in_map:
                    return topic
    chosen = bag.topic(kinds, "the topic in FILE:TOPIC", asked)
    assert chosen is not None  # as it is needed
    return chosen


def _frames_of(bag: Bag, topic: str) -> tf.Frames:
    """Return the frames of the robot that a topic is of."""
    transforms = tf.Transforms()
    for sent in bag.messages(set(), TRANSFORMS):
        transforms.add(sent, sent.decoded())
    return transforms.of(topic)


def _composed(bag: Bag, topic: str) -> Floats:
    """Return rows t, x, y, θ of the robot in the map, (n, 4), by a topic of transforms."""
    frames = _frames_of(bag, topic)
    if len(frames.in_map) != 1:
        raise InputError(
            f"{bag.name}:{topic} has transforms from {tf.MAP_FRAME} to {len(frames.in_map)} "
            "frames, but must have one, as odom: give a topic of poses."
        )
    ((child, rows),) = frames.in_map.items()
    origins, odometry = rows.poses, tf.PoseRows()
    if any(parent == child for parent, _ in frames.moving):
        _, odometry = frames.odometry(bag.name, None, child, "")
    elif tf.ODOMETRY in bag.topics.values():
        for sent in bag.messages({bag.topic((tf.ODOMETRY,), "odometry_topic", None, beside=topic)}):
            message = sent.decoded()
            if tf.frame_name(message.header.frame_id) in (child, ""):
                odometry.add(sent, message)
    if not odometry.rows:
        return origins  # the robot itself
    table = odometry.table
    judged = JudgedOdometry.of(table[:, 0], table[:, 1], odometry.poses, "m")
    placed = [judged.at(*moment) for moment in zip(rows.table[:, 0], origins[:, 0], strict=True)]
    known = np.array([pair is not None for pair in placed])
    poses = np.array([pair[1] for pair in placed if pair is not None]).reshape(-1, 3)
    return np.column_stack([origins[known, 0], composed(origins[known, 1:], poses)])
