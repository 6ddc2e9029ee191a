"""Buildings to cast rays in: a room full of pillars, and a floor of offices as a map of cells."""

import math

import numpy as np

from deqmcl_gym.maps import GridMap, PolygonMap


def pillared_room(segments: int) -> PolygonMap:
    """Return a square room of 400 px with oblique square pillars: 4 walls each and 4 around."""
    pillars = segments // 4 - 1
    side = math.ceil(math.sqrt(pillars))
    spacing = 400 / side
    corners = np.deg2rad(17 + 90 * np.arange(4))
    square = spacing / 4 * np.column_stack([np.cos(corners), np.sin(corners)])
    centres = [(spacing * (i % side + 0.5), spacing * (i // side + 0.5)) for i in range(pillars)]
    return PolygonMap(
        outer=((0, 0), (400, 0), (400, 400), (0, 400)),
        obstacles=tuple((square + centre).tolist() for centre in centres),
    )


def office_floor(side: int = 1000) -> GridMap:
    """Return offices with doors along corridors, and 400 things in them: side² cells of 5 cm."""
    rng, cells = np.random.default_rng(1), np.zeros((side, side), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    for wall in range(140, side, 180):
        for beside in (wall, wall + 40):  # a corridor of 2 m, a door in each office
            cells[beside : beside + 2] = 100
            for door in range(30, side, 100):
                cells[beside : beside + 2, door : door + 18] = 0
    for office in range(0, side, 180):
        for wall in range(100, side, 100):
            cells[office + (42 if office else 0) : office + 140, wall : wall + 2] = 100
    for row, column in rng.integers(5, side - 15, (400, 2)).tolist():
        cells[row : row + rng.integers(3, 12), column : column + rng.integers(3, 12)] = 100
    return GridMap(occupancy=cells, resolution=0.05)
