"""Transforms between the frames of a robot: where its scanners are mounted, and odometry."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from deqmcl_gym.logs.motion import heading_of
from deqmcl_gym.maps import Mount
from deqmcl_gym.numerics import Floats
from deqmcl_gym.validation import InputError, like, one_of, tell

ODOMETRY = "nav_msgs/msg/Odometry"
POSE_TYPES: dict[str, Callable[[Any], Any]] = {
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
    ODOMETRY: lambda message: message.pose.pose,
}
ODOMETRY_FRAME, MAP_FRAME = "odom", "map"
_UPRIGHT = 0.99  # cosine of the largest tilt that is ignored: 8°
_ROCKING = 0.05, math.radians(3)  # m, rad: largest SD in the plane of a place on a robot
_STEADY = 1e-3  # m, rad: SD that is not told

Edge = tuple[str, str]  # parent, child


class Sent(NamedTuple):
    """A message of a bag."""

    number: int  # in the order in which messages were received
    received: float  # when, s
    source: int  # number of its connection: one for each publisher, where the bag tells them apart
    topic: str
    kind: str
    decoded: Callable[[], Any]  # returns it; damaged bytes can raise anything


@dataclass
class PoseRows:
    """Poses in the order of their messages.

    A row: number of the message, when it was received (s), number of its connection, then its stamp
    (s), x, y, z, qx, qy, qz, qw.
    """

    rows: list[list[float]] = field(default_factory=list)
    frames: set[str] = field(default_factory=set)  # that the headers of the messages name

    def add(self, sent: Sent, message: Any) -> None:
        """Add the pose of a message of ``POSE_TYPES``."""
        pose = POSE_TYPES[sent.kind](message)
        self.frames.add(frame_name(message.header.frame_id))
        self.rows.append(_row(sent, message.header, pose.position, pose.orientation))

    @property
    def table(self) -> Floats:
        """The rows, (n, 11)."""
        return np.array(self.rows, dtype=np.float64).reshape(-1, 11)

    @property
    def poses(self) -> Floats:
        """Rows t, x, y, θ, (n, 4); NaN where they or the quaternion are none."""
        table = self.table
        known = np.isfinite(table[:, 3:]).all(axis=1)
        headings = np.full(len(table), np.nan)
        headings[known] = heading_of(table[known, 7:])
        return np.column_stack([table[:, 3:6], headings])


def _row(sent: Sent, header: Any, at: Any, turned: Any) -> list[float]:
    moment = [float(sent.number), sent.received, float(sent.source), seconds_of(header.stamp)]
    return [*moment, at.x, at.y, at.z, turned.x, turned.y, turned.z, turned.w]


class Transforms:
    """All transforms of a bag, from parent to child, by the topic that they came on."""

    def __init__(self) -> None:
        self._edges: dict[str, dict[Edge, PoseRows]] = {}  # by the namespace of the topic

    def add(self, sent: Sent, message: Any) -> None:
        """Add the transforms of a message."""
        for tf in message.transforms:
            edge = frame_name(tf.header.frame_id), frame_name(tf.child_frame_id)
            edges = self._edges.setdefault(sent.topic.rpartition("/")[0], {})
            rows = edges.setdefault(edge, PoseRows()).rows
            row = _row(sent, tf.header, tf.transform.translation, tf.transform.rotation)
            if np.isfinite(row[4:]).all() and np.linalg.norm(row[7:]) > 0:
                if sent.topic.endswith("/tf_static"):  # the last one counts, as for tf
                    rows.clear()
                rows.append(row)

    def of(self, topic: str) -> "Frames":
        """Return the transforms of the robot that a topic is of: those of its namespace.

        With those of no namespace; all, if there are none of either.
        """
        namespaces = [name for name in self._edges if name == "" or topic.startswith(f"{name}/")]
        if not namespaces and len(self._edges) > 1:
            tell(
                f"{topic} is of none of the robots whose transforms are there, "
                f"{', '.join(sorted(self._edges))}: places on the robot may be another's, so give "
                "odometry_topic and mounting."
            )
        edges: dict[Edge, PoseRows] = {}
        for namespace in sorted(namespaces or self._edges, key=len):
            edges |= self._edges[namespace]
        return Frames(edges)


@dataclass(frozen=True)
class Frames:
    """The frames of one robot."""

    edges: Mapping[Edge, PoseRows]

    @cached_property
    def moving(self) -> Mapping[Edge, PoseRows]:
        """The transforms that move in the plane."""
        return {edge: rows for edge, rows in self.edges.items() if rows.rows and not _place(rows)}

    @property
    def in_map(self) -> Mapping[str, PoseRows]:
        """What is placed in a frame ``map``, by its frame."""
        in_map = ((child, rows) for (p, child), rows in self.edges.items() if _last(p) == MAP_FRAME)
        return {child: rows for child, rows in in_map if rows.rows}

    @property
    def has_odometry(self) -> bool:
        """Whether something moves in a frame ``odom``."""
        return any(_last(parent) == ODOMETRY_FRAME for parent, _ in self.moving)

    def odometry(
        self, name: str, base_frame: str | None, odometry_frame: str | None, scan_frame: str
    ) -> tuple[str, PoseRows]:
        """Return the robot's frame, and its poses by odometry.

        These are the transforms from ``odometry_frame``; None: from ``odom``, whatever stands
        before a slash, or those that move and have the scanner above them.
        """
        if odometry_frame is not None:
            parents = {parent for parent, _ in self.edges}
            odometry_frame = one_of("odometry_frame", frame_name(odometry_frame), parents)
        edges = [
            edge
            for edge, rows in self.edges.items()
            if rows.rows and base_frame in (None, edge[1]) and odometry_frame in (None, edge[0])
        ]
        moving = [edge for edge in edges if edge in self.moving]
        in_odom = [edge for edge in edges if odometry_frame or _last(edge[0]) == ODOMETRY_FRAME]
        # a dock may stand in odom, too
        from_odom = [edge for edge in in_odom if edge in moving] or in_odom
        above = [edge for edge in self._above(scan_frame) if edge in moving]
        if len(from_odom) > 1:
            from_odom = [edge for edge in above if edge in from_odom][:1] or from_odom
        if not from_odom and above and above[0][0] != MAP_FRAME:
            from_odom = above[:1]
        if not from_odom:
            listed = ", ".join(f"{parent} to {child}" for parent, child in moving) or "none"
            raise InputError(
                f"{name} has no odometry: give the topic of a {ODOMETRY} by odometry_topic"
                f"{like('odometry_topic', '/odom')}, or by odometry_frame the frame from which "
                f"transforms move the robot; the moving transforms are {listed}."
            )
        children = {edge[1]: self.edges[edge] for edge in from_odom}
        base = only_frame(children, f"{ODOMETRY_FRAME} in the transforms of {name}")
        return base, children[base]

    def _above(self, frame: str) -> list[Edge]:
        """Return the edges from a frame up to the root."""
        parents = {child: (parent, child) for parent, child in self.edges}
        edges: list[Edge] = []
        while frame in parents and parents[frame] not in edges:
            edges.append(parents[frame])
            frame = parents[frame][0]
        return edges

    def mounted(self, name: str, base: str, frame: str, beams: int) -> Mount:
        """Return where the scanner of a frame is mounted on the robot, seen from above.

        By the mean of transforms that rock, as on springs; their spread is told.
        """
        scanner, remedy = self._resolved(frame), f"mounting{like('mounting', '[x,y,turn]')}"
        no_place = f"{name} has no static transform from {base} to {frame}"
        chain, spread = self._chain(self._resolved(base), scanner)
        root = scanner  # the highest frame that it does not move against
        for edge in self._above(scanner):
            if edge in self.moving or not self.edges[edge].rows:
                break
            root = edge[0]
        if chain is None and root != scanner:
            tell(
                f"{no_place}: the scanner's place on {root} is taken; if that is not {base}, seen "
                f"from above, give {remedy}."
            )
            chain, spread = self._chain(root, scanner)
        if chain is None:
            broken = [" to ".join(edge) for edge, rows in self.edges.items() if not rows.rows]
            why = f" (no finite one from {', '.join(broken)})" if broken else ""
            tell(
                f"{no_place}{why}: the scanner is assumed in the robot's centre, looking ahead; if "
                f"it is not, give {remedy}."
            )
            chain = np.eye(4)
        if max(spread) > _STEADY:
            tell(
                f"{name}: the place of {frame} on {base} is the mean of transforms that vary, "
                f"standard deviation {spread[0]:.3f} m, turn {math.degrees(spread[1]):.2g}°, tilt "
                f"{math.degrees(spread[2]):.2g}°."
            )
        up = chain[2, 2]
        if abs(up) < _UPRIGHT:
            raise InputError(
                f"the scanner is tilted by {math.degrees(math.acos(up)):.0f}°, but must scan a "
                "level plane."
            )
        turn = math.atan2(chain[1, 0], chain[0, 0])
        x, y = chain[:2, 3].tolist()
        return Mount(x=x, y=y, heading=turn, upside_down=bool(up < 0), beams=beams)

    def _resolved(self, frame: str) -> str:
        """Return a frame as transforms call it: with a prefix that only they have, or without."""
        names = {name for edge in self.edges for name in edge}
        alike = [name for name in names if _last(name) == _last(frame)]
        return frame if frame in names or len(alike) != 1 else alike[0]

    def _chain(self, base: str, frame: str) -> tuple[Floats | None, Floats]:
        """Return a steady transform from base to frame, 4 x 4, and its spread (m, rad, rad)."""
        steps: dict[str, list[tuple[str, Floats, Floats]]] = {}
        for (parent, child), rows in self.edges.items():
            if (place := _place(rows)) is not None:
                transform, spread = place
                steps.setdefault(parent, []).append((child, transform, spread))
                back = np.linalg.inv(transform).astype(np.float64)
                steps.setdefault(child, []).append((parent, back, spread))
        reached, queue = {base: (np.eye(4), np.zeros(3))}, [base]
        for name in queue:
            for next_name, step, spread in steps.get(name, ()):
                if next_name not in reached:
                    matrix, squares = reached[name]
                    reached[next_name] = (matrix @ step, squares + spread**2)
                    queue.append(next_name)
        if frame not in reached:
            return None, np.zeros(3)
        matrix, squares = reached[frame]
        return matrix, np.sqrt(squares)


def _place(rows: PoseRows) -> tuple[Floats, Floats] | None:
    """Return mean and SD (m, rad, rad of tilt) of a transform that hardly moves in the plane."""
    values = rows.table[:, 4:]
    if not len(values):
        return None
    quaternions = values[:, 3:] / np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    quaternions[quaternions @ quaternions[0] < 0] *= -1  # q and -q are the same turn
    values = np.column_stack([values[:, :3], quaternions])
    mean = values[0] + (values - values[0]).mean(axis=0)  # of equal ones the same to the bit
    *axis, scalar = mean[3:] / np.linalg.norm(mean[3:])
    vectors, scalars = quaternions[:, :3], quaternions[:, 3:]
    off = 2 * (scalar * vectors - scalars * axis - np.cross(axis, vectors))  # of mean⁻¹ q
    tilt, turn = np.sqrt(np.square(off).mean(axis=0) @ [[1, 0], [1, 0], [0, 1]])
    along = float(np.sqrt(values[:, :2].var(axis=0).sum()))
    if along > _ROCKING[0] or turn > _ROCKING[1]:
        return None
    return _matrix(mean), np.array([along, turn, tilt])


def only_frame(frames: Iterable[str], where: str) -> str:
    """Return the only one of some frames."""
    first, *others = sorted(frames)
    if others:
        listed = ", ".join([first, *others])
        by = f"base_frame{like('base_frame', first)}"
        raise InputError(f"{where} has the poses of several frames, {listed}: choose by {by}.")
    return first


def frame_name(frame: str) -> str:
    """Return a frame's name without the slash, which tf of ROS 1 wrote or did not."""
    return frame.lstrip("/")


def _last(frame: str) -> str:
    """Return a frame's name without a prefix, as of a fleet."""
    return frame.rpartition("/")[2]


def seconds_of(stamp: Any) -> float:
    """Return a stamp in s."""
    return (int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)) / 1e9


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
