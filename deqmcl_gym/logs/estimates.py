"""What another stack has estimated: poses and covariances from TUM, CSV, or a topic of a bag.

On /tf a stack says how the map lies to the odometry, from ``map`` to ``odom``: its pose is that,
composed with the odometry at the same time.

CSV: a header with ``time,x,y,heading`` (s, m, rad) and, if known, the covariance of a pose as
``var_x,cov_xy,cov_x_heading,var_y,cov_y_heading,var_heading``; empty cells are unknown.
"""

import math
from collections import Counter
from os import PathLike
from pathlib import Path

import numpy as np

from deqmcl_gym.files import text_of
from deqmcl_gym.logs.bags import (
    POSE_TYPES,
    TRANSFORMS,
    Bag,
    frame_of_header,
    opened_bag,
    row_of,
    seconds_of,
)
from deqmcl_gym.logs.motion import composed
from deqmcl_gym.logs.odometry import JudgedOdometry
from deqmcl_gym.logs.raw_records import stamped
from deqmcl_gym.logs.ros import warn_of_frames
from deqmcl_gym.logs.trajectory import Trajectory, sound_poses, tum_rows
from deqmcl_gym.logs.transforms import MAP_FRAME, ODOMETRY, PoseRows, Transforms
from deqmcl_gym.numerics import Floats
from deqmcl_gym.validation import InputError

COLUMNS = ("time", "x", "y", "heading")
UPPER = ("var_x", "cov_xy", "cov_x_heading", "var_y", "cov_y_heading", "var_heading")
_AT = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])  # of a 3 x 3 matrix in its upper triangle
_BAGS = ("", ".bag", ".mcap", ".db3")
_ESTIMATE = "/amcl_pose"  # of Nav2's AMCL


def read_estimate(path: str | PathLike[str], topic: str | None = None) -> Trajectory:
    """Read a trajectory that a stack has estimated; the ending of its name says the format.

    ``.csv``: see above. ``.bag``, ``.mcap``, ``.db3`` or a folder: a topic of a bag, of type
    PoseWithCovarianceStamped, PoseStamped or Odometry, or of transforms from ``map``; None is
    ``/amcl_pose``, or the only topic of poses, or /tf if that has such transforms. All else:
    TUM. ``.gz`` may follow. Lines that are no pose, not finite or out of order are left out, with a
    warning that counts them, and so are covariances that no distribution has.
    """
    file = Path(path)
    packed = file.suffix.lower() == ".gz"
    ending = "" if file.is_dir() else (Path(file.stem) if packed else file).suffix.lower()
    if ending in _BAGS and (file.is_dir() or ending):
        rows, covariances = _read_topic(file, topic)
        source = f"{file}:{topic}" if topic else str(file)
        return sound_poses(stamped(rows), source, Counter(), covariances)
    if topic is not None:
        raise InputError(f"{file} is no bag, so it has no topic {topic}: leave it out.")
    if ending == ".csv":
        rows, covariances = _read_csv(file)
        return sound_poses(stamped(rows), str(file), Counter(), covariances)
    rows, source, damage = tum_rows(file)
    return sound_poses(stamped(rows), source, damage)


def _read_csv(path: Path) -> tuple[Floats, Floats | None]:
    """Return rows t, x, y, θ and covariances; None without these columns."""
    header, *lines = text_of(path).splitlines() or [""]
    columns = [cell.strip() for cell in header.split(",")]
    spread = [name for name in UPPER if name in columns]
    for name in (*COLUMNS, *(UPPER if spread else ())):
        if columns.count(name) != 1:
            raise InputError(
                f"{path} has the column {name!r} {columns.count(name)} times, but a CSV of "
                f"estimates has {','.join(COLUMNS)} and all or none of {','.join(UPPER)} once."
            )
    at = [columns.index(name) for name in (*COLUMNS, *spread)]
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


