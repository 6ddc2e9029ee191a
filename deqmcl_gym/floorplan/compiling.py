"""Compile a numerical kernel with numba, cached on disk where that is possible."""

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile ``function`` at its first call; keep the machine code beside the source if we may.

    IEEE arithmetic as written: no fastmath (it changes results between processors), and division
    as in NumPy (inf and nan instead of an exception, which would also stop vectorisation).
    numba's cache does not see edits in another file: kernels that call each other share a file.
    """
    jit = partial(numba.njit, nogil=True, error_model="numpy", fastmath=False)
    try:
        return cast(F, jit(cache=True)(function))
    except RuntimeError:  # no writable place for a cache: compile in every process
        return cast(F, jit()(function))
