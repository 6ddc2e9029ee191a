"""Map: the interface of a floor plan, of polygons or of cells."""

from typing import Protocol, runtime_checkable

from numpy.typing import ArrayLike

from deqmcl_gym.numerics.types import Bools, Floats, Ints, Singles

Box = tuple[float, float, float, float]  # x_low, y_low, x_high, y_high
Point = tuple[float, float]


class Caster(Protocol):
    """Ray casting on one map into given arrays."""

    def cast(self, poses: Singles, bearings: Singles, out: Singles) -> None:
        """Fill in the distance of each beam to the nearest wall; ∞ if none, NaN outside.

        Args:
            poses: rows x, y, θ, (3, n).
            bearings: (B,) rad.
            out: (B, n).
        """
        ...


@runtime_checkable
class Map(Protocol):
    """The map m. Lengths are in its :attr:`unit`, y points up, headings in rad from +x.

    All methods take many items at once and compute in float32, in coordinates about :attr:`datum`.
    """

    @property
    def unit(self) -> str:
        """The unit of all lengths: "px" or "m"."""
        ...

    @property
    def bounds(self) -> Box:
        """Smallest box around the building: (x_low, y_low, x_high, y_high)."""
        ...

    @property
    def datum(self) -> Point:
        """Origin for float32 coordinates: (0, 0), or a point of a map that is far from there."""
        ...

    @property
    def local(self) -> "Map":
        """The same map with (0, 0) at its datum, for float32 poses relative to the datum."""
        ...

    @property
    def walls(self) -> Floats:
        """All walls as segments (x0, y0, x1, y1), free space to their left, (S, 4).

        For physics and drawing; estimators do not need it.
        """
        ...

    @property
    def caster(self) -> Caster:
        """The ray caster of this map."""
        ...

    def ranges(self, poses: ArrayLike, bearings: ArrayLike) -> Singles:
        """Exact distance along each beam to the nearest wall; ∞ if none, NaN for a pose outside.

        Rays from inside an obstacle end at its walls.

        Args:
            poses: (n, 3).
            bearings: angles of the beams against the heading, (B,) rad.

        Returns:
            (n, B).
        """
        ...

    def collides(self, starts: ArrayLike, ends: ArrayLike, radius: float) -> Bools:
        """Whether a disc swept from ``starts`` to ``ends`` touches a wall or ends in solid space.

        Args:
            starts, ends: centres of the disc, (n, 2); further columns are ignored.
            radius: of the disc.

        Returns:
            (n,).
        """
        ...

    def free(self, points: ArrayLike, radius: float = 0.0) -> Bools:
        """Whether a disc at each of ``points``, (n, 2+), lies in free space, clear of the walls.

        Returns:
            (n,).
        """
        ...

    def distance(self, points: ArrayLike) -> Singles:
        """Distance of ``points``, (n, 2+), to the nearest wall, from either side, (n,)."""
        ...


@runtime_checkable
class RollOuts(Protocol):
    """Optional methods of a map: ``collides`` for many steps in one pass, with the same bits."""

    def rolled_out(
        self, poses: Singles, moves: Singles, radius: float, *, kept: int
    ) -> tuple[Singles, Ints]:
        """Drive poses through several moves: ``driven`` and ``collides`` for each, in one pass.

        Args:
            poses: rows x, y, θ, (3, n) float32.
            moves: increments (forward, left, turn) of each step, (F, 3, n) float32.
            radius: of the disc.
            kept: F to return the poses after each step, 1 for those after the last only.

        Returns:
            The poses, (kept, 3, n), and how many steps of each collide, (n,).
        """
        ...

    def collisions_along(self, poses: Singles, path: Singles, radius: float) -> Ints:
        """Number of steps that collide on a path laid from each pose: ``collides``, in one pass.

        Args:
            poses: rows x, y, θ, (3, n) float32.
            path: points in the frame of the pose, (k + 1, 2) float32, k ≥ 1.
            radius: of the disc.

        Returns:
            (n,).
        """
        ...
