"""Maps of cells for tests: drawn by Hypothesis, and their plain float64 geometry, cell by cell."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from deqmcl_gym.maps import GridMap

UNKNOWN = ("obstacle", "transparent", "free")
# (x, y, yaw): at home, and 6 km from it, where single precision still tells apart half a millimetre
ORIGINS = [(0.0, 0.0, 0.0), (-3.7, 12.25, 0.6), (5123.25, -3300.5, -2.9), (-40.0, 7.0, 1.5707963)]


@st.composite
def grids(draw, longest=14, unknown=UNKNOWN):
    """Small maps, mostly open, of any size, resolution and pose."""
    shape = draw(st.tuples(st.integers(2, longest), st.integers(2, longest)))
    cells = draw(arrays.arrays(np.int8, shape, elements=st.sampled_from([0, 0, 0, 0, 100, -1])))
    cells[draw(st.integers(0, shape[0] - 1)), draw(st.integers(0, shape[1] - 1))] = 0
    return GridMap(
        occupancy=cells,
        resolution=draw(st.sampled_from([0.05, 0.1, 1.0])),
        origin=draw(st.sampled_from(ORIGINS)),
        unknown=draw(st.sampled_from(unknown)),
    )


def office(side: int = 120, seed: int = 0) -> GridMap:
    """Rooms with doors along corridors, tables in them, 5 cm cells."""
    rng, cells = np.random.default_rng(seed), np.zeros((side, side), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[side // 3 :: side // 3] = cells[:, side // 4 :: side // 4] = 100
    for row, column in rng.integers(2, side - 14, (side // 3, 2)):
        cells[row : row + 12, column : column + 12] = 0
    for row, column in rng.integers(2, side - 5, (side // 6, 2)):
        cells[row : row + 3, column : column + 2] = 100
    return GridMap(occupancy=cells, resolution=0.05, origin=(-1.0, 2.0, 0.3))


def in_cells(grid: GridMap, points) -> np.ndarray:
    """Points (n, 2+) in cells from the lower left corner, (n, 2)."""
    x, y, yaw = grid.origin
    away = np.asarray(points, float)[:, :2] - (x, y)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return away @ turn / grid.resolution


def somewhere(grid: GridMap, n: int, rng, margin: float = 0.0) -> np.ndarray:
    """Uniform points of the map, and up to ``margin`` cells around it, (n, 2)."""
    rows, columns = grid.occupancy.shape
    return grid.placed(rng.uniform((-margin, -margin), (columns + margin, rows + margin), (n, 2)))


def boxes(grid: GridMap, solid: bool = True, what: str = "bodies") -> np.ndarray:
    """Lower left corners of all cells solid for bodies or beams, or of all open ones, (k, 2)."""
    rows, columns = np.nonzero(_solid(grid, what) == solid)
    return np.column_stack([columns, rows]).astype(float)


def is_solid(grid: GridMap, at: np.ndarray, what: str = "bodies") -> np.ndarray:
    """Whether points in cells (n, 2) on the map lie in cells solid for bodies or beams."""
    columns, rows = np.floor(at).astype(int).T
    return _solid(grid, what)[rows, columns]


def box_distance(at: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distance of points (n, 2) from unit squares (k, 2), (n, k)."""
    off = np.maximum(corners - at[:, None], at[:, None] - corners - 1).clip(0)
    return np.hypot(off[..., 0], off[..., 1])


def edge_distance(grid: GridMap, at: np.ndarray) -> np.ndarray:
    """Distance of points in cells, (n, 2), from the outline of the map, (n,)."""
    size = np.array(grid.occupancy.shape[::-1], float)
    outside = np.hypot(*np.maximum(-at, at - size).clip(0).T)
    return np.where(outside > 0, outside, np.minimum(at, size - at).min(axis=1))


def _solid(grid: GridMap, what: str) -> np.ndarray:
    transparent = {"bodies": 100, "beams": 0}[what]
    counted = {"obstacle": 100, "transparent": transparent, "free": 0}[grid.unknown]
    return np.where(grid.occupancy < 0, counted, grid.occupancy) >= 65
