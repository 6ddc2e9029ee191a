"""Shapes of arrays that go into kernels, which would read or write past the end of short ones."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deqmcl_gym.validation import InputError


def table(what: str, rows: ArrayLike, columns: int) -> NDArray[Any]:
    """Return ``rows`` as an array (n, ``columns`` or more), else refuse it; NaN may be in it."""
    given = np.asarray(rows)
    if given.ndim != 2 or given.shape[1] < columns:
        raise InputError(
            f"{what} have shape {given.shape}, but must have shape (n, {columns}): a row for each."
        )
    return given


def check_pairs(starts: NDArray[Any], ends: NDArray[Any]) -> None:
    """Refuse unequal numbers of starts (2, n) and ends (2, n)."""
    if starts.shape[1] != ends.shape[1]:
        raise InputError(
            f"there are {starts.shape[1]} starts and {ends.shape[1]} ends: give as many of both."
        )


def check_moves(poses: NDArray[Any], moves: NDArray[Any], kept: int) -> None:
    """Refuse moves that are not (F, 3, n) for poses (3, n), or ``kept`` other than 1 or F."""
    steps = len(moves)
    fits = poses.shape == (3, poses.size // 3) and moves.shape == (steps, 3, *poses.shape[1:])
    if not fits or steps == 0 or kept not in (1, steps):
        raise InputError(
            f"poses have shape {poses.shape}, moves {moves.shape} and kept is {kept}, but they "
            "must be (3, n), (F, 3, n) with F ≥ 1, and 1 or F."
        )


def check_path(poses: NDArray[Any], path: NDArray[Any]) -> None:
    """Refuse poses that are not (3, n), or a path that is not (k + 1, 2), k ≥ 1."""
    if poses.shape != (3, poses.size // 3) or path.shape != (len(path), 2) or len(path) < 2:
        raise InputError(
            f"poses have shape {poses.shape} and the path {path.shape}, but they must be (3, n) "
            "and (k + 1, 2) with k ≥ 1."
        )
