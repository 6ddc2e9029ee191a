"""Lidar: where the beams of a robot's scanners start and point, and what counts as a reading."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.maps.drive_kernels import directed, put
from deqmcl_gym.maps.map import LENGTH, Caster, Map, Part, bounded
from deqmcl_gym.numerics import Bools, Floats, Point, Singles, arrays
from deqmcl_gym.numerics.elementary import cos64, sin64
from deqmcl_gym.validation import InputError, array, boolean, integer, number, part, shown

CENTRE = (0.0, 0.0)
_TURN = 2 * math.pi
_SLACK = 1e-9  # rad


@dataclass(frozen=True, kw_only=True)
class Mount(Part, called="{} of a mount"):
    """A scanner on the robot. Lengths are in the map's unit, angles in rad."""

    x: float = bounded(0.0, LENGTH)  #: where its rays start, ahead of the centre
    y: float = bounded(0.0, LENGTH)  #: and left of the robot's centre
    #: of the scanner against the robot's, rad
    heading: float = bounded(0.0, low=-_TURN, high=_TURN)
    upside_down: bool = False  #: its angles count clockwise, seen from above
    beams: int | None = None  #: its beams; None: an equal share of the lidar's
    blind: tuple[tuple[float, float], ...] = ()  #: sectors (from, to) without readings, rad

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "upside_down", boolean("upside_down", self.upside_down))
        if self.beams is not None:
            integer("beams of a mount", self.beams, low=1, high=100_000)
        none = isinstance(self.blind, list | tuple) and not self.blind
        sectors = [] if none else array("blind of a mount", self.blind, (None, 2)).tolist()
        if any(abs(end) > _TURN for sector in sectors for end in sector):
            raise InputError(
                f"blind of a mount is {shown(self.blind)}, but must have angles from -2π to 2π rad."
            )
        object.__setattr__(self, "blind", tuple(map(tuple, sectors)))

    @classmethod
    def of(cls, given: Any) -> "Mount":
        """Return a mount of itself, a mapping of its attributes, or a row (x, y, heading)."""
        if isinstance(given, cls | Mapping):
            return part("a mount of a lidar", cls, given, cls())
        x, y, heading = array("a mount of a lidar", given, (3,)).tolist()
        return cls(x=x, y=y, heading=heading)

    def seen(self, own: Floats) -> Floats:
        """Return the angles against the robot's heading, in [-π, π], of the scanner's own."""
        return arrays.wrapped(self.heading - own if self.upside_down else self.heading + own)

    def hides(self, bearings: Floats) -> Bools:
        """Return which beams, by their angles against the robot's heading, are blind, (B,)."""
        angles = bearings - self.heading
        angles = -angles if self.upside_down else angles
        hidden = np.zeros(angles.shape, np.bool_)
        for low, high in self.blind:
            hidden |= np.mod(angles - low + _SLACK, _TURN) <= np.mod(high - low, _TURN) + 2 * _SLACK
        return hidden


