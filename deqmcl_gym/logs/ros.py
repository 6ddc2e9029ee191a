"""Logs in ROS 1 and ROS 2 bags: scans, odometry, the places of the scanners, a reference.

Transforms between the frames of a robot give the scanner's mounting and, if need be, the odometry.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from deqmcl_gym.logs import transforms as tf
from deqmcl_gym.logs.bags import SCAN, TRANSFORMS, Bag, opened_bag, warn_of_frames
from deqmcl_gym.logs.log import Log, Scanner
from deqmcl_gym.logs.odometry import JudgedOdometry, publisher_words, publishers
from deqmcl_gym.logs.raw_records import UNREADABLE, RawRecord, RawRecords, paired_scans, stamped
from deqmcl_gym.logs.scans import Fan
from deqmcl_gym.logs.trajectory import with_own_reference
from deqmcl_gym.validation import InputError, integer, like, number, one_of, shown, tell

UNIT_TOPIC, REFERENCE_TOPIC = "/deqmcl_unit", "/reference"
_ROBOT = "base_link"
_SHORTEST = 1e-12  # square of the length of a quaternion
_ALIKE = 0.05  # share of an increment
_RECORD = "record an Odometry topic or /tf with the stamps and the clock of the scans"


def read_bag(
    paths: Sequence[Path],
    *,
    scan_topic: str | Sequence[str] | None = None,
    odometry_topic: str | None = None,
    odometry_frame: str | None = None,
    odometry_publisher: int | None = None,
    reference_topic: str | None = None,
    base_frame: str | None = None,
    max_range: float | None = None,
    max_apart: float | None = None,
    max_gap: float | None = None,
    reference_tolerance: float | None = None,
) -> Log:
    """Read the parts of a ROS bag; see ``logs.read``.

    A scan's time is that of its header; its odometry is interpolated between the two messages
    around it. Transforms give the mounting of the scanner, which may hang upside down. Scans of
    several topics are ``paired_scans``.
    """
    asked = _scan_topics(scan_topic)
    if max_apart is not None:
        number("max_apart", max_apart, low=0)
        if len(asked) < 2:
            raise InputError("max_apart is given, but pairs the scans of 2 scan topics or more.")
    with opened_bag(paths) as bag:
        scans = [topic for name in asked if (topic := bag.topic((SCAN,), "scan_topic", name))]
        odometry = bag.topic(
            (tf.ODOMETRY,), "odometry_topic", odometry_topic, beside=scans[0], needed=False
        )
        if reference_topic is None and REFERENCE_TOPIC in bag.topics:
            reference_topic = REFERENCE_TOPIC
        if reference_topic is not None:
            bag.topic(tuple(tf.POSE_TYPES), "reference_topic", reference_topic)  # or it is refused
        of_topic = odometry if odometry_frame is None else None
        names = {topic: bag.name if len(scans) == 1 else f"{bag.name} {topic}" for topic in scans}
        scanned = {topic: RawRecords(name) for topic, name in names.items()}
        messages = _Messages(bag.name, scanned, of_topic, reference_topic)
        messages.read(bag)
    warn_of_frames(messages.name, reference_topic, messages.truth.frames)
    base, moved = messages.moved_by(base_frame, odometry_frame, odometry_publisher)
    log = messages.log(base, moved, max_range, 0.1 if max_apart is None else max_apart)
    truth = messages.truth.poses
    truth[:, 0] = moved.shifted(messages.truth.table[:, 0], truth[:, 0])
    return with_own_reference(log, truth, max_gap, reference_tolerance)


def _scan_topics(given: str | Sequence[str] | None) -> Sequence[str | None]:
    """Return the topics asked for, or None for the only one."""
    if given is None or isinstance(given, str):
        return [given]
    several = isinstance(given, list | tuple) and len(set(map(str, given))) == len(given) > 0
    if not several or not all(isinstance(topic, str) for topic in given):
        raise InputError(
            f"scan_topic is {shown(given)}, but must be a topic or several different ones."
        )
    return given


@dataclass
class _Messages:
    """The messages of a bag that a log is made of."""

    name: str
    scanned: dict[str, RawRecords]  # by topic
    odometry: str | None  # topics
    reference: str | None
    moved: dict[str, tf.PoseRows] = field(default_factory=dict)  # by frame
    truth: tf.PoseRows = field(default_factory=tf.PoseRows)
    transforms: tf.Transforms = field(default_factory=tf.Transforms)
    unit: str = "m"
    mended: int = 0  # scans whose increment is of no use

    def read(self, bag: Bag) -> None:
        """Read all messages needed; count those that cannot be decoded; refuse unstamped scans."""
        wanted = {*self.scanned, self.odometry, self.reference, UNIT_TOPIC}
        for sent in bag.messages(wanted, TRANSFORMS):
            try:
                message = sent.decoded()
            except Exception:  # damaged bytes can raise anything
                first, *_ = self.scanned.values()
                self.scanned.get(sent.topic, first).damage[UNREADABLE] += 1
                continue
            self._take(sent, message)
        for topic, scans in self.scanned.items():
            if len(scans.times) > 1 and not any(scans.times):
                raise InputError(
                    f"the headers of {topic} in {self.name} have no stamps (all are 0), so its "
                    "scans have no odometry: write the times of the scans into their headers."
                )
        if self.mended:
            self._tell(
                f"{self.mended:,} scans have an angle_increment that does not lead to their "
                "angle_max: it is taken from angle_max"
            )

    def _take(self, sent: tf.Sent, message: Any) -> None:
        if sent.kind in TRANSFORMS:
            self.transforms.add(sent, message)
        elif sent.topic == UNIT_TOPIC:
            self.unit = message.data
        elif (scans := self.scanned.get(sent.topic)) is not None:
            least, most = float(message.range_min), float(message.range_max)
            limits = least if least > 0 else 0.0, 0.0 if math.isnan(most) else most
            fan = Fan(float(message.angle_min), self._increment(message), *limits)
            header = message.header
            stamp, frame = tf.seconds_of(header.stamp), tf.frame_name(header.frame_id)
            record = RawRecord(stamp, (0, 0, 0), message.ranges, fan, frame, number=sent.number)
            scans.records.append(record)
        else:
            if sent.topic == self.reference:
                self.truth.add(sent, message)
            if sent.topic == self.odometry:  # it may be both
                child = tf.frame_name(message.child_frame_id)
                self.moved.setdefault(child, tf.PoseRows()).add(sent, message)

    def _increment(self, message: Any) -> float:
        """Return the increment of a scan's angles; by the last angle, if it is 0 or negated."""
        start, end, step = message.angle_min, message.angle_max, float(message.angle_increment)
        size = len(message.ranges)
        if size < 2 or not np.isfinite([start, end]).all() or start == end:
            return step
        meant = (float(end) - float(start)) / (size - 1)
        negative = abs(step + meant) <= _ALIKE * abs(meant)
        if np.isfinite(step) and step != 0 and not negative:
            return step  # many drivers do not fill in the last angle
        self.mended += 1
        return meant

    def log(
        self, base: str, odometry: JudgedOdometry, max_range: float | None, max_apart: float
    ) -> Log:
        """Return the log of all messages; scans of one record are at most ``max_apart`` s apart."""

        def scanner_of(topic: str, beams: int, frame: str, fan: Fan | None) -> Scanner:
            assert fan is not None
            most = fan.max_range if fan.limited else max_range  # of simulators and some drivers
            if most is None:
                fans = [record.fan for record in self.scanned[topic].records]
                largest = max(fan.max_range for fan in fans if fan)
                raise InputError(
                    f"range_max of its scans is {largest:g}: give max_range{like('max_range', 20)}."
                )
            fan_angles = fan.angles(beams)
            mount = self.transforms.of(topic).mounted(self.name, base, frame, beams)
            seen = mount.heading - fan_angles if mount.upside_down else mount.heading + fan_angles
            place: dict[str, Any] = {"mounts": (mount,)}
            if len(self.scanned) == 1:
                place = {"mounting": (mount.x, mount.y), "turn": mount.heading}
            angles = tuple(seen.tolist())
            return Scanner(angles=angles, min_range=fan.min_range, max_range=most, **place)

        scanned = {
            topic: scans.with_odometry(odometry).log(partial(scanner_of, topic), unit=self.unit)
            for topic, scans in self.scanned.items()
        }
        if len(scanned) == 1:
            return scanned.popitem()[1]
        return paired_scans(scanned, self.name, max_apart)

    def moved_by(
        self, base_frame: str | None, odometry_frame: str | None, publisher: int | None
    ) -> tuple[str, JudgedOdometry]:
        """Return the robot's frame and odometry, judged: of the topic, or else of transforms."""
        (topic, scans), *_ = self.scanned.items()
        frames = self.transforms.of(topic)
        asked = None if base_frame is None else tf.frame_name(base_frame)
        scan_frame = scans.records[0].frame if scans.records else ""
        flaw = None
        if self.moved:
            named = next(iter(self.moved))  # which may be wrong or missing
            if len(self.moved) > 1:
                named = asked or tf.only_frame(self.moved, f"{self.odometry} in {self.name}")
                one_of("base_frame", named, self.moved)
            rows, base = self.moved[named], asked or named or _ROBOT
            flaw = _flaw(rows, str(self.odometry), scans.times)
            doubt = self._doubt(rows)
            if flaw is None and (doubt is None or not frames.has_odometry):
                if doubt is not None:
                    self._tell(f"{doubt}: taken as odometry, as there is no other")
                return base, self._judged(rows, str(self.odometry), publisher)
            flaw = flaw or doubt
        elif self.odometry is not None:
            flaw = f"{self.odometry} has no message"
        try:
            base, rows = frames.odometry(self.name, asked, odometry_frame, scan_frame)
        except InputError:
            if flaw is None or odometry_frame is not None:
                raise
            raise InputError(f"{self.name} has no usable odometry: {flaw}; {_RECORD}.") from None
        if worse := _flaw(rows, "the transforms", scans.times):
            raise InputError(f"{self.name} has no usable odometry: {flaw or worse}; {_RECORD}.")
        if flaw is not None:
            self._tell(f"{flaw}: the odometry is taken from transforms")
        return base, self._judged(rows, "the transforms", publisher)

    def _tell(self, remark: str) -> None:
        tell(f"{self.name}: {remark}.")

    def _doubt(self, moved: tf.PoseRows) -> str | None:
        """Say why poses on a topic of odometry may be none; None if they look like it."""
        if frames := sorted(moved.frames & {tf.MAP_FRAME, "world"}):
            whose = "as an estimate or the truth"
            return f"the poses of {self.odometry} are in frame {frames[0]}, {whose}"
        rows = moved.poses[np.isfinite(moved.poses).all(axis=1)]
        if len(rows) < 2:
            return None
        gone, turned = np.ptp(rows[:, 1:3], axis=0).max(), np.ptp(rows[:, 3])
        if turned == 0 and gone > 1:
            return f"the quaternions of {self.odometry} are all the same"
        if gone == 0 and turned > 1:
            return f"the positions of {self.odometry} are all the same"
        return None

    def _judged(self, moved: tf.PoseRows, where: str, publisher: int | None) -> JudgedOdometry:
        """Return odometry, judged, of one publisher; tell what is not as usual."""
        table, rows = moved.table, stamped(moved.poses)
        finite = np.flatnonzero(np.isfinite(rows).all(axis=1))
        by_publisher = publishers(rows[finite, 0], rows[finite, 1:], table[finite, 2], self.unit)
        chosen = integer("odometry_publisher", publisher or 1, low=1, high=len(by_publisher))
        if len(by_publisher) > 1:
            each = enumerate((rows[finite[messages]] for messages in by_publisher), 1)
            listed = "; ".join(f"{n}: {publisher_words(part)}" for n, part in each)
            self._tell(
                f"{len(by_publisher)} publishers send odometry on {where} ({listed}): "
                f"{chosen} is taken, choose another by odometry_publisher"
                f"{like('odometry_publisher', 1 + chosen % len(by_publisher))}"
            )
            indices = finite[by_publisher[chosen - 1]]
            table, rows = table[indices], rows[indices]
        judged = JudgedOdometry.of(table[:, 0], table[:, 1], rows, self.unit)
        for remark in judged.remarks:
            self._tell(remark)
        return judged


def _flaw(moved: tf.PoseRows, where: str, scanned: Sequence[float]) -> str | None:
    """Say why odometry is of no use; None if it is."""
    table = moved.table
    times = table[:, 3]
    if len(times) > 1 and not times.any():
        return f"the headers of {where} have no stamps (all are 0)"
    if len(times) and not (np.square(table[:, 7:]).sum(axis=1) > _SHORTEST).any():
        return f"the quaternions of {where} are 0 or not finite"
    if len(times) and len(scanned) and (times.max() < min(scanned) or times.min() > max(scanned)):
        return (
            f"the stamps of {where} are from {times.min():.2f} s to {times.max():.2f} s, but those "
            f"of the scans from {min(scanned):.2f} s to {max(scanned):.2f} s: of another clock"
        )
    return None
