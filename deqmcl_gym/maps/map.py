"""The ground under both packages: the interface of a map, units of length.

Constant lengths in the code are in pixels of the paper's room, where the robot has a radius of 8,
and are multiplied by ``pixel(unit)`` where they are used. In metres, a pixel is 2 cm: the same
robot has a radius of 16 cm.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from functools import cache
from itertools import pairwise
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.maps.drive_kernels import directed, put
from deqmcl_gym.numerics import Bools, Floats, Ints, Singles, T
from deqmcl_gym.validation import InputError, integer, keep_plain, number, one_of, real

_LARGEST_HEADING = 1e3  # rad: float32 resolves 6e-5 there

Box = tuple[float, float, float, float]  # x_low, y_low, x_high, y_high
PIXELS: Mapping[str, float] = MappingProxyType({"px": 1.0, "m": 0.02})

# metadata of dataclass fields that are lengths, or numbers per length
LENGTH: Mapping[str, int] = MappingProxyType({"length": 1})  # also for all numbers in a tuple
PER_LENGTH: Mapping[str, int] = MappingProxyType({"length": -1})
SQUARE: Mapping[str, int] = MappingProxyType({"length": 2})
PER_SQUARE: Mapping[str, int] = MappingProxyType({"length": -2})
POSE: Mapping[str, tuple[int, ...]] = MappingProxyType({"length": (1, 1, 0)})


def bounded(
    default: Any = dataclasses.MISSING, kind: Mapping[str, Any] | None = None, **bounds: Any
) -> Any:
    """Return a field of a :class:`Part`: a number in these bounds, whole if ``default`` is."""
    return dataclasses.field(default=default, metadata={**(kind or {}), "bounds": bounds})


class Part:
    """A frozen dataclass whose numbers are plain ones, each within its bounds."""

    _called: ClassVar[str]  # pattern of what sentences call a field

    def __init_subclass__(cls, called: str = "") -> None:
        cls._called = called or cls._called

    def __post_init__(self) -> None:
        keep_plain(self)
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            if "bounds" in field.metadata:
                what, value = self._called.format(field.name), getattr(self, field.name)
                check = integer if isinstance(field.default, int) else number
                check(what, value, **field.metadata["bounds"])


def pixel(unit: str) -> float:
    """Return the length of a pixel of the paper's room in a unit."""
    return PIXELS[one_of("unit of length", unit, PIXELS)]


@cache
def metre(unit: str) -> float:
    """Return how many of a map's units are a metre; a pixel of the paper's room is 2 cm."""
    return pixel(unit) / pixel("m")


def scaled(part: T, factor: float) -> T:
    """Return a frozen dataclass with its lengths, nested ones too, multiplied by ``factor``."""
    changes: dict[str, Any] = {}
    for field in dataclasses.fields(part):  # type: ignore[arg-type]
        value = getattr(part, field.name)
        if dataclasses.is_dataclass(value):
            changes[field.name] = scaled(value, factor)
        elif isinstance(value, tuple) and all(map(dataclasses.is_dataclass, value)):
            changes[field.name] = tuple(scaled(item, factor) for item in value)
        elif value is not None and (power := field.metadata.get("length")):
            changes[field.name] = _times(value, power, factor)
    return dataclasses.replace(part, **changes)  # type: ignore[type-var]