@dataclass(frozen=True, kw_only=True)
class Lidar(Part, called="lidar.{}"):
    """A fan of range beams, centred on the robot's heading, or one fan for each of its mounts.

    Lengths are in the map's unit. The defaults are the paper preset's, in px. With a field of view
    of 2π the beams are spread evenly, with only one at the back. Noise is added before clipping to
    [0, max_range]. Rays start at ``mounting``, ahead and left of the robot's centre, or at each of
    ``mounts``, a :class:`Mount`, a mapping or a row (x, y, heading); their beams follow in turn.
    """

    #: number of beams, of all mounts together; a single one looks straight ahead
    beams: int = bounded(1, low=1, high=100_000)
    #: angle between the outermost beams, rad
    field_of_view: float = bounded(math.pi / 2, low=0, high=_TURN, above=True)
    max_range: float = bounded(400.0, LENGTH, low=0, above=True)  #: largest range reported
    sigma: float = bounded(100.0, LENGTH, low=0)  #: standard deviation of the range noise
    #: where on the robot the rays start, ahead and left of its centre
    mounting: tuple[float, float] = field(default=CENTRE, metadata=LENGTH)
    mounts: tuple[Mount, ...] = ()  #: several scanners, or a turned one, instead of ``mounting``
    min_range: float = field(default=0.0, metadata=LENGTH)  #: shorter readings are lost: +inf

    def __post_init__(self) -> None:
        super().__post_init__()
        number("lidar.min_range", self.min_range, low=0, high=self.max_range)
        ahead, aside = array("lidar.mounting", self.mounting, (2,)).tolist()
        object.__setattr__(self, "mounting", (ahead, aside))
        if not isinstance(self.mounts, list | tuple):
            raise InputError(
                f"lidar.mounts is {shown(self.mounts)}, but must be a list of mounts, each with "
                "x, y and heading."
            )
        object.__setattr__(self, "mounts", tuple(map(Mount.of, self.mounts)))
        if self.mounts:
            self._check_mounts()

    def _check_mounts(self) -> None:
        if self.mounting != CENTRE:
            raise InputError(
                f"lidar.mounting is {self.mounting} and lidar.mounts has {len(self.mounts)}: give "
                "only one of them."
            )
        counts = [mount.beams for mount in self.mounts if mount.beams is not None]
        each = len(self.mounts)
        if not counts and self.beams % each:
            raise InputError(
                f"lidar.beams is {self.beams}, but must be a multiple of {each}, the number of its "
                "mounts, unless each mount has its own beams."
            )
        if counts and (len(counts) != each or sum(counts) != self.beams):
            raise InputError(
                f"lidar.beams is {self.beams} and its {each} mounts have "
                f"{', '.join(map(str, counts))}: give beams to none or to all, with the sum as "
                "lidar.beams."
            )

    @property
    def bearings(self) -> Floats:
        """Angles of the beams against the robot's heading, counterclockwise, (beams,) rad.

        Ascending if there are no mounts.
        """
        if not self.mounts:
            return _fan(self.beams, self.field_of_view)
        fans = [
            mount.seen(_fan(rows.stop - rows.start, self.field_of_view))
            for mount, rows in zip(self.mounts, self.rows, strict=True)
        ]
        return np.concatenate(fans)

    @cached_property
    def places(self) -> tuple[Point, ...]:
        """Where on the robot the rays start, a place for each mount."""
        return tuple((mount.x, mount.y) for mount in self.mounts) or (self.mounting,)

    @cached_property
    def rows(self) -> tuple[slice, ...]:
        """The beams of each of ``places``."""
        share = self.beams // max(len(self.mounts), 1)
        counts = [mount.beams or share for mount in self.mounts] or [self.beams]
        ends = np.cumsum(counts).tolist()
        return tuple(slice(end - count, end) for end, count in zip(ends, counts, strict=True))

    @cached_property
    def blind(self) -> Bools:
        """Which beams lie in a blind sector of their mount, (beams,)."""
        hidden, bearings = np.zeros(self.beams, np.bool_), self.bearings
        for mount, rows in zip(self.mounts, self.rows, strict=False):
            hidden[rows] = mount.hides(bearings[rows])
        return hidden

    @cached_property
    def loses(self) -> bool:
        """Whether it may lose readings: in a blind sector, or below ``min_range``."""
        return self.min_range > 0 or bool(self.blind.any())

    def lose(self, ranges: NDArray[Any], blind: float = math.inf) -> None:
        """Overwrite readings (..., beams), blind ones by ``blind``, below ``min_range`` by +inf."""
        if self.loses:
            ranges[..., self.blind] = blind
            ranges[ranges < np.float32(self.min_range)] = np.inf

    def fans(
        self, poses: NDArray[Any], used: Bools | None = None
    ) -> list[tuple[NDArray[Any], slice]]:
        """Return, for each mount, where its rays start, (3, n), and its rows of the beams used.

        Poses are the robot's, (3, n); ``used`` says which beams are, (beams,); None: all.
        """
        fans, end = [], 0
        for place, rows in zip(self.places, self.rows, strict=True):
            size = rows.stop - rows.start if used is None else int(np.count_nonzero(used[rows]))
            starts = poses
            if place != CENTRE:
                starts = np.array(poses, np.float32, order="C")
                robots = np.empty((4, poses.shape[1]), np.float32)
                directed(starts, robots)
                put(robots, np.array(place, np.float32), starts)
            fans.append((starts, slice(end, end + size)))
            end += size
        return fans

    def cast(self, caster: Caster, poses: Singles, out: Singles, used: Bools | None = None) -> None:
        """Fill in the exact ranges of robots at ``poses`` (3, n) float32, (b, n).

        ``used`` says which b of the beams are cast; None: all. See ``Map.cast`` for ∞ and NaN.
        """
        bearings = self._singles if used is None else self._singles[used]
        if self.places == (CENTRE,):
            caster(np.ascontiguousarray(poses, dtype=np.float32), bearings, out)
            return
        for origins, rows in self.fans(poses, used):
            start = np.ascontiguousarray(origins, dtype=np.float32)
            caster(start, bearings[rows], out[rows])

    def ranges(self, floor_plan: Map, poses: NDArray[Any], used: Bools | None = None) -> Singles:
        """Return the exact ranges of robots at ``poses`` (3, n) on a map, (n, b).

        ``used`` says which b of the beams are cast; None: all. ∞ where there is no wall, NaN where
        a ray starts outside.
        """
        bearings = self.bearings if used is None else self.bearings[used]
        seen = [
            floor_plan.ranges(origins.T, bearings[rows]) for origins, rows in self.fans(poses, used)
        ]
        return seen[0] if len(seen) == 1 else np.concatenate(seen, axis=1)

    def rays(self, pose: ArrayLike) -> Floats:
        """Return where each ray of a robot at ``pose`` (x, y, θ) starts and points, (beams, 3)."""
        x, y, heading = np.asarray(pose, dtype=np.float64).tolist()
        cosine, sine = cos64(heading), sin64(heading)
        out = np.empty((self.beams, 3))
        for (ahead, aside), rows in zip(self.places, self.rows, strict=True):
            out[rows, 0] = x + (ahead * cosine - aside * sine)
            out[rows, 1] = y + (ahead * sine + aside * cosine)
        out[:, 2] = heading + self.bearings
        return out

    @cached_property
    def _singles(self) -> Singles:
        return self.bearings.astype(np.float32)


def _fan(beams: int, field_of_view: float) -> Floats:
    """Return the angles of a scanner's beams, ascending, (beams,)."""
    if beams == 1:
        return np.zeros(1)
    half = field_of_view / 2
    full_circle = field_of_view > _TURN - 1e-9
    return np.linspace(-half, half, beams, endpoint=not full_circle)
