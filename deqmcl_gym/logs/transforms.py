"""Transforms between the frames of a robot: where its scanners are mounted, and odometry."""

import math
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from deqmcl_gym.maps import Mount
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, LogWarning

ODOMETRY = "nav_msgs/msg/Odometry"
_ODOMETRY_FRAME = "odom"
_UPRIGHT = 0.99  # cosine of the largest tilt that is ignored: 8°


class Transforms:
    """All transforms of a bag, from parent to child: static ones, and odometry."""

    def __init__(self) -> None:
        self._edges: dict[tuple[str, str], list[list[float]]] = {}

    def add(self, time: float, message: Any) -> None:
        """Add a TransformStamped of ROS; a row is t, x, y, z, qx, qy, qz, qw, all finite."""
        at, turned = message.transform.translation, message.transform.rotation
        edge = frame_name(message.header.frame_id), frame_name(message.child_frame_id)
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
        base = only_frame(moving, f"{_ODOMETRY_FRAME} in the transforms of {path}")
        return base, np.array(moving[base])[:, [0, 1, 2, 4, 5, 6, 7]]

    def mounted(self, path: Path, base: str, frame: str, beams: int) -> Mount:
        """Return where the scanner of a frame is mounted on the robot.

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
        x, y = chain[:2, 3].tolist()
        return Mount(x=x, y=y, heading=turn, upside_down=bool(up < 0), beams=beams)

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


def only_frame(frames: Iterable[str], where: str) -> str:
    """Return the only one of some frames.

    Raises:
        InputError: there are several; ``where`` says in what.
    """
    first, *others = sorted(frames)
    if others:
        said = ", ".join([first, *others])
        raise InputError(f"{where} has the poses of several frames, {said}: choose by base_frame.")
    return first


def frame_name(frame: str) -> str:
    """Return a frame's name without the slash, which tf of ROS 1 wrote or did not."""
    return frame.lstrip("/")


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