def _read_topic(path: Path, topic: str | None) -> tuple[Floats, Floats | None]:
    """Return rows t, x, y, θ that a stack has published in a bag, and covariances if any."""
    with opened_bag([path]) as bag:
        chosen = _chosen(bag, topic)
        if bag.topics.get(chosen) in TRANSFORMS:
            return _composed(bag, chosen), None
        poses, spreads, frames = PoseRows(), [], set()
        for sent in bag.messages({chosen}):
            message = sent.decoded()
            poses.rows.append(row_of(sent, message))
            frames.add(frame_of_header(message))
            spreads.append(getattr(message.pose, "covariance", np.zeros(36)))
    warn_of_frames(str(path), chosen, frames)
    moments = np.array(spreads, np.float64).reshape(-1, 6, 6)[:, [[0], [1], [5]], [0, 1, 5]]
    moments[(moments == 0).all(axis=(1, 2))] = np.nan
    told = np.isfinite(moments).all(axis=(1, 2)).any()
    return poses.poses, moments if told else None


def _chosen(bag: Bag, asked: str | None) -> str:
    """Return the topic of poses asked for, or the one that a stack's pose is on."""
    if asked is None and _ESTIMATE in bag.topics:
        return _ESTIMATE
    if asked is None:
        estimates = [kind for kind in POSE_TYPES if kind != ODOMETRY]
        if not any(kind in estimates for kind in bag.topics.values()):
            moving = [topic for topic, kind in bag.topics.items() if kind in TRANSFORMS]
            for topic in sorted(moving):
                if _transforms_of(bag, topic)[0]:
                    return topic
        else:
            found = bag.topic(estimates, "the topic in FILE:TOPIC", None)
            assert found is not None
            return found
    found = bag.topic((*POSE_TYPES, *TRANSFORMS), "the topic in FILE:TOPIC", asked)
    assert found is not None
    return found


def _transforms_of(bag: Bag, topic: str) -> tuple[dict[str, PoseRows], Transforms]:
    """Return what moves in the map by a topic of transforms, by frame, and all transforms."""
    moved: dict[str, PoseRows] = {}
    transforms = Transforms()
    for sent in bag.messages(set(), TRANSFORMS):
        for one in sent.decoded().transforms:
            transforms.add(sent.topic, [*sent.row, seconds_of(one.header.stamp)], one)
    for (parent, child), rows in transforms.of(topic).edges.items():
        if parent.rpartition("/")[2] == MAP_FRAME and rows.rows:
            moved[child] = rows
    return moved, transforms


def _composed(bag: Bag, topic: str) -> Floats:
    """Return rows t, x, y, θ of the robot in the map, (n, 4), by a topic of transforms."""
    moved, transforms = _transforms_of(bag, topic)
    if len(moved) != 1:
        raise InputError(
            f"{bag.name}:{topic} has transforms from {MAP_FRAME} to {len(moved)} frames, "
            "but must have one, as odom: give a topic of poses."
        )
    ((child, rows),) = moved.items()
    there, frames = rows.poses, transforms.of(topic)
    odometry = PoseRows()
    if any(parent == child for parent, _ in frames.moving):
        _, odometry = frames.odometry(bag.name, None, child, "")
    elif ODOMETRY in bag.topics.values():
        for sent in bag.messages({bag.topic((ODOMETRY,), "odometry_topic", None, beside=topic)}):
            message = sent.decoded()
            if frame_of_header(message) in (child, ""):
                odometry.rows.append(row_of(sent, message))
    if not odometry.rows:
        return there  # the robot itself
    table = odometry.table
    judged = JudgedOdometry.of(table[:, 0], table[:, 1], odometry.poses, "m")
    found = [
        judged.at(number, time) for number, time in zip(rows.table[:, 0], there[:, 0], strict=True)
    ]
    known = np.array([one is not None for one in found])
    here = np.array([one[1] for one in found if one is not None]).reshape(-1, 3)
    return np.column_stack([there[known, 0], composed(there[known, 1:], here)])
