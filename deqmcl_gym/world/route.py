"""Routes on a map: the shortest way from one place to another that keeps clear of walls."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from deqmcl_gym.maps.map import Map
from deqmcl_gym.maps.units import pixel
from deqmcl_gym.numerics.types import Bools, Floats, Indices
from deqmcl_gym.validation import InputError

_CELL = 5.0  # px: 0.1 m
_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))  # the other four are these backwards
_COST_OF_WALLS = 4.0  # how much longer a way may be that stays where there is room


@dataclass(frozen=True)
class Routes:
    """All routes of a robot on a map, planned on cells of 0.1 m (5 px).

    Cells where the robot does not fit are left out. Those nearer to a wall than ``comfort`` cost up
    to five times their length, so that routes keep to the middle of doors and corridors.

    Attributes:
        floor_plan: the map.
        radius: the least distance to walls, the robot's radius with some room for its noise.
        comfort: distance to walls that is large enough.
    """

    floor_plan: Map
    radius: float
    comfort: float

    def between(self, start: tuple[float, float], goal: tuple[float, float]) -> Floats:
        """Return the corners of the route, start and goal included, (k, 2).

        Raises:
            InputError: start or goal is not in free space, or there is no way.
        """
        from scipy.sparse.csgraph import dijkstra

        first, last = (self._node(what, at) for what, at in (("start", start), ("goal", goal)))
        _, before = dijkstra(self._graph, directed=False, indices=last, return_predecessors=True)
        nodes = [first]
        while nodes[-1] != last:
            following = before[nodes[-1]]
            if following < 0:
                raise InputError(
                    f"there is no way from ({start[0]:g}, {start[1]:g}) to ({goal[0]:g}, "
                    f"{goal[1]:g}) for a robot that needs {self.radius:g} "
                    f"{self.floor_plan.unit} of room on either side."
                )
            nodes.append(int(following))
        points = np.vstack([start, self._centres[nodes[1:-1]], goal])
        return points[self._corners(points)]

    def _corners(self, points: Floats) -> Indices:
        """Leave out points that a straight way may pass by without coming nearer to walls."""
        room = np.minimum(self.floor_plan.distance(points), self.comfort)
        kept = [0]
        while kept[-1] < len(points) - 1:
            here = kept[-1]
            least = np.minimum.accumulate(room[here:])[1:]
            seen = self._in_sight(points[here], points[here + 1 :], least)
            kept.append(here + 1 + int(np.flatnonzero(seen)[-1]) if seen.any() else here + 1)
        return np.array(kept)

    def _in_sight(self, start: Floats, ends: Floats, room: Floats) -> Bools:
        """Whether discs of radii ``room``, less a cell, can go straight to ``ends``."""
        shares = np.linspace(0.0, 1.0, 1 + int(np.ceil(np.abs(ends - start).max() / self._cell)))
        ways = start + shares[:, None, None] * (ends - start)
        nearest = self.floor_plan.distance(ways.reshape(-1, 2)).reshape(len(shares), -1)
        seen: Bools = nearest.min(axis=0) >= np.maximum(room - self._cell, self.radius)
        return seen

    def _node(self, what: str, at: tuple[float, float]) -> int:
        x_low, y_low, _, _ = self.floor_plan.bounds
        columns, rows = self._numbers.shape[1], self._numbers.shape[0]
        column, row = ((at[i] - low) / self._cell for i, low in enumerate((x_low, y_low)))
        node = -1
        if 0 <= column < columns and 0 <= row < rows:
            node = int(self._numbers[int(row), int(column)])
        if node < 0:
            raise InputError(
                f"the {what} ({at[0]:g}, {at[1]:g}) is less than {self.radius:g} "
                f"{self.floor_plan.unit} from a wall, or outside: give a place in free space."
            )
        return node

    @cached_property
    def _cell(self) -> float:
        return _CELL * pixel(self.floor_plan.unit)

    @cached_property
    def _room(self) -> Floats:
        """Distance to walls at the centre of each cell; 0 where the robot does not fit."""
        x_low, y_low, x_high, y_high = self.floor_plan.bounds
        across, up = (
            low + self._cell * (np.arange(int((high - low) / self._cell)) + 0.5)
            for low, high in ((x_low, x_high), (y_low, y_high))
        )
        centres = np.stack(np.meshgrid(across, up), axis=-1)
        points = centres.reshape(-1, 2)
        room = np.where(
            self.floor_plan.free(points, self.radius), self.floor_plan.distance(points), 0
        )
        return room.reshape(centres.shape[:2]).astype(np.float64)

    @cached_property
    def _numbers(self) -> Indices:
        """Number of each free cell, -1 elsewhere, (rows, columns)."""
        free = self._room > 0
        return np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)

    @cached_property
    def _centres(self) -> Floats:
        rows, columns = np.nonzero(self._numbers >= 0)
        x_low, y_low, _, _ = self.floor_plan.bounds
        return np.column_stack(
            [x_low + (columns + 0.5) * self._cell, y_low + (rows + 0.5) * self._cell]
        )

    @cached_property
    def _graph(self) -> Any:
        """Lengths of the ways between neighbouring cells, weighted; sparse, one direction each."""
        from scipy.sparse import coo_array

        room, numbers = self._room, self._numbers
        dear = 1 + _COST_OF_WALLS * np.clip(1 - room / self.comfort, 0, 1)
        starts, ends, costs = [], [], []
        for down, right in _NEIGHBOURS:
            here, there = _shifted(numbers, down, right)
            fits = (here >= 0) & (there >= 0)
            starts.append(here[fits])
            ends.append(there[fits])
            costs.append(np.hypot(down, right) * sum(_shifted(dear, down, right))[fits] / 2)
        size = len(self._centres)
        values = np.concatenate(costs), (np.concatenate(starts), np.concatenate(ends))
        return coo_array(values, shape=(size, size)).tocsr()


def _shifted(values: Any, down: int, right: int) -> tuple[Any, Any]:
    """Each cell, and the cell ``down`` rows and ``right`` columns from it."""
    rows, columns = values.shape
    left = max(0, -right)
    here = values[: rows - down, left : columns - max(0, right)]
    return here, values[down:, left + right : columns - max(0, right) + right]
