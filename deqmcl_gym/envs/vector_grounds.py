"""Grounds: the maps of many rooms as flat arrays, one for all or one for each."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from deqmcl_gym.envs import vector_kernels as kernels
from deqmcl_gym.maps import GridMap
from deqmcl_gym.maps.map import Caster
from deqmcl_gym.numerics.types import Floats, Indices, Singles
from deqmcl_gym.world.config import World


class Grounds:
    """What is there in each of n rooms: walls or cells, for contacts, drivers and beams.

    Attributes:
        maps: what is there in each room; not the map where the world differs from it.
    """

    def __init__(self, world: World, rooms: int, own: bool) -> None:
        """Put what the world has into all rooms; ``own``: each may be given another one."""
        self.maps = [world.floor_plan] * rooms
        self._own = own
        self._datums = np.zeros((rooms, 3))
        slots = rooms if own else 1
        self.numbers = kernels.GroundRows(
            slots=np.arange(rooms) if own else np.zeros(rooms, np.intp),
            sizes=np.zeros((slots, 3)),
            walls=np.empty((slots, 0, 5)),
            counts=np.zeros(slots, np.intp),
            cells=kernels.Cells(
                reach=np.empty((slots, 0), np.uint8),
                up=np.empty((slots, 0), np.int16),
                down=np.empty((slots, 0), np.int16),
                sight=np.empty((slots, 0), np.uint8),
                shapes=np.zeros((slots, 2), np.intp),
                frames=np.ones((slots, 5)),
                yaws=np.zeros(slots),
                endless=np.zeros(slots, np.bool_),
            ),
        )
        for room in range(slots):
            self._fill(room, world)
        self._datums[:, :2] = world.floor_plan.datum

    @property
    def kernel(self) -> tuple[Any, ...]:
        """``numbers`` as plain tuples, as kernels take them."""
        return tuple(self.numbers._replace(cells=tuple(self.numbers.cells)))

    @staticmethod
    def bytes_each(world: World) -> int:
        """Approximate memory of a map of a room's own, rounded up."""
        ground = world.floor_plan
        if isinstance(ground, GridMap):
            return 8 * ground.occupancy.size
        return 80 * len(ground.walls)

    def put(self, room: int, world: World) -> None:
        """Put what is there in a world into a room."""
        if self.maps[room] is not world.floor_plan:
            assert self._own
            self.maps[room] = world.floor_plan
            self._datums[room, :2] = world.floor_plan.datum
            self._fill(room, world)

    def local(self, rooms: Indices, poses: Floats) -> Singles:
        """Return ``poses`` (k, 3) of ``rooms`` as casters take them, (3, k)."""
        return (poses - self._datums[rooms]).T.astype(np.float32, order="C")

    def caster(self, rooms: Indices) -> Caster:
        """Return a caster for one pose in each of ``rooms`` (k,), in this order."""
        if not self._own:
            return self.maps[0].local.caster
        if isinstance(self.maps[0], GridMap):
            return _AmongCells(tuple(self.numbers.cells), rooms)
        return _AmongWalls([self.maps[room].local.caster for room in rooms.tolist()])

    def _fill(self, slot: int, world: World) -> None:
        ground, numbers = world.floor_plan, self.numbers
        numbers.sizes[slot] = world.body, world.skin, world.reach
        if isinstance(ground, GridMap):
            self._fill_cells(slot, ground)
            return
        sides = kernels.sides(ground.walls)
        self.numbers = numbers = numbers._replace(walls=wide(numbers.walls, len(sides)))
        numbers.walls[slot, : len(sides)], numbers.counts[slot] = sides, len(sides)

    def _fill_cells(self, slot: int, ground: GridMap) -> None:
        reach, up, down, frame = ground.cells
        sight, endless = ground.sight
        size, cells = reach.size, self.numbers.cells
        cells = cells._replace(
            reach=wide(cells.reach, size), up=wide(cells.up, size),
            down=wide(cells.down, size), sight=wide(cells.sight, size),
        )  # fmt: skip
        self.numbers = self.numbers._replace(cells=cells)
        for values, row in ((reach, cells.reach), (up, cells.up), (down, cells.down)):
            row[slot, :size] = values.reshape(-1)
        cells.sight[slot, :size] = sight.reshape(-1)
        cells.shapes[slot], cells.frames[slot] = reach.shape, frame
        cells.yaws[slot], cells.endless[slot] = ground.origin[2], endless


def wide(values: Any, size: int) -> Any:
    """Return (slots, s, …) values with at least ``size`` places for each slot."""
    if values.shape[1] >= size:
        return values
    wider = np.zeros((len(values), size, *values.shape[2:]), values.dtype)
    wider[:, : values.shape[1]] = values
    return wider


@dataclass(frozen=True, eq=False)
class _AmongCells:
    """A caster of poses in rooms of cells, one in each."""

    cells: tuple[Any, ...]
    rooms: Indices

    def cast(self, poses: Singles, bearings: Singles, out: Singles) -> None:
        """See ``deqmcl_gym.maps.map.Caster``."""
        kernels.cast(poses, bearings, self.cells, self.rooms, out)


@dataclass(frozen=True, eq=False)
class _AmongWalls:
    """A caster of poses in rooms of walls, one in each."""

    casters: list[Caster]

    def cast(self, poses: Singles, bearings: Singles, out: Singles) -> None:
        """See ``deqmcl_gym.maps.map.Caster``."""
        single = np.empty((bearings.size, 1), np.float32)
        for i, caster in enumerate(self.casters):
            caster.cast(np.ascontiguousarray(poses[:, i : i + 1]), bearings, single)
            out[:, i : i + 1] = single
