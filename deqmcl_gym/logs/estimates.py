"""What another stack has estimated: poses and covariances from TUM, CSV, or a topic of a bag.

CSV: a header with ``time,x,y,heading`` (s, m, rad) and, if known, the covariance of a pose as
``var_x,cov_xy,cov_x_heading,var_y,cov_y_heading,var_heading``; empty cells are unknown.
"""

import math
import warnings
from os import PathLike
from pathlib import Path

import numpy as np

from deqmcl_gym.files import numbers_of, text_of
from deqmcl_gym.logs.raw_records import usable
from deqmcl_gym.logs.ros import read_pose_topic
from deqmcl_gym.logs.trajectory import Trajectory, tum_rows
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, LogWarning

_POSE = ("time", "x", "y", "heading")
_UPPER = ("var_x", "cov_xy", "cov_x_heading", "var_y", "cov_y_heading", "var_heading")
_AT = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])  # of a 3 x 3 matrix in its upper triangle
_BAGS = ("", ".bag", ".mcap", ".db3")


def read_estimate(path: str | PathLike[str], topic: str | None = None) -> Trajectory:
    """Read a trajectory that a stack has estimated; the ending of its name says the format.

    ``.csv``: see above. ``.bag``, ``.mcap``, ``.db3`` or a folder: a topic of a bag, of type
    PoseWithCovarianceStamped, PoseStamped or Odometry. All else: TUM. Lines that are no pose, or
    not finite, are left out, with a warning that counts them.

    Args:
        path: of the file.
        topic: of a bag; None: ``/amcl_pose``, or the only topic of poses.

    Raises:
        InputError: the file is missing or damaged, has no pose, or its times run backwards.
    """
    file = Path(path)
    ending = "" if file.is_dir() else file.suffix.lower()
    if ending in _BAGS and (file.is_dir() or ending):
        rows, covariances = read_pose_topic(file, topic)
        return _sound(rows, covariances, f"{file}:{topic}" if topic else str(file))
    if topic is not None:
        raise InputError(f"{file} is no bag, so it has no topic {topic}: leave it out.")
    if ending == ".csv":
        return _sound(*_read_csv(file), str(file))
    rows, unreadable = tum_rows(file)
    return _sound(rows, None, str(file), unreadable)


def with_covariances(estimate: Trajectory, path: str | PathLike[str]) -> Trajectory:
    """Return an estimate with the covariances of a file, a line for each of its poses.

    A line is the time, then the 6 numbers of the upper triangle of (x, y, θ), or the 9 or, as in
    ROS, the 36 of a whole matrix, row by row; ``#`` begins a comment.

    Raises:
        InputError: a line of another form, or other times than the estimate's.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(text_of(Path(path)).splitlines(), 1):
        words = line.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            row = numbers_of(words)
        except ValueError:
            row = []
        if len(row) not in (7, 10, 37) or (rows and len(row) != len(rows[0])):
            raise InputError(
                f"line {number} of {path} must be a time and 6, 9 or 36 numbers of a covariance, "
                "as many in every line."
            )
        rows.append(row)
    table = np.array(rows or [[math.nan]])
    if not np.array_equal(table[:, 0], estimate.times):
        raise InputError(
            f"{path} has {len(rows):,} lines of covariances, but must have one at each time of the "
            f"{estimate.times.size:,} poses of {estimate.source}."
        )
    values = table[:, 1:]
    if values.shape[1] == 6:
        values = values[:, _AT]
    if values.shape[1] == 36:
        values = values.reshape(-1, 6, 6)[:, [[0], [1], [5]], [0, 1, 5]]
    covariances = values.reshape(-1, 3, 3)
    return Trajectory(estimate.times, estimate.poses, estimate.source, covariances)


def _read_csv(path: Path) -> tuple[Floats, Floats | None]:
    """Return rows t, x, y, θ and covariances; None without these columns."""
    header, *lines = text_of(path).splitlines() or [""]
    columns = [cell.strip() for cell in header.split(",")]
    spread = [name for name in _UPPER if name in columns]
    for name in (*_POSE, *(_UPPER if spread else ())):
        if columns.count(name) != 1:
            raise InputError(
                f"{path} has the column {name!r} {columns.count(name)} times, but a CSV of "
                f"estimates has {','.join(_POSE)} and all or none of {','.join(_UPPER)} once."
            )
    at = [columns.index(name) for name in (*_POSE, *spread)]
    table = np.full((len(lines), len(at)), math.nan)
    kept = 0
    for number, line in enumerate(lines, 2):
        if not line.strip():
            continue
        cells = [cell.strip() for cell in line.split(",")]
        try:
            table[kept] = [float(cells[i]) if cells[i] else math.nan for i in at]
        except (ValueError, IndexError):
            raise InputError(
                f"line {number} of {path} must have {len(columns)} numbers or empty cells."
            ) from None
        kept += 1
    found = table[:kept]
    return found[:, :4], found[:, 4:][:, _AT].reshape(-1, 3, 3) if spread else None


def _sound(
    rows: Floats, covariances: Floats | None, source: str, unreadable: int = 0
) -> Trajectory:
    """Return the trajectory of the finite rows t, x, y, θ, (n, 4)."""
    sound, n = usable(rows), len(rows) + unreadable
    if not sound.any():
        raise InputError(f"{source} has no pose, of {n:,} lines or messages.")
    if lost := n - int(sound.sum()):
        said = f"{source}: {lost:,} of {n:,} poses are left out: unreadable or not finite."
        warnings.warn(said, LogWarning, stacklevel=3)
    kept = None if covariances is None else covariances[sound]
    return Trajectory(rows[sound, 0], rows[sound, 1:], source, kept)
