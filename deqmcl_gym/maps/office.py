"""Office buildings, generated from a seed: rooms with doors along corridors."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from deqmcl_gym.maps.grid_file import FREE, OCCUPIED
from deqmcl_gym.maps.grid_map import GridMap
from deqmcl_gym.maps.map import Part, bounded
from deqmcl_gym.numerics import Bools
from deqmcl_gym.validation import InputError, boolean, digits, integer, shown

CELL = 0.1  # m
_WALL = 2  # cells
_MARGIN = 3  # cells between a door and the corner of its room
_PILLAR, _PITCH = 5, 30  # cells: the side of a hall's pillar, and from one to the next
_DEEPEST, _LONGEST = 60, 240  # cells: the most of a room and of a wing


@dataclass(frozen=True, kw_only=True)
class Office(Part, called="office.{}"):
    """An office building. Lengths in m, multiples of 0.1 m.

    Horizontal corridors run through the whole building; vertical ones divide it into wings. Between
    corridors are rooms, each with a door to one corridor, and sometimes a hall with doors on both
    sides, empty or with pillars, or a closed courtyard. Some neighbouring rooms share a door. The
    same values give the same building on every machine.
    """

    seed: int = bounded(0, high=2**63 - 1)  #: of the building
    wings: int = bounded(2, low=1, high=8)  #: 1 to 8, side by side, each 16 to 24 m long
    corridors: int = bounded(2, low=1, high=6)  #: 1 to 6, through all wings; 2 or more form loops
    corridor: float = bounded(2.0, low=0.8, high=10.0)  #: width of all corridors, 0.8 to 10 m
    door: float = bounded(0.9, low=0.7, high=1.5)  #: width of all doors, 0.7 to 1.5 m
    repeated: bool = False  #: all wings are the same, so that scans do not tell them apart
    symmetric: bool = False  #: the same after a half turn; needs an even number of wings

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("corridor", "door"):
            length = getattr(self, name)
            if abs(length - CELL * _cells(length)) > 1e-9:
                raise InputError(
                    f"office.{name} is {digits(length)}, but must be a multiple of {CELL:g} m."
                )
        boolean("office.repeated", self.repeated)
        if boolean("office.symmetric", self.symmetric) and (self.repeated or self.wings % 2):
            raise InputError(
                f"office.symmetric is true with wings = {self.wings} and repeated = "
                f"{str(self.repeated).lower()}, but half of its wings are the others turned: give "
                "an even number of wings, and either symmetric or repeated."
            )

    @property
    def grid(self) -> GridMap:
        """The building in cells of 0.1 m, its lower left corner at (0, 0)."""
        return _grid(self)


@dataclass(frozen=True, kw_only=True)
class Offices:
    """The offices of a range of seeds, from which each episode draws one."""

    seeds: tuple[int, int]  # (first, end): those from first on, end not among them
    office: Office  # all values but the seed

    def __post_init__(self) -> None:
        seeds = self.seeds
        if not isinstance(seeds, list | tuple) or len(seeds) != 2:
            raise InputError(
                f"office.seeds is {shown(seeds)}, but must be two seeds, such as [0, 1000]: the "
                "first one, and the end of the range, which is not in it."
            )
        first = integer("the first of office.seeds", seeds[0], high=2**63 - 2)
        end = integer("the end of office.seeds", seeds[1], low=first + 1, high=2**63 - 1)
        object.__setattr__(self, "seeds", (first, end))

    def map(self, seed: int) -> GridMap:
        """Return the office of a seed."""
        return replace(self.office, seed=seed).grid

    def drawn(self, rng: np.random.Generator) -> int:
        """Draw a seed, all alike."""
        return int(rng.integers(*self.seeds))

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(x0, y0, x1, y1) within which all of them lie; see ``Map``."""
        office, way = self.office, _cells(self.office.corridor)
        width = 2 * _WALL + office.wings * (_LONGEST + way) + way
        rooms = 2 * _DEEPEST + (office.corridors - 1) * (2 * _DEEPEST - _WALL)
        return 0.0, 0.0, width * CELL, (rooms + office.corridors * way) * CELL


@lru_cache(8)
def _grid(office: Office) -> GridMap:
    free = _building(office, np.random.default_rng(office.seed))
    return GridMap(occupancy=np.where(free, FREE, OCCUPIED).astype(np.int8), resolution=CELL)


def _building(office: Office, rng: np.random.Generator) -> Bools:
    """Draw which cells are free, the lowest row first; the free cells are connected."""
    rows = office.corridors + 1  # of rooms; the upper half mirrors the lower one
    half = rng.integers(40, _DEEPEST + 1, (rows + 1) // 2).tolist()
    depths = half[: rows // 2] + half[::-1]
    drawn = office.wings // 2 if office.symmetric else 1 if office.repeated else office.wings
    wings = [_wing(office, depths, rng) for _ in range(drawn)]
    if office.repeated:
        wings *= office.wings
    if office.symmetric:
        wings += [wing[::-1, ::-1] for wing in reversed(wings)]
    across = np.zeros((len(wings[0]), _cells(office.corridor)), dtype=bool)
    across[_WALL:-_WALL] = True  # a vertical corridor, from the lowest wall to the highest
    wall = np.zeros((len(across), _WALL), dtype=bool)
    parts = [part for wing in wings for part in (across, wing)]
    return np.hstack([wall, *parts, across, wall])


def _wing(office: Office, depths: list[int], rng: np.random.Generator) -> Bools:
    """Rows of rooms with the corridors between them, from wall to wall."""
    length = int(rng.integers(160, _LONGEST + 1))
    way = np.ones((_cells(office.corridor), length), dtype=bool)
    rows: list[Bools] = []
    for place, depth in enumerate(depths):
        inner = 0 < place < len(depths) - 1
        kind = int(rng.integers(10)) if inner else None
        if kind == 0:  # a courtyard
            row = np.zeros((2 * depth - _WALL, length), dtype=bool)
        elif kind in (1, 2):
            row = _hall(office, 2 * depth - _WALL, length, rng)
            if kind == 2:  # with pillars in rows, centred between the walls
                row &= ~(_stripes(len(row))[:, None] & _stripes(length))
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


def _stripes(size: int) -> Bools:
    """Rows or columns of a hall in which pillars stand, (size,)."""
    count = (size - _PITCH) // _PITCH
    at = np.arange(size) - (size - (count - 1) * _PITCH - _PILLAR) // 2  # from the first one on
    return (at >= 0) & (at < count * _PITCH) & (at % _PITCH < _PILLAR)


def _cells(length: float) -> int:
    return round(length / CELL)
