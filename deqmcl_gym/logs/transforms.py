"""ROS transforms between the frames of a robot: the scanner's mounting, and odometry."""

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from deqmcl_gym.logs.found import LogWarning
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError

_ODOMETRY_FRAME = "odom"
_UPRIGHT = 0.99  # cosine of the largest tilt that is ignored: 8°


class Transforms:
    """All transforms of a bag, from parent to child: static ones, and odometry."""

    def __init__(self) -> None:
        self._edges: dict[tuple[str, str], list[list[float]]] = {}

    def add(self, time: float, message: Any) -> None:
        """Add a TransformStamped of ROS; a row is t, x, y, z, qx, qy, qz, qw."""
        at, turned = message.transform.translation, message.transform.rotation
        edge = _name(message.header.frame_id), _name(message.child_frame_id)
        row = [time, at.x, at.y, at.z, turned.x, turned.y, turned.z, turned.w]
        self._edges.setdefault(edge, []).append(row)

    def odometry(self, base_frame: str | None) -> tuple[str, Floats]:
        """Return the robot's frame and its poses in odom, rows t, x, y, qx, qy, qz, qw."""
        for (parent, child), rows in self._edges.items():
            if parent == _ODOMETRY_FRAME and base_frame in (None, child):
                return child, np.array(rows)[:, [0, 1, 2, 4, 5, 6, 7]]
        return base_frame or "", np.empty((0, 7))

    def mounted(
        self, path: Path, base: str, frame: str, angles: Floats
    ) -> tuple[tuple[float, ...], tuple[float, float]]:
        """Return beam angles against the robot's heading, and the scanner's position on it (x, y).

        Raises:
            InputError: the scanner is tilted.
        """
        chain = self._chain(_name(base), _name(frame))
        if chain is None:
            warnings.warn(
                f"{path} has no static transform from {base} to {frame}: the scanner is assumed in "
                "the robot's centre, looking ahead; if it is not, give mounting=(x, y, turn).",
                LogWarning,
                stacklevel=2,
            )
            chain = np.eye(4)
        up = chain[2, 2]
        if abs(up) < _UPRIGHT:
            raise InputError(
                f"the scanner of {path} is tilted by {math.degrees(math.acos(up)):.0f}°, but must "
                "scan a level plane."
            )
        turn = math.atan2(chain[1, 0], chain[0, 0])
        seen = turn + math.copysign(1.0, up) * angles
        return tuple(seen.tolist()), (float(chain[0, 3]), float(chain[1, 3]))

    def _chain(self, base: str, frame: str) -> Floats | None:
        """Return the transform from base to frame, 4 x 4; None without static ones between them."""
        steps: dict[str, list[tuple[str, Floats]]] = {}
        for (parent, child), rows in self._edges.items():
            values = np.array(rows)[:, 1:]
            if np.ptp(values, axis=0).max() < 1e-6:
                there: Floats = _matrix(values[0])
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
