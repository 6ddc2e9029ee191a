"""Distances to walls on a grid: bounds that decide most steps, and exact ones between cells."""

import math

import numpy as np

from deqmcl_gym.maps import kernels
from deqmcl_gym.maps.kernels import Clearance
from deqmcl_gym.numerics.types import Bools, Singles

_SQUARES = 8192  # a few px wide in a room; 32 KiB, which stays in the processor's first cache
# Share of the map's size that is subtracted from every bound. float32 resolves coordinates to 6e-8
# of it, and a distance to a wall takes only a few operations on them.
_MARGIN = 1e-4


def clearance_of(walls: Singles) -> Clearance:
    """Return the clearance of a map with walls (x₀, y₀, x₁, y₁), (S, 4).

    A ring of squares of its grid is outside the map.
    """
    x, y = walls[:, [0, 2]].astype(np.float64), walls[:, [1, 3]].astype(np.float64)
    width, height = float(np.ptp(x)), float(np.ptp(y))
    side = math.sqrt(width * height / _SQUARES)
    margin = _MARGIN * max(float(np.abs(x).max()), float(np.abs(y).max()), width, height)
    # Points beyond the grid count as in the ring: the ring keeps clear of the walls.
    corner = float(x.min()) - side - 2 * margin, float(y.min()) - side - 2 * margin
    columns, rows = (math.ceil((length + 4 * margin) / side) + 2 for length in (width, height))
    centre_x = corner[0] + (np.arange(columns) + 0.5) * side
    centre_y = corner[1] + (np.arange(rows) + 0.5) * side
    centres = np.array([g.ravel() for g in np.meshgrid(centre_x, centre_y)]).astype(np.float32)
    square, windings = np.empty(centres.shape[1], np.float32), np.empty(centres.shape[1], np.int32)
    kernels.sweep(centres, centres, walls, square)
    kernels.wind(centres, walls, windings)
    bound = np.maximum(np.sqrt(square) - (side / math.sqrt(2) + margin), 0.0)
    signed = np.where(windings == 1, bound, -bound).astype(np.float32)
    return Clearance(
        corner=np.array(corner, np.float32),
        per_side=np.float32(1 / side),
        bounds=signed.reshape(rows, columns),
    )


def to_nearest(marked: Bools) -> Singles:
    """Distance of each cell's centre to that of the nearest marked cell, in cells; inf if none is.

    Exact up to float32.
    """
    import cv2  # only here: neither maps nor localizers need it to be loaded

    if not marked.any():
        return np.full(marked.shape, np.inf, np.float32)
    elsewhere = np.ascontiguousarray(~marked, np.uint8)
    found = cv2.distanceTransform(elsewhere, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(found, np.float32)
