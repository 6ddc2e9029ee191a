"""Office buildings, generated from a seed: rooms with doors along corridors, as cells."""

from dataclasses import dataclass

import numpy as np

from deqmcl_gym.numerics.types import Bools
from deqmcl_gym.validation import InputError, integer, number

CELL = 0.1  # m
_WALL = 2  # cells
_MARGIN = 3  # cells between a door and the corner of its room


@dataclass(frozen=True, kw_only=True)
class Office:
    """What an office building is like. Lengths in m, kept to 0.1 m.

    Horizontal corridors run through the whole building, and vertical ones divide it into wings.
    Between corridors stand rooms, each with a door to one of them, and now and then a hall with
    doors on both sides. Some neighbouring rooms share a door.

    Attributes:
        wings: of rooms, side by side, each about 20 m long.
        corridors: horizontal ones, with loops between them from 2 on.
        corridor: width of all corridors.
        door: width of all doors.
        repeated: all wings are alike; scans then cannot tell one from another.
        symmetric: a half turn of the building gives the same building, exactly.
    """

    wings: int = 2
    corridors: int = 2
    corridor: float = 2.0
    door: float = 0.9
    repeated: bool = False
    symmetric: bool = False

    def __post_init__(self) -> None:
        integer("wings", self.wings, low=1, high=8)
        integer("corridors", self.corridors, low=1, high=6)
        number("corridor", self.corridor, low=0.8, high=10)
        number("door", self.door, low=0.5, high=1.5)
        if self.symmetric and self.wings % 2:
            raise InputError(
                f"wings is {self.wings}, but a symmetric office has as many on either side of its "
                "middle: give an even number."
            )

    def cells(self, rng: np.random.Generator) -> Bools:
        """Draw a building.

        Args:
            rng: the only source of randomness; the same numbers give the same building anywhere.

        Returns:
            True where there is no wall, (rows, columns) of ``CELL``; row 0 is the lowest y. The
            border is wall, and all of the free cells are connected.
        """
        return _building(self, rng)


def _building(office: Office, rng: np.random.Generator) -> Bools:
    depths = _symmetric(_drawn(rng, 40, 60, (office.corridors + 2) // 2), office.corridors + 1)
    way = _cells(office.corridor)
    drawn = office.wings // 2 if office.symmetric else office.wings
    first = _wing(office, depths, rng)
    wings = [
        first,
        *(first if office.repeated else _wing(office, depths, rng) for _ in range(drawn - 1)),
    ]
    if office.symmetric:
        wings += [wing[::-1, ::-1] for wing in reversed(wings)]
    across = np.zeros((len(first), way), dtype=bool)
    across[_WALL:-_WALL] = True  # a vertical corridor, from the lowest wall to the highest
    wall = np.zeros((len(first), _WALL), dtype=bool)
    parts = [part for wing in wings for part in (across, wing)]
    return np.hstack([wall, *parts, across, wall])


def _wing(office: Office, depths: list[int], rng: np.random.Generator) -> Bools:
    """Rows of rooms with the corridors between them, from wall to wall."""
    length = int(rng.integers(160, 241))
    way = np.ones((_cells(office.corridor), length), dtype=bool)
    rows: list[Bools] = []
    for place, depth in enumerate(depths):
        inner = 0 < place < len(depths) - 1
        if inner and rng.integers(4) == 0:
            row = _hall(office, 2 * depth - _WALL, length, rng)
        elif inner:
            low, high = (_rooms(office, depth, length, rng) for _ in range(2))
            row = np.vstack([low, high[::-1][_WALL:]])  # back to back: one wall between them
        else:
            row = _rooms(office, depth, length, rng)
            row = row if place else row[::-1]
        rows += [row, way]
    return np.vstack(rows[:-1])


def _rooms(office: Office, depth: int, length: int, rng: np.random.Generator) -> Bools:
    """A row of rooms whose doors lead down, to a corridor below row 0; walls all round."""
    free = np.zeros((depth, length), dtype=bool)
    door = _cells(office.door)
    left = 0
    while left < length - _WALL:
        width = int(rng.integers(25, 61))
        right = left + _WALL + width  # where the next wall begins
        if length - _WALL - right < _WALL + 25:
            right = length - _WALL
        free[_WALL : depth - _WALL, left + _WALL : right] = True
        place = int(rng.integers(left + _WALL + _MARGIN, right - _MARGIN - door + 1))
        free[:_WALL, place : place + door] = True
        if left and rng.integers(5) == 0:  # a door to the room before
            high = int(rng.integers(_WALL + _MARGIN, depth - _WALL - _MARGIN - door + 1))
            free[high : high + door, left : left + _WALL] = True
        left = right
    return free


def _hall(office: Office, depth: int, length: int, rng: np.random.Generator) -> Bools:
    """One room as long as the wing, with two doors to the corridor on either side."""
    free = np.zeros((depth, length), dtype=bool)
    free[_WALL:-_WALL, _WALL:-_WALL] = True
    door, half = _cells(office.door), length // 2
    for side in (slice(None, _WALL), slice(-_WALL, None)):
        for start in (0, half):
            low, high = start + _WALL + _MARGIN, start + half - _WALL - _MARGIN - door
            place = int(rng.integers(low, high + 1))
            free[side, place : place + door] = True
    return free


def _drawn(rng: np.random.Generator, low: int, high: int, count: int) -> list[int]:
    return [int(value) for value in rng.integers(low, high + 1, count)]


def _symmetric(half: list[int], count: int) -> list[int]:
    """The first ``count`` of values, then of their mirror image."""
    return half[: count // 2] + half[: count - count // 2][::-1]


def _cells(length: float) -> int:
    return round(length / CELL)
