"""Trajectories, such as references and estimates: read, and interpolated at the times of a log.

CSV: a header with ``time,x,y,heading`` (s, m, rad) and, if known, the covariance of a pose as
``var_x,cov_xy,cov_x_heading,var_y,cov_y_heading,var_heading``; empty cells are unknown.
"""

import math
from collections import Counter
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.files import columns_of, numbers_of, save, text_of
from deqmcl_gym.logs import raw_records
from deqmcl_gym.logs.bags import poses_of_topic
from deqmcl_gym.logs.log import Log, ascending_times, said_of_skipped
from deqmcl_gym.logs.motion import between, composed, heading_of, nearest_in_time, relative
from deqmcl_gym.logs.odometry import jumps_in, times_words
from deqmcl_gym.maps.map import PIXELS
from deqmcl_gym.numerics import Bools, Floats, Indices, arrays
from deqmcl_gym.validation import LARGEST, InputError, array, number, real, shown, tell

COLUMNS = ("time", "x", "y", "heading")
UPPER = ("var_x", "cov_xy", "cov_x_heading", "var_y", "cov_y_heading", "var_heading")
_AT = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])  # of a 3 x 3 matrix in its upper triangle
MAX_GAP = 2.0  # m
TOLERANCE = 0.02  # s, at most, and half the usual time between two records
_UPRIGHT = 0.99  # cosine of the largest tilt that is not told: 8°
_CLOCKS = ((1e17, "nanoseconds"), (1e14, "microseconds"), (LARGEST, "milliseconds"))
_ROUNDING = 1e-6  # of covariances: float32 of some stacks


