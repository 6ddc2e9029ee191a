"""Trajectories in the TUM format, and where a robot was at other times than those in one."""

import math
import warnings
from collections import Counter
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.logs.files import write_bytes
from deqmcl_gym.logs.found import NOT_FINITE, UNREADABLE, LogWarning, in_order
from deqmcl_gym.logs.log import Log, said_of_skipped
from deqmcl_gym.logs.motion import composed, heading_of, relative
from deqmcl_gym.logs.text import numbers_of, text_of
from deqmcl_gym.maps.units import PIXELS
from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, array, number

MAX_GAP = 2.0  # m


@final
@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses at times.

    Attributes:
        times: s, (n,), none before the last.
        poses: (x, y, θ), (n, 3).
        source: what it was read from.
    """

    times: Floats
    poses: Floats
    source: str = "the trajectory"

    def __post_init__(self) -> None:
        times = array(f"times of {self.source}", self.times, (None,))
        poses = array(f"poses of {self.source}", self.poses, (times.size, 3))
        if not times.size:
            raise InputError(f"{self.source} has no pose.")
        if (np.diff(times) < 0).any():
            raise InputError(f"times of {self.source} run backwards.")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "poses", poses)

    def write(self, path: str | PathLike[str]) -> None:
        """Write a TUM file: ``t x y 0 0 0 sin(θ/2) cos(θ/2)`` a line, all digits."""
        rows = np.column_stack([self.times, self.poses]).tolist()
        write_bytes(Path(path), "".join(_line(*row) for row in rows).encode())


def read_tum(path: str | PathLike[str]) -> Trajectory:
    """Read a TUM trajectory: ``t x y z qx qy qz qw`` a line, ``#`` begins a comment.

    Lines that are no pose are skipped with a warning that counts them.

    Raises:
        InputError: no pose in it.
    """
    file = Path(path)
    rows: list[list[float]] = []
    damage: Counter[str] = Counter()
    for line in text_of(file).splitlines():
        if not (words := line.replace(",", " ").split()) or words[0].startswith("#"):
            continue
        try:
            time, x, y, _, *quaternion = numbers_of(words)
        except ValueError:
            quaternion = []
        if len(quaternion) != 4:
            damage[UNREADABLE] += 1
        else:
            rows.append([time, x, y, *quaternion])
    table = np.array(rows).reshape(-1, 7)
    known = np.isfinite(table).all(axis=1)
    headings = np.full(len(table), np.nan)
    headings[known] = heading_of(table[known, 3:])
    return _sound(np.column_stack([table[:, :3], headings]), str(file), damage)


def _sound(rows: Floats, source: str, damage: Counter[str]) -> Trajectory:
    """Return the sound ones of rows t, x, y, θ, (n, 4); warn of the others."""
    finite = np.isfinite(rows).all(axis=1)
    if not finite.all():
        damage[NOT_FINITE] += int((~finite).sum())
    rows = rows[finite]
    if not len(rows):
        why = f" ({said_of_skipped(damage, 0)})" if damage else ""
        raise InputError(
            f"{source} has no usable reference pose{why}: a TUM trajectory has lines of 8 numbers, "
            "t x y z qx qy qz qw."
        )
    rows = rows[in_order(rows[:, 0], damage)]
    if damage:
        said = said_of_skipped(damage, len(rows))
        warnings.warn(f"reference {source}: {said}.", LogWarning, stacklevel=3)
    return Trajectory(rows[:, 0], rows[:, 1:], source)


def referenced(
    log: Log, reference: Trajectory | str | PathLike[str], max_gap: float | None = None
) -> Log:
    """Return the log with a trajectory as its reference, at the times of its records.

    Between two poses of the trajectory the robot is where its odometry takes it from the first; the
    odometry's error at the second is spread over the way between them. So a reference with a pose
    a metre does not cut corners.

    Args:
        log: the records.
        reference: a trajectory, or a TUM file of one, in the map's frame, with the log's clock.
        max_gap: records between two poses further apart than this get none; None is 2 m.

    Raises:
        InputError: no record lies within the trajectory.
    """
    apart = MAX_GAP / PIXELS["m"] * PIXELS[log.unit] if max_gap is None else max_gap
    number("max_gap", apart, low=0, finite=False)
    trajectory = reference if isinstance(reference, Trajectory) else read_tum(reference)
    times, poses = trajectory.times, trajectory.poses
    inside = (log.times >= times[0]) & (log.times <= times[-1])
    after = np.clip(np.searchsorted(times, log.times), 1, max(times.size - 1, 1))
    before = after - 1
    after = np.minimum(after, times.size - 1)
    exact = np.isin(log.times, times)
    near = np.hypot(*(poses[after] - poses[before])[:, :2].T) < apart
    known = inside & (near | exact)
    if not known.any():
        raise InputError(
            f"the reference {trajectory.source} covers {times[0]:.2f} s to {times[-1]:.2f} s, but "
            f"{log.source} {log.times[0]:.2f} s to {log.times[-1]:.2f} s: no record has a "
            "reference pose, so give the reference of this log, with the same clock."
        )
    odometry, way = _odometry_at(log, times), np.interp(times, log.times, _strict(log))
    first, last = before[known], after[known]
    here = relative(odometry[first], log.odometry[known])
    missed = relative(poses[first], poses[last]) - relative(odometry[first], odometry[last])
    missed[:, 2] = arrays.wrapped(missed[:, 2])
    length = way[last] - way[first]
    share = np.divide(
        _strict(log)[known] - way[first], length, out=np.zeros_like(length), where=length > 0
    )
    found = np.full((len(log), 3), np.nan)
    found[known] = composed(poses[first], here + share[:, None] * missed)
    return replace(log, reference=found)


def with_own_reference(log: Log, rows: ArrayLike) -> Log:
    """Return the log with the reference of its own file, rows t, x, y, θ, (k, 4); none if k = 0.

    If they all stand at records, there is none between them.
    """
    given = np.asarray(rows, dtype=np.float64).reshape(-1, 4)
    if not len(given):
        return log
    trajectory = _sound(given, log.source, Counter())
    same = np.isin(trajectory.times, log.times).all()
    return referenced(log, trajectory, max_gap=0.0 if same else None)


def _strict(log: Log) -> Floats:
    """How far the robot has come at each record; a little also while it stands."""
    elapsed: Floats = log.way + 1e-9 * (log.times - log.times[0])
    return elapsed


def _odometry_at(log: Log, times: Floats) -> Floats:
    """Odometry poses at other times, (n, 3), straight between the records."""
    x, y, heading = log.odometry.T
    columns = (x, y, np.unwrap(heading))
    found = [np.interp(times, log.times, column) for column in columns]
    return np.column_stack([*found[:2], arrays.wrapped(found[2])])


def _line(time: float, x: float, y: float, heading: float) -> str:
    turned = math.sin(heading / 2), math.cos(heading / 2)
    return " ".join(map(repr, (time, x, y, 0, 0, 0, *turned))) + "\n"
