"""Compiled arithmetic with the same bits everywhere; the types of arrays, poses and points."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Reals = NDArray[np.floating[Any]]  # of either size
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]
Ints = NDArray[np.int32]
RoomActions = Singles  # (distance, turn) of rooms, (..., 2)

Single = Any  # a float32 inside a kernel
Scalar = Any  # a float32 or float64 there

Pose = tuple[float, float, float]  # x, y, θ
Point = tuple[float, float]  # x, y