@final
@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses at times."""

    times: Floats  #: s, (n,), not decreasing
    poses: Floats  #: (x, y, θ), (n, 3)
    source: str = "the trajectory"  #: in messages, such as its file
    covariances: Floats | None = None  #: of (x, y, θ), (n, 3, 3), NaN where unknown

    def __post_init__(self) -> None:
        times = ascending_times(self.source, "pose", self.times)
        poses = array(f"poses of {self.source}", self.poses, (times.size, 3))
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "poses", poses)
        if self.covariances is not None:
            object.__setattr__(self, "covariances", self._sound_covariances(self.covariances))

    def _sound_covariances(self, given: ArrayLike) -> Floats:
        """Return covariances (n, 3, 3), NaN where no distribution has them; tell how many."""
        n = self.times.size
        sound = np.array(real(f"covariances of {self.source}", given), dtype=np.float64)
        if sound.shape != (n, 3, 3):
            raise InputError(
                f"covariances of {self.source} have shape {sound.shape}, but must be {(n, 3, 3)}."
            )
        known = (np.abs(sound) <= LARGEST).all(axis=(1, 2))
        sound[~known] = np.nan
        size = np.abs(sound[known]).max(axis=(1, 2), initial=0.0)
        skew = np.abs(sound[known] - sound[known].transpose(0, 2, 1)).max(axis=(1, 2), initial=0)
        least = np.linalg.eigvalsh(sound[known])[:, 0]
        wrong = (skew > _ROUNDING * size) | (least < -_ROUNDING * size)
        wrong |= (np.diagonal(sound[known], axis1=1, axis2=2) == 0).any(axis=1)
        sound[np.flatnonzero(known)[wrong]] = np.nan
        if wrong.any():
            tell(
                f"{self.source}: {int(wrong.sum()):,} of {wrong.size:,} covariances count as "
                "unknown: they are not symmetric with eigenvalues of 0 or more, or have a variance "
                "of 0."
            )
        return sound

    def spread_at(self, at: Indices) -> Floats | None:
        """Return the covariances of poses by index, NaN unknown; None without any."""
        return None if self.covariances is None else self.covariances[at]

    @property
    def tum(self) -> bytes:
        """The content of a TUM file: lines ``t x y 0 0 0 sin(θ/2) cos(θ/2)``, with all digits."""
        lines = []
        for time, (x, y, heading) in zip(self.times.tolist(), self.poses.tolist(), strict=True):
            turned = math.sin(heading / 2), math.cos(heading / 2)
            lines.append(" ".join(map(repr, (time, x, y, 0, 0, 0, *turned))) + "\n")
        return "".join(lines).encode()

    def write(self, path: str | PathLike[str]) -> None:
        """Write a TUM file."""
        save(Path(path), self.tum)


def read_tum(path: str | PathLike[str]) -> Trajectory:
    """Read a TUM trajectory: lines ``t x y z qx qy qz qw``; ``#`` begins a comment.

    Other lines are skipped, with a warning that counts them.
    """
    if not isinstance(path, str | PathLike):
        raise InputError(f"the reference is {shown(path)}, but must be the path of a TUM file.")
    rows, damage = tum_rows(Path(path))
    return sound_poses(rows, str(Path(path)), damage)


def tum_rows(file: Path) -> tuple[Floats, Counter[str]]:
    """Return t, x, y, θ of the lines of a TUM file, (n, 4), and what else is in it.

    NaN is where a number or the quaternion of a line is no pose.
    """
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
            damage[raw_records.UNREADABLE] += 1
        else:
            rows.append([time, x, y, *quaternion])
    table = np.array(rows).reshape(-1, 7)
    known = raw_records.usable(table)
    table[known, 3:] = _upright(table[known, 3:], str(file))
    headings = np.full(len(table), np.nan)
    headings[known] = heading_of(table[known, 3:])
    return np.column_stack([table[:, :3], headings]), damage


def _upright(quaternions: Floats, source: str) -> Floats:
    """Return quaternions (n, 4) as qx, qy, qz, qw; tell what is not of a robot on a floor."""
    size = np.maximum(np.square(quaternions).sum(axis=1), 1e-12)
    up = [1 - 2 * np.square(quaternions[:, axes]).sum(axis=1) / size for axes in ([0, 1], [1, 2])]
    if not len(quaternions) or np.median(up[0]) >= _UPRIGHT:
        return quaternions
    tilt = math.degrees(math.acos(max(-1.0, float(up[0].min()))))
    first = np.median(up[1]) >= _UPRIGHT
    remedy = "they are read with qw first"
    if not first:
        remedy = "give poses of the robot's base with z up, if these are a camera's, with z ahead"
    tell(
        f"{source}: with quaternions as qx qy qz qw, its poses are tilted by up to {tilt:.0f}°: "
        f"{remedy}."
    )
    return quaternions[:, [1, 2, 3, 0]] if first else quaternions


def sound_poses(
    rows: Floats, source: str, damage: Counter[str], covariances: Floats | None = None
) -> Trajectory:
    """Return the trajectory of the sound rows t, x, y, θ, (n, 4), in order; tell of the others."""
    sound = raw_records.usable(rows)
    damage += Counter({raw_records.NOT_FINITE: int((~sound).sum())})
    indices = np.flatnonzero(sound)
    if not indices.size:
        why = f" ({said_of_skipped(damage, 0)})" if damage else ""
        times = rows[np.isfinite(rows[:, 0]), 0]
        usual = float(np.median(times)) if times.size else 0.0
        unit = next((unit for least, unit in _CLOCKS if usual > least), None)
        if unit is not None:
            why += f": its times are about {usual:.3g}: are these {unit}? Write seconds"
        raise InputError(
            f"{source} has no usable pose{why}: each needs a time and finite x, "
            "y and heading; a TUM trajectory has lines t x y z qx qy qz qw."
        )
    indices = indices[raw_records.ascending(rows[indices, 0], damage)]
    if damage:
        tell(f"{source}: {said_of_skipped(damage, indices.size)}.")
    spread = None if covariances is None else covariances[indices]
    return Trajectory(rows[indices, 0], rows[indices, 1:], source, spread)


def read_estimate(path: str | PathLike[str], topic: str | None = None) -> Trajectory:
    """Read a trajectory that a stack has estimated; the ending of its name says the format.

    ``.csv``: see above. ``.bag``, ``.mcap``, ``.db3`` or a folder: a topic of a bag, of type
    PoseWithCovarianceStamped, PoseStamped or Odometry, or of transforms from ``map``; None is
    ``/amcl_pose``, or the only topic of poses, or /tf if that has such transforms. All else: TUM.
    ``.gz`` may follow. Lines that are no pose, not finite or out of order are left out, with a
    warning that counts them, and so are covariances that no distribution has.
    """
    file = Path(path)
    packed = file.suffix.lower() == ".gz"
    ending = (Path(file.stem) if packed else file).suffix.lower()
    source, damage, covariances = str(file), Counter[str](), None
    if file.is_dir() or ending in (".bag", ".mcap", ".db3"):
        rows, covariances = poses_of_topic(file, topic)
        source += f":{topic}" if topic else ""
    elif topic is not None:
        raise InputError(f"{file} is no bag, so it has no topic {topic}: leave it out.")
    elif ending == ".csv":
        rows, covariances = _read_csv(file)
    else:
        rows, damage = tum_rows(file)
    return sound_poses(raw_records.stamped(rows), source, damage, covariances)


def _read_csv(path: Path) -> tuple[Floats, Floats | None]:
    """Return rows t, x, y, θ and covariances; None without these columns."""
    header, *lines = text_of(path).splitlines() or [""]
    columns = [cell.strip() for cell in header.split(",")]
    at = columns_of(path, columns, COLUMNS, UPPER)
    rows: list[list[float]] = []
    for row, line in enumerate(lines, 2):
        if not line.strip():
            continue
        cells = [cell.strip() for cell in line.split(",")]
        try:
            rows.append([float(cells[i]) if cells[i] else math.nan for i in at])
        except (ValueError, IndexError):
            raise InputError(
                f"line {row} of {path} must have {len(columns)} numbers or empty cells."
            ) from None
    table = np.array(rows).reshape(-1, len(at))
    return table[:, :4], table[:, 4:][:, _AT].reshape(-1, 3, 3) if len(at) > 4 else None


def tolerance_of(log: Log, tolerance: float | None = None) -> float:
    """Return how far the stamps of a record and of its reference pose may be apart, s.

    Half the usual time between two records, at most 20 ms, if it is not given.
    """
    if tolerance is not None:
        return number("reference_tolerance", tolerance, low=0)
    period = float(np.median(np.diff(log.times))) if len(log) > 1 else 0.0
    return min(TOLERANCE, period / 2)


def referenced(
    log: Log,
    reference: Trajectory | str | PathLike[str],
    max_gap: float | None = None,
    tolerance: float | None = None,
) -> Log:
    """Return the log with a trajectory as its reference, at the times of its records.

    A record at the time of a pose has that pose; of several at one time, the k-th record has the
    k-th pose, or the last. Between two poses, the robot's odometry is followed from the first, and
    its error at the second is spread over the way between them, metres and 1 m per radian turned.
    So a reference with one pose per metre does not cut corners. ``Log.interpolated`` says where,
    but for records so near in time to a pose that this is as good as their own. A trajectory that
    covers no record is refused.

    Args:
        reference: a trajectory, or a TUM file of one, in the map's frame, with the log's clock.
        max_gap: records between two poses get none if these are so far apart, in a straight line
            or by odometry, or farther; None is 2 m.
        tolerance: s by which a pose may be off the time of its record; see ``tolerance_of``.
    """
    gap = MAX_GAP / PIXELS["m"] * PIXELS[log.unit] if max_gap is None else max_gap
    number("max_gap", gap, low=0, finite=False)
    trajectory = reference if isinstance(reference, Trajectory) else read_tum(reference)
    times, poses = trajectory.times, trajectory.poses
    inside = (log.times >= times[0]) & (log.times <= times[-1])
    at = np.searchsorted(times, log.times)
    count = np.searchsorted(times, log.times, side="right") - at
    turn = np.arange(len(log)) - np.searchsorted(log.times, log.times)  # among those of its time
    exact, matches = count > 0, at + np.minimum(turn, count - 1)
    nearest, off = nearest_in_time(times, log.times)
    close = off <= tolerance_of(log, tolerance)
    then = between(log.times, log.odometry, times[nearest])
    moved = composed(poses[nearest], relative(then, log.odometry))
    after = np.clip(at, 1, max(times.size - 1, 1))
    before = after - 1
    after = np.minimum(after, times.size - 1)
    gone = np.interp(times, log.times, log.driven)
    near = np.hypot(*(poses[after] - poses[before])[:, :2].T) < gap
    near &= gone[after] - gone[before] < gap  # a robot may come back to where it was
    among = inside & near & ~exact
    if not (exact | close | among).any():
        if inside.any():
            raise InputError(
                f"the poses of the reference {trajectory.source} around the records of "
                f"{log.source} are {gap:g} {log.unit} apart or farther, which is max_gap: give a "
                "larger one."
            )
        raise InputError(
            f"the reference {trajectory.source} covers {times[0]:.2f} s to {times[-1]:.2f} s, but "
            f"{log.source} {log.times[0]:.2f} s to {log.times[-1]:.2f} s: no record has a "
            "reference pose, so give the reference of this log, with the same clock."
        )
    first, last = before[among], after[among]
    part, whole, share = _travelled(log, times, among, first, last)
    missed = relative(poses[first], poses[last]) - whole
    missed[:, 2] = arrays.wrapped(missed[:, 2])
    truth = np.full((len(log), 3), np.nan)
    truth[close], truth[exact] = moved[close], poses[matches[exact]]
    truth[among] = composed(poses[first], part + share[:, None] * missed)
    done = replace(log, reference=truth, interpolated=among & ~close)
    raw_records.warn_of_few(done, trajectory.source)
    jumps = np.flatnonzero(jumps_in(times, poses, log.unit))
    if jumps.size:
        steps = np.hypot(*np.diff(poses[:, :2], axis=0)[jumps].T)
        tell(
            f"the reference {trajectory.source} jumps farther than a robot drives, "
            f"{times_words(jumps.size)}, first at {times[jumps[0] + 1]:.2f} s, by up to "
            f"{steps.max():.2f} {log.unit}: what is before or after may be wrong, and so are "
            "errors there."
        )
    return done


def with_own_reference(
    log: Log, rows: ArrayLike, max_gap: float | None = None, tolerance: float | None = None
) -> Log:
    """Return the log with the poses in its own file, rows t, x, y, θ, (k, 4); none if k = 0.

    These are messages of their own, with stamps of their own: see ``referenced``.
    """
    poses = np.asarray(rows, dtype=np.float64).reshape(-1, 4)
    if not len(poses):
        return log
    return referenced(log, sound_poses(poses, log.source, Counter()), max_gap, tolerance)


def _travelled(
    log: Log, times: Floats, among: Bools, first: Indices, last: Indices
) -> tuple[Floats, Floats, Floats]:
    """Return the odometry at records and ``last``, seen from ``first``, and share of the way."""
    x, y, heading = log.odometry.T
    elapsed = log.way + 1e-9 * (log.times - log.times[0])  # grows a little while it stands still
    columns = (x, y, np.unwrap(heading), elapsed)
    *at, way = (np.interp(times, log.times, column) for column in columns)
    odometry = np.column_stack(at)
    part = relative(odometry[first], log.odometry[among])
    whole = relative(odometry[first], odometry[last])
    beyond = (times[first] < log.times[0]) | (times[last] > log.times[-1])
    part[beyond] = whole[beyond] = 0.0
    gone = np.where(beyond, log.times[among] - times[first], elapsed[among] - way[first])
    length = np.where(beyond, times[last] - times[first], way[last] - way[first])
    return part, whole, np.divide(gone, length, out=np.zeros_like(length), where=length > 0)