def _times(value: Any, power: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        powers = power if isinstance(power, tuple) else (power,) * len(value)
        return tuple(_times(length, p, factor) for length, p in zip(value, powers, strict=True))
    for _ in range(abs(power)):
        value = value * factor if power > 0 else value / factor
    return value


def table(what: str, rows: ArrayLike, columns: int) -> NDArray[Any]:
    """Return ``rows`` as an array (n, ``columns`` or more), else refuse it; NaN may be in it."""
    given = real(what, rows)
    if given.ndim != 2 or given.shape[1] < columns:
        raise InputError(
            f"{what} have shape {given.shape}, but must have shape (n, {columns}): a row for each."
        )
    return given


Caster = Callable[[Singles, Singles, Singles], None]  # of poses, bearings and out: ``Map.cast``


class Map:
    """The map m: what it is asked is checked, then a kernel of one of its forms answers.

    Lengths are in its ``unit``; y points up, headings are in rad from +x. All methods take many
    items at once and compute in float32. A map of one's own needs ``collides`` to roll out motions
    and plans.
    """

    @property
    def unit(self) -> str:
        """The unit of all lengths: "px" or "m"."""
        raise NotImplementedError

    @property
    def bounds(self) -> Box:
        """Smallest box around the building: (x_low, y_low, x_high, y_high)."""
        raise NotImplementedError

    @property
    def walls(self) -> Floats:
        """All walls as segments (x0, y0, x1, y1), free space to their left, (S, 4)."""
        raise NotImplementedError

    def cast(self, poses: Singles, bearings: Singles, out: Singles) -> None:
        """Fill in the distance of each beam to the nearest wall, (B, n); ∞ if none, NaN outside.

        Poses are rows x, y, θ, (3, n), bearings (B,) rad.
        """
        raise NotImplementedError

    def ranges(self, poses: ArrayLike, bearings: ArrayLike) -> Singles:
        """Exact distance along each beam to the nearest wall, (n, B); ∞ if none, NaN outside.

        Rays from inside an obstacle end at its walls. Poses are (n, 3), bearings (B,) rad.
        """
        origins = table("poses", poses, 3)[:, :3]
        beams = np.asarray(bearings, dtype=np.float32)
        if beams.ndim != 1:
            raise InputError(f"bearings have shape {beams.shape}, but must have shape (B,).")
        farthest = np.abs(origins[:, 2]).max(initial=0.0)
        if _LARGEST_HEADING < farthest < math.inf:  # with ∞ or NaN, a pose sees nothing
            raise InputError(
                f"a heading of poses is {farthest:g} rad, but must be from -{_LARGEST_HEADING:g} "
                f"to {_LARGEST_HEADING:g}: wrap it to [-π, π]."
            )
        out = np.empty((beams.size, len(origins)), np.float32)
        self.cast(self._rows(origins), beams, out)
        return out.T

    def collides(self, starts: ArrayLike, ends: ArrayLike, radius: float) -> Bools:
        """Whether a disc swept from ``starts`` to ``ends`` touches a wall or ends in a solid, (n,).

        These are its centres, (n, 2); further columns are ignored.
        """
        before, after = self._points("starts", starts), self._points("ends", ends)
        number("radius", radius, low=0)
        if before.shape[1] != after.shape[1]:
            raise InputError(
                f"there are {before.shape[1]} starts and {after.shape[1]} ends: give as many of "
                "both."
            )
        return ~self._feasible(before, after, radius)

    def free(self, points: ArrayLike, radius: float = 0.0) -> Bools:
        """Whether a disc at each of ``points``, (n, 2+), is in free space, clear of walls, (n,)."""
        centres = self._points("points", points)
        if number("radius", radius, low=0) > 0.0:
            return self._feasible(centres, centres, radius)
        return self._open(centres)

    def distance(self, points: ArrayLike) -> Singles:
        """Distance of ``points``, (n, 2+), to the nearest wall, from either side, (n,)."""
        raise NotImplementedError

    def collisions_along(self, poses: Singles, path: Singles, radius: float) -> Ints:
        """Number of steps that collide on a path laid from each pose, (n,).

        Poses are rows x, y, θ, (3, n), the path points in the frame of each, (k + 1, 2), k ≥ 1.
        """
        number("radius", radius, low=0)
        if poses.shape != (3, poses.size // 3) or path.shape != (len(path), 2) or len(path) < 2:
            raise InputError(
                f"poses have shape {poses.shape} and the path {path.shape}, but they must be "
                "(3, n) and (k + 1, 2) with k ≥ 1."
            )
        return self._collisions_along(poses, path, radius)

    def _points(self, what: str, points: ArrayLike) -> NDArray[Any]:
        """Return points (n, 2+) as rows x, y."""
        return self._rows(table(what, points, 2)[:, :2])

    def _rows(self, points: NDArray[Any]) -> NDArray[Any]:
        """Return (n, d) as contiguous rows (d, n) for kernels, without a copy if possible."""
        return np.asarray(points, dtype=np.float32, order="F").T

    def _open(self, centres: NDArray[Any]) -> Bools:
        """Whether points (2, n) are in free space, (n,)."""
        raise NotImplementedError

    def _feasible(self, starts: NDArray[Any], ends: NDArray[Any], radius: float) -> Bools:
        """Whether a disc swept from ``starts`` to ``ends``, (2, n), stays in free space, (n,)."""
        raise NotImplementedError

    def _collisions_along(self, poses: Singles, path: Singles, radius: float) -> Ints:
        """Do ``collisions_along``; ask ``collides`` for each step."""
        rows, hits = np.empty((4, poses.shape[1]), np.float32), np.zeros(poses.shape[1], np.int32)
        directed(poses, rows)
        laid = np.empty((len(path), 2, poses.shape[1]), np.float32)
        for place, points in zip(path, laid, strict=True):
            put(rows, place, points)
        for start, end in pairwise(laid):
            hits += self.collides(start.T, end.T, radius)
        return hits
